"""Classifiers on convolution kernels work wherever aeon is, and say what to install where it is not."""

import importlib.util
import os
import stat
import sys
from pathlib import Path

import numpy as np
import pytest

from swashtwin_bench.rivals.kernels import KERNELS, PYTHON
from swashtwin.foundation import InputError, MissingExtraError
from swashtwin.learning import WindowSet, cut_windows, evaluate, extract_features, fit_baseline
from swashtwin.recordings import Recording

CLASSES = ("normal", "piston", "valve_plate")
STUB = """
import numpy as np

class MiniRocket:
    def __init__(self, random_state):
        self.lines = np.random.default_rng(random_state).permutation(np.arange(4, 30))
    def fit(self, windows):
        self.level = abs(np.fft.rfft(windows)).mean()
        return self
    def transform(self, windows):
        return (abs(np.fft.rfft(windows))[:, 0][:, self.lines] > self.level).astype(np.float32)
"""


def tones(tag: str, *, per_class: int = 3, classes: tuple[str, ...] = CLASSES, gain: float = 1.0) -> WindowSet:
    recordings = []
    for index, label in enumerate(classes):
        for number in range(per_class):
            name = f"{tag} {label} {number}"
            draw = np.random.default_rng(list(name.encode()))
            phase = 2 * np.pi * (0.05 + 0.06 * index) * np.arange(640) + draw.uniform(0, 6)
            signal = gain * (np.sin(phase) + 0.3 * draw.normal(size=phase.size))
            recordings.append(Recording(signal[None], 1000.0, name, label=label))
    return cut_windows(recordings, length=128)


@pytest.fixture
def another_python(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A Python in whose aeon three lines stand for MiniRocket."""
    package = tmp_path / "aeon" / "transformations" / "collection"
    package.mkdir(parents=True)
    (package / "convolution_based.py").write_text(STUB)
    python = tmp_path / "python"
    python.write_text(f'#!/bin/sh\nshift\nPYTHONPATH="{tmp_path}" exec "{sys.executable}" "$@"\n')
    python.chmod(python.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv(PYTHON, str(python))
    return python


def test_kernels_take_no_other_features() -> None:
    with pytest.raises(InputError, match="reads the windows themselves"):
        fit_baseline("minirocket", tones("train"), features=lambda windows: extract_features(windows))


def test_kernels_without_aeon_name_both_ways_to_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(PYTHON, raising=False)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(MissingExtraError, match=rf"swashtwin\[rocket\].*{PYTHON}"):
        fit_baseline("minirocket", tones("train"))


def test_another_python_computes_the_kernels(another_python: Path) -> None:
    train, test = tones("train"), tones("test", gain=50)
    first, again, other = (fit_baseline("minirocket", train, seed=seed) for seed in (0, 0, 1))
    table = first.features(test)
    assert table.values.shape == (len(test), len(table.names)) == (len(test), 26)
    assert evaluate(first, test).accuracy > 0.9  # whatever the gain
    np.testing.assert_array_equal(first.predict_proba(test), again.predict_proba(test))
    assert not np.array_equal(other.features(test).values, table.values)


def test_another_python_that_fails_says_so_in_one_line(another_python: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(MissingExtraError, match=r"multirocket failed in .*MultiRocket"):  # the stub has none
        fit_baseline("multirocket", tones("train"))
    monkeypatch.setenv(PYTHON, "/nowhere/python")
    with pytest.raises(MissingExtraError, match="/nowhere/python"):
        fit_baseline("minirocket", tones("train"))


def test_another_python_that_is_killed_is_said_to_want_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    python = tmp_path / "python"
    python.write_text("#!/bin/sh\nkill -9 $$\n")
    python.chmod(0o755)
    monkeypatch.setenv(PYTHON, str(python))
    with pytest.raises(MissingExtraError, match="ended by signal 9, most often for want of memory"):
        fit_baseline("minirocket", tones("train"))


@pytest.mark.parametrize("name", sorted(KERNELS))
def test_real_kernels_tell_tones_of_new_recordings_apart(name: str) -> None:
    if PYTHON not in os.environ and importlib.util.find_spec("aeon") is None:
        pytest.skip(f"no aeon: set {PYTHON} to a Python that has it")
    assert evaluate(fit_baseline(name, tones("train")), tones("test", gain=50)).accuracy > 0.9
