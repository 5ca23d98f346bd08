"""Recordings check their facts, protect their samples, and are selected by their facts."""

import math
from collections.abc import Callable
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


def recording_named(
    name: str = "a", label: str | None = None, specimen: str | None = None
) -> Recording:
    signal = np.arange(12.0).reshape(3, 4)
    return Recording(signal, 8.0, name, channels=("x", "y", "z"), label=label, specimen=specimen)


# ---- channels


@given(names=st.permutations(["x", "y", "z"]), count=st.integers(1, 3))
def test_selected_channels_have_the_requested_order(names: list[str], count: int) -> None:
    recording = recording_named()

    selected = recording.select_channels(names[:count])

    assert selected.channels == tuple(names[:count])
    for name, row in zip(selected.channels, selected.signal, strict=True):
        np.testing.assert_array_equal(row, recording.signal[recording.channels.index(name)])


def test_a_channel_with_a_blank_name_is_called_by_its_number() -> None:
    recording = Recording(np.zeros((3, 4)), 8.0, "a", channels=("x", "", " "))

    assert recording.channels == ("x", "channel_1", "channel_2")


def test_two_channels_of_one_name_are_refused() -> None:
    # The second could never be selected, and every table would show one of them twice.
    with pytest.raises(DataError, match="a: 2 channels are named 'x'"):
        Recording(np.ones((3, 8)), 10.0, "a", channels=("x", "y", "x"))


# ---- samples


@pytest.mark.parametrize("shape", [(5,), (1, 0), (0, 5), (2, 3, 4)])
def test_a_signal_without_channels_or_samples_is_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(DataError, match=r"a: signal has shape .*; it must be \(channel, time\)"):
        Samples.in_memory("a", np.zeros(shape), None)


@pytest.mark.wrong_types
def test_masked_samples_are_missing() -> None:
    signal = np.ma.array(np.arange(8).reshape(2, 4), mask=False)
    signal.mask[1, 2] = True

    recording = Recording(signal, 10.0, "a", channels=("x", "y"))

    # a change of the array after that is none of the recording
    signal[0] = 100
    np.testing.assert_array_equal(recording.signal, [[0, 1, 2, 3], [4, 5, np.nan, 7]])


@pytest.mark.wrong_types
@pytest.mark.parametrize(
    "signal", [np.zeros((1, 4), complex), np.array([["a"]])], ids=["complex", "text"]
)
def test_samples_that_are_no_real_numbers_are_refused(signal: np.ndarray) -> None:
    with pytest.raises(DataError, match="a recording holds real numbers"):
        Recording(signal, 10.0, "a")


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


@pytest.mark.wrong_types
@pytest.mark.parametrize("stop", ["5", 2.5])
def test_a_slice_between_samples_is_refused(stop: Any) -> None:
    with pytest.raises(InputError, match="sample numbers must be integers, not 0 to"):
        recording_named().slice(0, stop)


# ---- facts


@pytest.mark.wrong_types
@pytest.mark.parametrize(
    ("facts", "message"),
    [
        pytest.param({"recording_id": ""}, r"needs .* and a recording_id", id="no id"),
        pytest.param(
            {"channels": ("x", "y")}, "a: 2 channel names for 1 channels", id="number of names"
        ),
        pytest.param({"sample_rate": 0.0}, r"a: sample_rate \(.* Hz\) must be", id="rate 0"),
        pytest.param({"sample_rate": -1.0}, r"a: sample_rate \(.* Hz\) must be", id="rate -1"),
        pytest.param({"sample_rate": math.nan}, r"a: sample_rate \(.* Hz\) must be", id="rate nan"),
        pytest.param({"sample_rate": math.inf}, r"a: sample_rate \(.* Hz\) must be", id="rate inf"),
        pytest.param(
            {"sample_rate": "25 kHz"},
            r"sample_rate \('25 kHz' Hz\) must be a positive number",
            id="rate as text",
        ),
        pytest.param({"label": 3}, r"label \(3\) must be text", id="label as number"),
        pytest.param({"speed": 80.0}, r"speed has shape \(\) for 4 samples", id="one speed"),
    ],
)
def test_an_invalid_fact_is_refused_by_its_name(facts: dict[str, Any], message: str) -> None:
    valid_facts = {"signal": np.zeros((1, 4)), "sample_rate": 10.0, "recording_id": "a"}

    with pytest.raises((DataError, InputError), match=message):
        Recording(**{**valid_facts, **facts})


@pytest.mark.parametrize(
    ("speed", "message"),
    [
        pytest.param(
            np.array([80.0, 81.0]), r"a: speed has shape \(2,\) for 4 samples", id="too short"
        ),
        pytest.param(
            np.array([[80.0, 81.0, 82.0, 83.0]]),
            r"a: speed has shape \(1, 4\) for 4 samples",
            id="matrix",
        ),
        pytest.param(
            np.array([80.0, -1.0, 80.0, 80.0]),
            r"a: speed \(-1 rad/s at sample 1\) must be zero or a positive",
            id="negative",
        ),
        pytest.param(
            np.array([80.0, 80.0, 80.0, math.nan]),
            r"a: speed \(nan rad/s at sample 3\) must be zero or a positive",
            id="missing",
        ),
    ],
)
def test_a_speed_that_does_not_fit_the_samples_is_refused(speed: np.ndarray, message: str) -> None:
    with pytest.raises(DataError, match=message):
        Samples.in_memory("a", np.zeros((3, 4)), speed)


# ---- blocks


@given(cuts=st.lists(st.integers(1, 11), max_size=4, unique=True))
def test_blocks_join_to_the_recording_they_were_cut_from(cuts: list[int]) -> None:
    signal = np.arange(24.0).reshape(2, 12)
    speed = np.arange(12.0)
    whole = Recording(signal, 8.0, "a", channels=("x", "y"), speed=speed)
    edges = [0, *sorted(cuts), 12]
    blocks = [
        replace(whole, signal=signal[:, start:stop], speed=speed[start:stop])
        for start, stop in pairwise(edges)
    ]

    joined = join_blocks(iter(blocks))

    np.testing.assert_array_equal(joined.signal, whole.signal)
    np.testing.assert_array_equal(joined.speed, whole.speed)


# ---- collections


@pytest.mark.wrong_types
def test_a_single_recording_is_no_collection() -> None:
    with pytest.raises(InputError, match="a is one recording, but several are expected"):
        Recordings(recording_named("a"))


@pytest.mark.wrong_types
def test_a_collection_of_file_names_is_refused() -> None:
    with pytest.raises(InputError, match="is not a recording"):
        Recordings(["a.csv"])


# Label and specimen of each recording of a collection.
FACTS = st.lists(st.tuples(LABELS, SPECIMENS), max_size=8)


@given(
    facts=FACTS,
    label=LABELS,
    specimen=SPECIMENS,
    numbers=st.none() | st.lists(st.integers(0, 8)),
)
def test_where_selects_exactly_the_recordings_that_meet_every_condition(
    facts: list[tuple[str | None, str | None]],
    label: str | None,
    specimen: str | None,
    numbers: list[int] | None,
) -> None:
    recordings = Recordings(
        recording_named(str(number), *labels) for number, labels in enumerate(facts)
    )
    ids = None if numbers is None else [str(number) for number in numbers]

    def select() -> Recordings:
        return recordings.where(label=label, ids=ids, specimen=specimen)

    expected_ids = tuple(
        str(number)
        for number, (its_label, its_specimen) in enumerate(facts)
        if label in (None, its_label)
        and specimen in (None, its_specimen)
        and (numbers is None or number in numbers)
    )
    if expected_ids:
        assert select().recording_ids == expected_ids
    else:
        assert_refusal_names_conditions(select, facts, label, specimen)


def assert_refusal_names_conditions(
    select: Callable[[], Recordings],
    facts: list[tuple[str | None, str | None]],
    label: str | None,
    specimen: str | None,
) -> None:
    """Check that a selection of nothing states what was required, and which labels there are."""
    with pytest.raises(DataError, match=r"^No recording has .*; there are ") as refusal:
        select()

    message = str(refusal.value)
    if specimen is not None:
        assert repr(specimen) in message
    if label is not None:
        assert repr(label) in message
        assert all((existing_label or "none") in message for existing_label, _ in facts)


@pytest.mark.wrong_types
def test_channels_of_different_lengths_are_refused_in_words() -> None:
    with pytest.raises(DataError, match="a: the channels of signal differ in length"):
        Recording([[1.0, 2.0], [3.0]], 10.0, "a", channels=("x", "y"))  # type: ignore[arg-type]
