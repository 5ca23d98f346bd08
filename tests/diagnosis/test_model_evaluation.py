"""Evaluation of a model: which recordings are scored, and why the others are not."""

from pathlib import Path

import numpy as np
import pytest
from commandline import one_line, run, run_json

from swashtwin.diagnosis import AnomalyDetector, FaultClassifier, evaluate_model
from swashtwin.foundation import DataError
from swashtwin.recordings import Recording, write_store

RATE = 2000.0
FREQUENCIES = {"normal": 100.0, "piston": 300.0, "swash_plate": 700.0}


def recording(
    name: str, label: str | None = "normal", *, synthetic: bool = False, sample_rate: float = RATE
) -> Recording:
    """Return a tone of its class in noise of its own."""
    draw = np.random.default_rng(list(name.encode()))
    time = np.arange(1000) / sample_rate
    tone = np.sin(2 * np.pi * FREQUENCIES[label or "normal"] * time)
    samples = tone + 0.1 * draw.normal(size=time.size)
    return Recording(
        samples[None], sample_rate, name, channels=("x",), label=label, synthetic=synthetic
    )


def dead_recording(name: str) -> Recording:
    return recording(name).replace(signal=np.zeros((1, 1000)))


TRAINING = [
    recording(f"{label} {number}", label) for label in ("normal", "piston") for number in range(4)
]


@pytest.fixture(scope="module")
def classifier() -> FaultClassifier:
    return FaultClassifier("band_powers", window=200).fit(TRAINING)


MIXED = [
    recording("new normal"),
    recording("new piston", "piston"),
    recording("made", synthetic=True),
    TRAINING[0],
    TRAINING[1].replace(recording_id="copy"),
    recording("open", None),
    recording("other part", "swash_plate"),
    recording("other part 2", "swash_plate"),
    dead_recording("dead"),
    dead_recording("dead too"),
    recording("fast", sample_rate=4000.0),
]


def test_each_excluded_recording_has_one_reason(classifier: FaultClassifier) -> None:
    evaluation = evaluate_model(classifier, MIXED)

    scored = [recording.recording_id for recording in evaluation.recordings]
    excluded = {exclusion.reason: exclusion.recordings for exclusion in evaluation.excluded}
    assert scored == ["new normal", "new piston"]
    assert evaluation.scores.n_recordings == 2
    assert list(excluded["synthetic"]) == ["made"]
    assert excluded["in training"] == {"normal 0": "normal 0", "copy": "normal 1"}
    assert list(excluded["no class"]) == ["open"]
    assert excluded["untrained class"] == {
        "other part": "swash_plate",
        "other part 2": "swash_plate",
    }
    assert "dead or unplugged" in excluded["unusable"]["dead"]
    assert "sample rate" in excluded["unusable"]["fast"]

    names = [name for recordings in excluded.values() for name in recordings]
    assert sorted([*scored, *names]) == sorted(recording.recording_id for recording in MIXED)


def test_nothing_is_excluded_if_all_recordings_can_be_scored(classifier: FaultClassifier) -> None:
    evaluation = evaluate_model(classifier, MIXED[:2])

    assert evaluation.excluded == ()
    assert evaluation.scores.to_dict() == classifier.evaluate(MIXED[:2]).to_dict()


@pytest.mark.parametrize(
    ("recordings", "reason"),
    [
        pytest.param([recording("open", None)], r"1 without a class \(open\)", id="no class"),
        pytest.param(
            [recording("a", "swash_plate"), TRAINING[0]],
            r"1 that the model was trained on \(normal 0\); 1 of classes that the model was not "
            r"trained on \(a: swash_plate\)\. Test on recordings that the model was not trained on",
            id="other class and training",
        ),
        pytest.param(
            [recording("s", synthetic=True), recording("t", "piston", synthetic=True)],
            r"2 made by a model \(s\)\.$",
            id="synthetic",
        ),
        pytest.param(
            [*TRAINING[:3], recording("s", synthetic=True)],
            r"1 made by a model \(s\); 3 that the model was trained on \(normal 0\)\. Test on",
            id="synthetic and training",
        ),
        pytest.param(
            [TRAINING[5].replace(recording_id="copy")],
            r"1 that the model was trained on \(copy: piston 1\)\. Test on",
            id="training",
        ),
        pytest.param(
            [dead_recording("d")], r"1 that cannot be used \(d: d, x: every sample", id="dead"
        ),
    ],
)
def test_an_evaluation_of_no_recording_states_what_was_excluded(
    classifier: FaultClassifier, recordings: list[Recording], reason: str
) -> None:
    with pytest.raises(DataError, match=rf"No recording can be scored\. Excluded: {reason}"):
        evaluate_model(classifier, recordings)


def test_a_detector_scores_all_classes_and_excludes_recordings_without_one() -> None:
    detector = AnomalyDetector(error_rate=0.2).fit([recording(f"h{n}") for n in range(8)])

    evaluation = evaluate_model(detector, [*MIXED[:2], *MIXED[5:7], MIXED[-1]])

    excluded = {exclusion.reason: list(exclusion.recordings) for exclusion in evaluation.excluded}
    assert excluded == {"no class": ["open"], "unusable": ["fast"]}
    labels = [score.label for score in evaluation.scores.classes]
    assert labels == ["normal", "piston", "swash_plate"]


def test_the_command_names_what_it_excludes_and_the_denominators(
    classifier: FaultClassifier, tmp_path: Path
) -> None:
    model = classifier.save(tmp_path / "model.safetensors")
    stored = [entry for entry in MIXED if entry.recording_id != "fast"]
    store = write_store(stored, tmp_path / "test.h5")

    result = run("evaluate", model, store)
    answer = run_json("evaluate", model, store)

    notes = " ".join(result.stderr.split())
    assert "excluded: 1 recording made by a model (made)" in notes
    assert "excluded: 2 recordings that the model was trained on (copy, normal 0)" in notes
    assert "excluded: recording copy, of the same measurement as normal 1, had a part" in notes
    assert "excluded: 1 recording without a class (open)" in notes
    classes = "excluded: 2 recordings of classes that the model was not trained on, swash plate"
    assert f"{classes} (other part, other part 2)" in notes
    assert "excluded: in 2 recordings (dead, dead too): x: every sample is 0" in notes
    assert "of 10 windows" in result.stdout
    assert "of 2 recordings" in result.stdout
    assert [entry["reason"] for entry in answer["excluded"]] == [
        "synthetic",
        "in training",
        "no class",
        "untrained class",
        "unusable",
    ]
    assert one_line(run("evaluate", model, tmp_path / "nowhere", code=3))


def test_the_page_states_how_many_recordings_are_not_scored(
    classifier: FaultClassifier, tmp_path: Path
) -> None:
    model = classifier.save(tmp_path / "model.safetensors")
    store = write_store([*MIXED[:2], MIXED[5]], tmp_path / "test.h5")

    run("evaluate", model, store, "--report", tmp_path / "page.html")

    page = (tmp_path / "page.html").read_text()
    assert "1 without a class" in page
    assert "without a class" not in page.partition("</title>")[0]


def test_an_evaluation_reports_what_it_has_read_and_classified(
    classifier: FaultClassifier,
) -> None:
    reported = []
    evaluate_model(classifier, MIXED[:2], lambda *progress: reported.append(progress))

    activities = dict.fromkeys(activity for _, _, activity in reported)
    assert list(activities) == ["reading", "classifying windows"]
    for count, total, activity in reported:
        assert 0 < count <= total, activity
    assert reported[1] == (2, 2, "reading")
    assert reported[-1][0] == reported[-1][1]
