"""The study of the public sets keeps groups apart, selects settings on the training side alone, and
reports a leaky split as leaky.
"""

import json
from pathlib import Path

import numpy as np
import pytest

from swashtwin.diagnosis import FaultClassifier
from swashtwin.foundation import DataError, InputError
from swashtwin.recordings import Recording
from swashtwin_bench import StudyTable, Work
from swashtwin_bench.public.study import AT_RANDOM, PublicSettings, _drop_constant_channels, public

RATE = 1600.0
LAG = {"healthy": 2.2e-5, "cavitation50": 1.5e-5, "cavitation100": 0.9e-5}
"""Lag [rev/min] over the speed squared of each state of the made-up pump."""

TREES = PublicSettings(("extra_trees",))


def write_pump(
    folder: Path, speeds: tuple[int, ...], states: tuple[str, ...], count: int = 6720
) -> Path:
    """Write a made-up pump_cavitation with three repeats of each state.

    Only the slip depends on the state.
    """
    random = np.random.default_rng(0)
    recordings_folder = folder / "pump_cavitation" / "recordings"
    recordings_folder.mkdir(parents=True)

    for speed in speeds:
        for run, state in enumerate(states):
            for repeat in (1, 2, 3):
                path = recordings_folder / f"{run:02d}_{repeat}_s{speed}_{state}.dat"
                write_recording(path, speed, state, count, random)

    return folder


def write_recording(
    path: Path, speed: int, state: str, count: int, random: np.random.Generator
) -> None:
    """Write tones at multiples of the field and of the shaft, in noise of five channels."""
    time = np.arange(count) / RATE
    field = 1.03 * speed
    shaft = field - LAG[state] * field**2

    lines = [2 * k * field for k in (1, 2, 3, 6, 12)]
    lines += [k * shaft for k in (1, 2, 3, 5, 6, 7)]
    tones = np.zeros(count)
    for line in lines:
        tones += 0.4 * np.sin(2 * np.pi * line / 60 * time + random.uniform(0, 6))
    signal = tones + random.normal(size=(5, count))

    # the published files have seven lines of remarks above the names of the columns
    header = "% made up\n" * 7 + "Time\tch 0\tch 1\tch 2\tch 3\tch 4"
    table = np.column_stack([time, signal.T])
    np.savetxt(path, table, "%.6f", "\t", header=header, comments="")


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a pump with two states at three speeds."""
    folder = tmp_path_factory.mktemp("small")
    return write_pump(folder, (700, 1000, 1200), ("healthy", "cavitation100"))


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the runs of `study`."""
    return tmp_path_factory.mktemp("finished")


@pytest.fixture(scope="module")
def study(small: Path, finished: Path) -> StudyTable:
    return public(Work(out=finished), TREES, small)


def test_a_split_by_speed_has_a_fold_for_each_speed(study: StudyTable) -> None:
    row, _ = study.rows()
    assert (row["split"], row["classifier"]) == ("pump_cavitation/speed", "extra_trees")
    assert 0.3 < row["recording_balanced_accuracy"]["mean"] <= 1.0
    assert row["floor"]["mean"] == 0.38

    folds = [fold["fold"] for fold in study.details["folds"]]
    assert folds == ["700 rpm", "1000 rpm", "1200 rpm"]
    json.dumps(study.to_dict(), allow_nan=False)


def test_grades_are_scored_by_their_distance_and_left_out_of_the_mean(study: StudyTable) -> None:
    row, leaky = study.rows()
    # the two states that the pump has are four grades apart
    wrong_share = 1 - row["recording_balanced_accuracy"]["mean"]
    assert row["grade_distance"]["mean"] == pytest.approx(4 * wrong_share)
    assert leaky["grade_distance"]["mean"] is None
    assert study.answer == (f"extra_trees: {4 * wrong_share:.2f} grades from the right one.",)


def test_windows_at_random_are_a_row_with_its_own_name(study: StudyTable) -> None:
    _, leaky = study.rows()
    assert leaky["classifier"] == AT_RANDOM
    assert leaky["balanced_accuracy"]["mean"] > 0.5


def test_a_finished_training_is_read_and_not_repeated(
    study: StudyTable, small: Path, finished: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr(FaultClassifier, "fit")
    again = public(Work(out=finished), TREES, small)
    assert again.rows() == study.rows()


def test_an_unknown_classifier_is_refused_with_the_known_ones(small: Path) -> None:
    with pytest.raises(InputError, match="Invalid classifier 'trees': must be one of chosen, "):
        public(Work(), PublicSettings(("trees",)), small)


def test_a_refusal_of_the_training_is_reported_in_place_of_a_score(
    small: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(self: FaultClassifier, recordings: list[Recording]) -> None:
        raise DataError("too short.")

    monkeypatch.setattr(FaultClassifier, "fit", refuse)
    study = public(Work(), PublicSettings(("chosen",)), small)
    assert study.rows()[0]["balanced_accuracy"]["mean"] is None
    assert "pump_cavitation/speed, chosen: too short." in study.notes


def test_a_channel_that_is_constant_in_one_recording_is_dropped_from_all() -> None:
    signal = np.random.default_rng(0).normal(size=(2, 50))
    dead = Recording(signal * [[1.0], [0.0]], 10.0, "dead", channels=("x", "y"))
    live = Recording(signal, 10.0, "live", channels=("x", "y"))

    # a training needs the same channels in all of its recordings
    remaining = _drop_constant_channels([dead, live])
    assert [recording.channels for recording in remaining] == [("x",), ("x",)]


def test_a_folder_without_any_set_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="pump_cavitation"):
        public(Work(), PublicSettings(), tmp_path)


def test_a_set_of_a_single_group_cannot_be_split(tmp_path: Path) -> None:
    one_speed = write_pump(tmp_path, (1000,), ("healthy", "cavitation100"))
    with pytest.raises(DataError, match="one group"):
        public(Work(), PublicSettings(), one_speed)


def test_an_unknown_set_is_refused(small: Path) -> None:
    with pytest.raises(InputError, match="Invalid set"):
        public(Work(), PublicSettings(sets=("paderborn",)), small)
