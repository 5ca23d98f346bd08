"""The default way from recordings to a verdict needs neither torch nor numba."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from swashtwin.pump import OperatingCondition
from swashtwin.recordings import Recording, write_store

CODE = """
import sys
from swashtwin.diagnosis import AnomalyDetector, FaultClassifier, explain, load_model
from swashtwin.recordings import load_recordings
folder = sys.argv[1]
recordings = load_recordings(folder + "/set.h5")
old, new = ([r for r in recordings if r.recording_id.endswith(n)] for n in ("old", "new"))
classifier = FaultClassifier().fit(old)
classifier.save(folder + "/model.safetensors")
classifier = load_model(folder + "/model.safetensors")
print(classifier.evaluate(new))
verdict = classifier.diagnose(new[0])
explain(classifier.fitted_, new[0], verdict)
healthy = [r for r in recordings if r.label == "normal"]
AnomalyDetector().fit(healthy).diagnose(new[0])
load_model("25scy14-1b")
print("imported:", sorted({"torch", "numba"} & set(sys.modules)))
"""


@pytest.mark.nightly
def test_train_save_evaluate_diagnose_explain_and_detect_import_neither_torch_nor_numba(
    tmp_path: Path,
) -> None:
    recordings = []
    for number in range(12):
        name = f"{number} {'new' if number >= 8 else 'old'}"
        label = ("normal", "piston")[number % 2]
        draw = np.random.default_rng(number)
        time = np.arange(8192) / 8192
        signal = draw.normal(size=(1, time.size)) + (number % 2) * np.sin(2 * np.pi * 300 * time)
        condition = OperatingCondition(speed=2 * np.pi * 20, discharge_pressure=15e6)
        recordings.append(Recording(signal, 8192.0, name, label=label, condition=condition))

    write_store(recordings, tmp_path / "set.h5")
    command = [sys.executable, "-c", CODE, str(tmp_path)]
    answer = subprocess.run(command, capture_output=True, text=True, check=False)

    assert answer.stdout.endswith("imported: []\n"), answer.stderr


def test_a_network_of_torch_names_the_extra_that_installs_it() -> None:
    code = (
        "import sys; sys.modules['torch'] = None; "
        "import swashtwin.learning as l; l.build_network('bitcn', 1, 2)"
    )
    command = [sys.executable, "-c", code]
    error = subprocess.run(command, capture_output=True, text=True, check=False).stderr
    expected = (
        'the network bitcn needs torch, which is not installed: pip install "swashtwin[networks]".'
    )

    assert error.splitlines()[-1].endswith(expected)
