"""Recordings and the selection of them."""

import math
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swashtwin.foundation import DataError, InputError
from swashtwin.recordings import Recording, Recordings, join_blocks
from swashtwin.recordings.samples import Samples

LABELS = st.sampled_from(["normal", "piston", None])
SPECIMENS = st.sampled_from(["A", "B", None])


def make(name: str = "a", label: str | None = None, specimen: str | None = None) -> Recording:
    signal = np.arange(12.0).reshape(3, 4)
    return Recording(signal, 8.0, name, channels=("x", "y", "z"), label=label, specimen=specimen)


@given(names=st.permutations(["x", "y", "z"]), count=st.integers(1, 3))
def test_picked_channels_come_in_the_order_asked_for(names: list[str], count: int) -> None:
    recording = make()
    picked = recording.select_channels(names[:count])
    assert picked.channels == tuple(names[:count])
    for name, row in zip(picked.channels, picked.signal, strict=True):
        np.testing.assert_array_equal(row, recording.signal[recording.channels.index(name)])


def test_a_channel_with_a_blank_name_is_called_by_its_number() -> None:
    recording = Recording(np.zeros((3, 4)), 8.0, "a", channels=("x", "", " "))

    assert recording.channels == ("x", "channel_1", "channel_2")


@pytest.mark.parametrize("shape", [(5,), (1, 0), (0, 5), (2, 3, 4)])
def test_a_signal_without_channels_or_samples_is_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(DataError, match=r"a: signal has shape .*; it must be \(channel, time\)"):
        Samples.in_memory("a", np.zeros(shape), None)


@pytest.mark.wrong_types
def test_a_recording_has_samples_of_its_own_and_none_where_they_are_masked() -> None:
    array = np.ma.array(np.arange(8).reshape(2, 4), mask=False)
    array.mask[1, 2] = True
    recording = Recording(array, 10.0, "a", channels=("x", "y"))
    array[0] = 100
    np.testing.assert_array_equal(recording.signal, [[0, 1, 2, 3], [4, 5, np.nan, 7]])
    for values in (np.zeros((1, 4), complex), np.array([["a"]])):
        with pytest.raises(DataError, match="a recording holds real numbers"):
            Recording(values, 10.0, "a")
    with pytest.raises(InputError, match="a is one recording, but several are expected"):
        Recordings(recording)


@pytest.mark.wrong_types
@pytest.mark.parametrize(
    ("facts", "message"),
    [
        ({"recording_id": ""}, r"needs .* and a recording_id"),
        ({"channels": ("x", "y")}, "a: 2 channel names for 1 channels"),
        *(
            ({"sample_rate": rate}, r"a: sample_rate \(.* Hz\) must be")
            for rate in (0.0, -1.0, math.nan, math.inf)
        ),
        ({"sample_rate": "25 kHz"}, r"sample_rate \('25 kHz' Hz\) must be a positive number"),
        ({"label": 3}, r"label \(3\) must be text"),
        ({"speed": 80.0}, r"speed has shape \(\) for 4 samples"),
    ],
)
def test_a_fact_of_a_wrong_kind_is_refused_in_words(facts: dict[str, Any], message: str) -> None:
    with pytest.raises((DataError, InputError), match=message):
        Recording(**{"signal": np.zeros((1, 4)), "sample_rate": 10.0, "recording_id": "a", **facts})
    with pytest.raises(InputError, match="is not a recording"):
        Recordings(["a.csv"])
    for stop in ("5", 2.5):
        with pytest.raises(InputError, match="sample numbers must be integers, not 0 to"):
            make().slice(0, stop)


@pytest.mark.parametrize(
    ("speed", "message"),
    [
        (np.array([80.0, 81.0]), r"a: speed has shape \(2,\) for 4 samples"),
        (np.array([[80.0, 81.0, 82.0, 83.0]]), r"a: speed has shape \(1, 4\) for 4 samples"),
        (
            np.array([80.0, -1.0, 80.0, 80.0]),
            r"a: speed \(-1 rad/s at sample 1\) must be zero or a positive",
        ),
        (
            np.array([80.0, 80.0, 80.0, math.nan]),
            r"a: speed \(nan rad/s at sample 3\) must be zero or a positive",
        ),
    ],
)
def test_a_speed_that_does_not_fit_the_samples_is_refused(speed: np.ndarray, message: str) -> None:
    with pytest.raises(DataError, match=message):
        Samples.in_memory("a", np.zeros((3, 4)), speed)


@given(cuts=st.lists(st.integers(1, 11), max_size=4, unique=True))
def test_blocks_join_to_the_recording_they_were_cut_from(cuts: list[int]) -> None:
    whole = Recording(
        np.arange(24.0).reshape(2, 12), 8.0, "a", channels=("x", "y"), speed=np.arange(12.0)
    )
    edges = [0, *sorted(cuts), 12]
    blocks = [
        replace(
            whole, signal=whole.signal[:, first:last], speed=np.arange(first, last, dtype=float)
        )
        for first, last in pairwise(edges)
    ]
    together = join_blocks(iter(blocks))
    np.testing.assert_array_equal(together.signal, whole.signal)
    np.testing.assert_array_equal(together.speed, whole.speed)


@given(
    facts=st.lists(st.tuples(LABELS, SPECIMENS), max_size=8),
    label=LABELS,
    specimen=SPECIMENS,
    numbers=st.none() | st.lists(st.integers(0, 8)),
)
def test_where_meets_every_condition_and_leaves_out_nothing_that_does(
    facts: list[tuple[str | None, str | None]],
    label: str | None,
    specimen: str | None,
    numbers: list[int] | None,
) -> None:
    recordings = Recordings(make(str(number), *pair) for number, pair in enumerate(facts))
    ids = None if numbers is None else [str(number) for number in numbers]
    expected = tuple(
        str(number)
        for number, pair in enumerate(facts)
        if label in (None, pair[0])
        and specimen in (None, pair[1])
        and (numbers is None or number in numbers)
    )
    if expected:
        assert recordings.where(label=label, ids=ids, specimen=specimen).recording_ids == expected
        return
    with pytest.raises(DataError, match=r"^No recording has .*; there are ") as refusal:
        recordings.where(label=label, ids=ids, specimen=specimen)
    message = str(refusal.value)
    assert all(repr(value) in message for value in (label, specimen) if value is not None)
    assert label is None or all((name or "none") in message for name, _ in facts)


def test_samples_cannot_be_changed_behind_the_recordings_back() -> None:
    signal = np.ones((1, 8))
    recording = Recording(signal, 10.0, "a", channels=("x",), speed=np.full(8, 150.0))
    copy = recording.replace(label="worn")

    # Slices and copies share the samples, and their hashes are kept.
    with pytest.raises(ValueError, match="read-only"):
        recording.signal[0, 0] = 5.0
    assert recording.speed is not None
    with pytest.raises(ValueError, match="read-only"):
        recording.speed[0] = 0.0
    assert copy.signal[0, 0] == 1.0

    signal[0, 0] = 7.0  # the caller's own array stays writable, and is another one
    assert recording.signal[0, 0] == 1.0


def test_attributes_are_copied_from_the_callers_mapping() -> None:
    attributes = {"sensor": "A"}
    recording = Recording(np.ones((1, 8)), 10.0, "a", attributes=attributes)

    attributes["sensor"] = "B"

    assert recording.attributes == {"sensor": "A"}


def test_two_channels_of_one_name_are_refused() -> None:
    # The second could never be selected, and every table would show one of them twice.
    with pytest.raises(DataError, match="a: 2 channels are named 'x'"):
        Recording(np.ones((3, 8)), 10.0, "a", channels=("x", "y", "x"))
