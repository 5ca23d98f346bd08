"""Random windows flatter where recordings have a mark of their own, and do not where they have none."""

from dataclasses import replace

import numpy as np
import pytest

from swashtwin.bench import run_leakage
from swashtwin.foundation import DataError
from swashtwin.recordings import Recording


def recordings(*, telling: bool, per_class: int = 6) -> list[Recording]:
    """Tones whose frequency is each recording's own, and in the second class twice as loud where that tells it."""
    tones = []
    for index in range(2 * per_class):
        label = "worn" if index % 2 else "normal"
        random = np.random.default_rng(index)
        tone = np.sin(2 * np.pi * (40 + 23 * index) * np.arange(1600) / 1000)
        loud = 3.0 if telling and index % 2 else 1.0
        signal = loud * (tone + 0.3 * random.normal(size=1600))
        day = f"day {index // 4}"
        tones.append(Recording(signal[None], 1000.0, f"r{index}", label=label, attributes={"day": day}))
    return tones


@pytest.fixture(scope="module")
def memorized():
    return run_leakage(recordings(telling=False), length=100, seeds=(0, 1), n_trees=20)


def test_a_set_that_can_only_be_memorized_has_a_large_premium(memorized):
    row = memorized.rows()[0]
    assert row["split"] == "recording"
    assert row["random_window"]["mean"] > 0.8
    assert row["balanced_accuracy"]["mean"] < 0.65
    low, high = memorized.details["intervals"]["recording"]["premium"]["interval"]
    assert 0.1 < low < row["premium"]["mean"] < high


def test_a_set_that_can_be_learnt_has_no_premium():
    study = run_leakage(recordings(telling=True), length=100, groups=("recording",), seeds=(0, 1), n_trees=20)
    row = study.rows()[0]
    assert row["balanced_accuracy"]["mean"] > 0.95
    assert abs(row["premium"]["mean"]) < 0.05
    assert any("level of acceleration alone tells" in note for note in study.notes)


def test_every_grouping_that_the_recordings_allow_has_a_row_and_others_a_reason(memorized):
    assert [row["split"] for row in memorized.rows()] == ["recording", "day"]
    assert any(note.startswith("Not held out: specimen.") for note in memorized.notes)
    assert "day held out" in memorized.answer[1]
    assert "3 groups the interval is coarse" in memorized.answer[1]


def test_channels_that_stand_still_somewhere_are_left_out_and_named():
    two_channels = [
        replace(
            recording,
            signal=np.vstack([recording.signal, recording.signal * (index > 0)]),
            channels=("moving", "still"),
        )
        for index, recording in enumerate(recordings(telling=True))
    ]
    study = run_leakage(two_channels, length=100, groups=("recording",), seeds=(0,), n_trees=5)
    assert any(note.startswith("still stand still") for note in study.notes)


def test_a_grouping_that_was_asked_for_and_cannot_be_held_out_is_refused():
    one_day = [replace(recording, attributes={"day": recording.label}) for recording in recordings(telling=True)]
    with pytest.raises(DataError, match=r"a class stands in 1 day\(s\) only"):
        run_leakage(one_day, length=100, groups=("day",), seeds=(0,))
