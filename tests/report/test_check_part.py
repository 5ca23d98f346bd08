"""The page of a data check says everything that must be mended."""

import numpy as np
import pytest

from swashtwin.learning import check_recordings
from swashtwin.recordings import Recording, Recordings
from swashtwin.report.check_part import check_part


def test_a_copy_at_another_gain_stands_among_what_must_be_mended() -> None:
    signal = np.random.default_rng(0).normal(size=(1, 4096))
    recordings = [Recording(signal, 1000.0, "first"), Recording(2 * signal, 1000.0, "again")]
    check = check_recordings(recordings)
    assert not check.is_sound
    assert sum(count.recordings for count in check.counts) == 1
    text = repr(check_part(check, ""))
    assert "is a copy of first at another gain" in text
    assert "Nothing suspicious" not in text


def test_recordings_of_the_virtual_rig_are_called_so() -> None:
    signals = np.random.default_rng(0).normal(size=(2, 1, 4096))
    rig = {"origin": "swashtwin virtual rig, version 1"}
    recordings = [
        Recording(signals[0], 1000.0, "made", attributes=rig),
        Recording(signals[1], 1000.0, "measured", attributes={"origin": "test bench 3"}),
    ]
    check = check_recordings(recordings)
    (note,) = [text for text in check.notes if "stand-in" in text]
    assert note.startswith("1 recording of the swashtwin virtual rig, version 1:")
    assert note in repr(check_part(check, ""))


def test_exact_copies_are_not_counted_as_usable() -> None:
    signals = np.random.default_rng(0).normal(size=(2, 1, 4096))
    labels = ("normal", "worn")
    recordings = [
        Recording(signal, 1000.0, f"{label} {number}", label=label)
        for label, signal in zip(labels, signals, strict=True)
        for number in range(3)
    ]
    check = check_recordings(recordings)
    assert [count.recordings for count in check.counts] == [1, 1]
    assert not check.is_enough


@pytest.mark.parametrize("counts", [(3, 3), (5, 5), (4, 12), (2, 9)])
def test_confidence_counts_the_recordings_that_a_test_leaves(counts: tuple[int, int]) -> None:
    names = [
        f"{label} {number}" for label, count in zip(("normal", "worn"), counts, strict=True) for number in range(count)
    ]
    signals = np.random.default_rng(0).normal(size=(len(names), 1, 256))
    recordings = [
        Recording(signal, 1000.0, name, label=name.split()[0]) for name, signal in zip(names, signals, strict=True)
    ]
    training, _ = Recordings(recordings).split(test=0.2)
    (confidence,) = [use for use in check_recordings(recordings, window=64).uses if use.name == "calibrated confidence"]
    assert f"{len(training)} recordings are left after a test" in confidence.reason
