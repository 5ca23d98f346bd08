"""A loaded classifier answers as the saved one or is refused; a diagnosis states its doubts."""

import copy
import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from commandline import one_line, run, run_json

from swashtwin.diagnosis import (
    describe_single_machine_faults,
    diagnose,
    explain,
    load_classifier,
    save_classifier,
)
from swashtwin.diagnosis.recording_arguments import require_layout
from swashtwin.foundation import (
    ArtifactError,
    DataError,
    InputError,
    MissingFileError,
    MPa,
    read_artifact,
    rpm,
    write_artifact,
)
from swashtwin.learning import (
    NETWORKS,
    BiTCN,
    FittedClassifier,
    TrainingSettings,
    WindowLayout,
    WindowSet,
    build_network,
    cut_windows,
    evaluate,
    fit,
    save_windows,
)
from swashtwin.learning.networks.registry import BUILT_IN
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import Recording, write_recording
from swashtwin.report import write_report

CLASSES = ("normal", "piston")


def recording(
    name: str,
    label: str,
    *,
    pressure: float = 15,
    speed: float = 860,
    samples: int = 480,
) -> Recording:
    draw = np.random.default_rng(list(name.encode()))
    cycles = {"normal": 0.05, "piston": 0.15}[label] * np.arange(samples)
    signal = np.sin(2 * np.pi * cycles + draw.uniform(0, 6)) + 0.3 * draw.normal(size=samples)
    condition = OperatingCondition(speed=rpm(speed), discharge_pressure=MPa(pressure))
    return Recording(signal[None], 1000.0, name, label=label, condition=condition)


def windows() -> WindowSet:
    recordings = []
    for label in CLASSES:
        recordings.extend(recording(f"{label} {number}", label) for number in range(3))

    return cut_windows(recordings, length=80)


@pytest.fixture(scope="module")
def classifier() -> FittedClassifier:
    settings = TrainingSettings(epochs=25, batch_size=12, learning_rate=3e-3, normalization="set")
    return fit(BiTCN(1, 2, channels=(8, 12), kernel_size=3), windows(), settings=settings)


@pytest.fixture
def saved(classifier, tmp_path) -> Path:
    return save_classifier(classifier, tmp_path / "pump.safetensors")


@pytest.mark.parametrize(
    ("name", "normalization"),
    [*((name, "set") for name in sorted(BUILT_IN)), ("bitcn", "window")],
)
def test_a_loaded_classifier_has_the_bits_of_the_saved_one(tmp_path, name, normalization):
    settings = TrainingSettings(epochs=1, normalization=normalization)
    classifier = fit(build_network(name, 1, 2), windows(), settings=settings, manifest=["extra"])
    loaded = load_classifier(save_classifier(classifier, tmp_path / "deep" / "model.safetensors"))

    np.testing.assert_array_equal(
        loaded.predict_proba(windows()), classifier.predict_proba(windows())
    )
    np.testing.assert_array_equal(loaded.embed(windows()), classifier.embed(windows()))

    facts = "classes layout settings seed history manifest pressures speeds"
    for fact in facts.split():
        assert getattr(loaded, fact) == getattr(classifier, fact)

    assert [path.name for path in (tmp_path / "deep").iterdir()] == ["model.safetensors"]


def test_saving_the_loaded_classifier_gives_the_same_bytes(saved, tmp_path):
    copy = save_classifier(load_classifier(saved), tmp_path / "copy.safetensors")
    assert copy.read_bytes() == saved.read_bytes()


def test_a_file_with_an_incomplete_card_is_refused_in_one_line(saved):
    card, tensors = read_artifact(saved, "classifier", 12, advice="")
    for name in card:
        incomplete = {key: value for key, value in card.items() if key != name}
        write_artifact(saved, "classifier", 12, incomplete, tensors)
        with pytest.raises(ArtifactError, match=f"does not fit this swashtwin.*{name}") as caught:
            load_classifier(saved)
        assert "\n" not in str(caught.value)

    del tensors["network.weights.head.weight"]
    write_artifact(saved, "classifier", 12, card, tensors)

    with pytest.raises(ArtifactError, match="does not fit this swashtwin"):
        load_classifier(saved)


def test_other_files_are_refused(tmp_path):
    path = save_windows(windows(), tmp_path / "windows.safetensors")
    with pytest.raises(ArtifactError, match="holds a 'window set', not a classifier"):
        load_classifier(path)
    with pytest.raises(MissingFileError, match=r"gone.* swashtwin train, or its method save"):
        load_classifier(tmp_path / "gone.safetensors")


def test_a_file_whose_network_is_not_registered_is_refused_with_what_to_call(saved, monkeypatch):
    monkeypatch.delitem(NETWORKS, "bitcn")
    with pytest.raises(
        ArtifactError,
        match=r"'bitcn', which is not registered here; register the same network",
    ):
        load_classifier(saved)


def test_a_network_that_is_not_registered_is_not_saved(classifier, tmp_path):
    class Custom(BiTCN):
        pass

    custom = replace(classifier, network=Custom(1, 2))
    with pytest.raises(ArtifactError, match="Custom is not registered"):
        save_classifier(custom, tmp_path / "x.safetensors")


@pytest.mark.parametrize("label", CLASSES)
def test_a_new_recording_is_diagnosed_from_all_its_windows(classifier, label):
    diagnosis = diagnose(
        classifier,
        recording(f"new {label}", label).replace(label="a label never trained"),
    )

    assert diagnosis.label == label
    assert diagnosis.n_windows == 6
    assert diagnosis.agreement == pytest.approx(diagnosis.window_labels.count(label) / 6)
    assert sum(diagnosis.probabilities.values()) == pytest.approx(1)
    assert max(diagnosis.probabilities, key=diagnosis.probabilities.get) == label
    assert diagnosis.notes == ()


def test_an_untrained_condition_and_a_training_recording_have_notes(classifier):
    (note,) = diagnose(classifier, recording("new", "normal", pressure=5)).notes
    assert "5 MPa was not trained (trained: 15 MPa)" in note

    (note,) = diagnose(classifier, recording("new", "normal", speed=1500)).notes
    assert "1500 rev/min was not trained" in note
    assert diagnose(classifier, recording("new", "normal", speed=870, pressure=15.3)).notes == ()

    (note,) = diagnose(classifier, recording("piston 1", "piston")).notes
    assert "this very recording" in note

    slow = diagnose(classifier, recording("new", "normal", speed=400)).notes
    assert "shorter than one revolution" in slow[0]


@pytest.mark.parametrize(
    ("machines", "specimen", "messages"),
    [
        (
            "A" * 6,
            "B",
            ["Machine B is not in the training, which covers one machine, A."],
        ),
        ("A" * 6, "A", []),
        ("ABCABC", "D", []),
        (("",) * 6, "B", []),
    ],
)
def test_a_note_names_a_machine_that_was_not_trained(classifier, machines, specimen, messages):
    reference = replace(classifier.training_reference, specimen=tuple(machines))
    trained = replace(classifier, training_reference=reference)
    notes = diagnose(trained, replace(recording("new", "piston"), specimen=specimen)).notes

    assert len(notes) == len(messages)
    for note, message in zip(notes, messages, strict=True):
        assert note.startswith(message)
    assert ("measured on one machine only" in describe_single_machine_faults(reference)) == (
        machines != "ABCABC"
    )


@pytest.mark.parametrize(
    ("change", "messages"),
    [
        (
            {"sample_rate": 2000.0},
            "sample rate 1000 Hz against 2000 Hz. If 2000 Hz is right, set resample='1000 Hz'",
        ),
        (
            {
                "signal": np.random.default_rng(0).normal(size=(2, 480)),
                "channels": ("a", "b"),
            },
            "1 channel.s. against 2",
        ),
        (
            {"unit": "g"},
            "against g. Specify what a number in the file means: sensitivity=",
        ),
        (
            {"channels": ("other",)},
            "against other. Name the channels of the file with names, once for each",
        ),
    ],
)
def test_a_recording_that_does_not_fit_the_classifier_is_refused_with_both_values(
    classifier, change, messages
):
    with pytest.raises(DataError, match=messages):
        diagnose(classifier, replace(recording("new", "normal"), **change))


@pytest.mark.parametrize(
    ("channels", "missing"), [(("a", "c"), "b"), (("b",), "a, c"), (("x", "y"), "a, b, c")]
)
def test_a_recording_with_too_few_channels_is_refused_with_the_missing_ones(channels, missing):
    layout = WindowLayout(sample_rate=2000.0, channels=("a", "b", "c"), unit="g", length=64)
    signal = np.random.default_rng(0).normal(size=(len(channels), 480))
    measured = Recording(signal, 2000.0, "new", channels=channels, unit="g")

    with pytest.raises(DataError, match=f"not among its channels: {missing}. Read all"):
        require_layout(layout, measured)


def test_a_diagnosis_imports_no_library_that_it_does_not_need(tmp_path):
    default = build_network("band_powers", 1, 2)
    settings = TrainingSettings(epochs=5, batch_size=12, learning_rate=3e-3, normalization="set")
    saved = save_classifier(
        fit(default, windows(), settings=settings), tmp_path / "pump.safetensors"
    )
    path = write_recording(recording("new", "piston"), tmp_path / "new.h5")
    code = (
        "import sys; from swashtwin.cli import main; sys.argv[1:] = ['diagnose', *sys.argv[1:]]\n"
        "try: main()\n"
        "except SystemExit: pass\n"
        "heavy = {'sklearn', 'scipy.signal', 'matplotlib', 'onnx', 'pandas', 'arro3',\n"
        "         'numba', 'sympy', 'torch'}\n"
        "print('imported:', sorted(heavy & set(sys.modules)))"
    )
    command = [sys.executable, "-c", code, str(saved), str(path)]
    answer = subprocess.run(command, capture_output=True, text=True, check=True).stdout

    assert "piston" in answer
    assert answer.endswith("imported: []\n")


def spiked(size: float) -> Recording:
    """A faulty pump with one sample that is far too large."""
    signal = recording("spiked", "piston").signal.copy()
    signal[0, 200] = size
    return recording("spiked", "piston").replace(signal=signal)


def test_a_recording_too_short_for_a_window_has_no_verdict(classifier):
    verdict = diagnose(classifier, recording("new", "normal", samples=79))
    assert "too few for one window" in verdict.no_verdict


@pytest.mark.parametrize(
    ("size", "reason"),
    [(1e20, "1e+20 m/s^2"), (1e39, "1e+39 m/s^2"), (np.nan, "missing or infinite")],
)
def test_a_single_sample_that_is_not_finite_or_far_too_large_prevents_a_verdict(
    classifier, size, reason
):
    """Such a sample made every score NaN, and the likeliest of NaN was the first class: normal."""
    verdict = diagnose(classifier, spiked(size))
    assert verdict.label is None
    assert verdict.to_dict()["no_verdict"] == verdict.no_verdict
    assert reason in verdict.no_verdict
    assert "no verdict" in repr(verdict)
    with pytest.raises(InputError, match="no verdict to explain"):
        explain(classifier, spiked(size), verdict)


def test_a_model_with_a_weight_of_nan_gives_no_verdict_and_is_not_saved(classifier, tmp_path):
    network = copy.deepcopy(classifier.network)
    with torch.no_grad():
        next(network.parameters()).fill_(math.nan)
    damaged = replace(classifier, network=network)

    assert "the model is damaged" in diagnose(damaged, recording("new", "normal")).no_verdict

    test = cut_windows(
        [recording("new", "normal"), recording("newer", "piston")],
        length=80,
        classes=CLASSES,
    )
    scores = evaluate(damaged, test)

    assert (scores.accuracy, scores.recording_accuracy) == (0, 0)
    assert (scores.false_alarm_rate, scores.missed_fault_rate) == (1, 1)
    assert scores.reasons["accuracy"] == "12 of 12 windows have no verdict and count as errors"
    assert scores.confusion.tolist() == [[0, 0, 6], [0, 0, 6]]
    assert "no verdict" in write_report(scores, folder=tmp_path / "page").read_text()
    with pytest.raises(DataError, match="no verdict on 12 of 12"):
        damaged.predict(test)
    with pytest.raises(ArtifactError, match="NaN or infinity"):
        save_classifier(damaged, tmp_path / "model.safetensors")


def test_a_missing_verdict_shows_in_text_json_page_and_exit_code(saved, tmp_path, monkeypatch):
    for name, measured in (
        ("good", recording("good", "piston")),
        ("spiked", spiked(1e20)),
    ):
        write_recording(measured, tmp_path / f"{name}.h5")

    command = ["diagnose", saved, tmp_path / "good.h5", tmp_path / "spiked.h5"]
    good, bad = run_json(*command, "--report", tmp_path / "page", code=4)["diagnoses"]

    assert good["label"] == "piston"
    assert bad["label"] is None
    assert bad["probabilities"] == {}
    page = (tmp_path / "page" / "report.html").read_text()
    assert "Diagnosis of spiked" in page
    assert "<h2>No verdict</h2>" in page

    text = run(*command, code=4).output
    assert (
        "note: spiked: no verdict: the model's answer to 1 of 6 windows is not a finite number"
        in text
    )

    run(*command[:3])
    for name in ("short", "brief"):
        write_recording(recording(name, "piston", samples=79), tmp_path / f"{name}.h5")

    cut = run(*command[:2], tmp_path / "short.h5", tmp_path / "brief.h5", code=4)
    assert "note: in 2 recordings (short, brief): no verdict: it has 79 samples" in cut.output

    (tmp_path / "healthy.csv").touch()
    refused = run(*command[:3], "--healthy", tmp_path / "healthy.csv", code=2)
    # The box of the message breaks its lines.
    assert "is not an index" in " ".join(refused.output.replace("│", "").split())

    def explain_late(*arguments):
        (tmp_path / "good.h5").unlink()
        return explain(*arguments)

    monkeypatch.setattr("swashtwin.diagnosis.explain", explain_late)
    late = run(*command[:3], "--report", tmp_path / "page", "--force")

    assert "good.h5: the file is gone since it was loaded" in late.stderr
    assert "piston" in late.stdout


def test_recordings_are_identified_by_content_and_not_by_file_name(classifier, saved, tmp_path):
    """A recording was once identified by its name alone."""
    for folder in ("same", "other"):
        for index, name in enumerate(("normal 0", "piston 0")):
            label = name.split()[0]
            if folder == "same":
                measured = recording(name, label)
                file_name = f"renamed {index}"
            else:
                measured = recording(f"{name}, machine 2", label)
                file_name = name

            renamed = measured.replace(recording_id=file_name)
            write_recording(renamed, tmp_path / folder / f"{file_name}.h5")
        run("index", tmp_path / folder, "--out", tmp_path / folder / "index.toml")

    answer = run_json("evaluate", saved, tmp_path / "other" / "index.toml")
    assert answer["recordings"] == ["normal 0", "piston 0"]

    refused = run("evaluate", saved, tmp_path / "same" / "index.toml", code=3)
    assert "2 that the model was trained on (renamed 0: normal 0)" in one_line(refused)

    (copied,) = run_json("diagnose", saved, tmp_path / "same" / "renamed 0.h5")["diagnoses"]
    assert "under the name normal 0; the answer proves nothing" in copied["notes"][0]

    (other,) = run_json("diagnose", saved, tmp_path / "other" / "normal 0.h5")["diagnoses"]
    assert other["notes"] == []
