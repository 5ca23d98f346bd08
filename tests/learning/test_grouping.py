"""Splits and folds keep whole what they are told to: a condition, a machine, or whatever was written down."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swashtwin.foundation import DataError, InputError, MPa, rpm
from swashtwin.learning import check_recordings, cut_windows, group_folds, split_by_recording, without_overlap
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import Recording, recording_groups

CLASSES = ("normal", "leak")


def recording(name: str, label: str = "normal", samples: int = 400, **facts) -> Recording:
    noise = np.random.default_rng(list(name.encode())).normal(size=(1, samples))
    return Recording(noise, 1000.0, name, label=label, **facts)


def rows(values: list[str], name: str = "day") -> list[Recording]:
    return [
        recording(f"{label}-{value}-{index}", label, attributes={name: value})
        for label in CLASSES
        for value in values
        for index in range(2)
    ]


@settings(deadline=None, max_examples=25)
@given(st.integers(2, 4), st.integers(0, 50), st.integers(20, 60))
def test_folds_share_no_group_where_windows_overlap(n_folds, seed, stride):
    recordings = rows(["mon", "tue", "wed", "thu"])
    windows = cut_windows(recordings, length=60, stride=stride)
    groups = recording_groups(recordings, "day")
    folds = group_folds(windows, group=groups, n_folds=n_folds, seed=seed)
    for trained, tested in folds:
        sides = [{groups[name] for name in windows.recording_id[side].tolist()} for side in (trained, tested)]
        assert not sides[0] & sides[1]
        assert len(trained) + len(tested) == len(windows)
    assert sorted(np.concatenate([tested for _, tested in folds]).tolist()) == list(range(len(windows)))
    assert len(folds) == n_folds


def test_a_fold_that_leaves_nothing_of_a_class_to_train_on_is_refused_with_the_group():
    recordings = [*rows(["mon", "tue"]), recording("odd", "crack", attributes={"day": "wed"})]
    windows = cut_windows(recordings, length=100)
    with pytest.raises(DataError, match="wed held out nothing of class crack"):
        group_folds(windows, group=recording_groups(recordings, "day"), n_folds=3)


def test_more_folds_than_groups_and_one_group_are_refused():
    recordings = rows(["mon", "tue"])
    windows = cut_windows(recordings, length=100)
    with pytest.raises(InputError, match=r"n_folds \(3\) must be 2 to 2"):
        group_folds(windows, group=recording_groups(recordings, "day"), n_folds=3)


def test_a_condition_is_a_speed_and_a_pressure_where_stated_and_close_speeds_are_one():
    speeds = ["700 rpm", "714 rpm", "703 rpm", "1003 rpm", "1000 rpm", "105 rad/s"]
    recordings = [recording(f"r{number}", attributes={"speed": speed}) for number, speed in enumerate(speeds)]
    groups = recording_groups(recordings, "condition")
    assert groups["r0"] == groups["r1"] == groups["r2"] == "705.7 rev/min"
    assert groups["r3"] == groups["r4"] == groups["r5"] != groups["r0"]
    point = OperatingCondition(rpm(1500), MPa(15))
    assert recording_groups([recording("both", condition=point)], "condition") == {"both": "1500 rev/min, 15 MPa"}


def test_windows_carry_the_speed_that_only_an_attribute_states_and_split_by_it():
    recordings = rows(["700 rpm", "1000 rpm", "1200 rpm"], "speed")
    windows = cut_windows(recordings, length=100)
    assert set(np.round(windows.speed * 30 / math.pi).tolist()) == {700, 1000, 1200}
    train, test = split_by_recording(windows, group="condition", test_fraction=0.34)
    assert not set(train.speed.tolist()) & set(test.speed.tolist())


def test_conditions_that_nobody_or_only_some_wrote_down_are_refused_by_name():
    silent = [recording("a"), recording("b")]
    with pytest.raises(DataError, match=r"a has no condition written down \(no speed"):
        recording_groups(silent, "condition")
    with pytest.raises(DataError, match=r"a states no speed and c does"):
        recording_groups([*silent, recording("c", attributes={"speed": "700 rpm"})], "condition")


def test_an_attribute_nobody_has_is_refused_and_the_nearest_offered():
    with pytest.raises(InputError, match=r"attribute 'dya'; did you mean 'day'"):
        recording_groups(rows(["mon", "tue"]), "dya")
    with pytest.raises(DataError, match=r"bare has no day written down"):
        recording_groups([*rows(["mon"]), recording("bare")], "day")
    with pytest.raises(DataError, match=r"a has no group written down"):
        split_by_recording(cut_windows([recording("a"), recording("b", "leak")], length=100), group={"b": "x"})


@given(st.integers(5, 70))
def test_thinned_windows_do_not_overlap_and_none_could_be_added(stride):
    windows = cut_windows([recording("a"), recording("b", "leak")], length=50, stride=stride)
    thinned = without_overlap(windows)
    for name in ("a", "b"):
        start = thinned.start[thinned.recording_id == name]
        assert (np.diff(start) >= 50).all()
        assert (np.diff(start) < 50 + stride).all()
        assert start[0] == 0


@pytest.mark.parametrize("ring", ["ab ab", "ab cd", "ab ac", "ab bc ca", "a b", "ab b"])
def test_a_check_and_a_split_agree_on_whether_machines_can_be_held_out(ring: str) -> None:
    recordings = [
        recording(f"{label}-{name}-{number}", label, specimen=name)
        for label, names in zip(("normal", "leak", "wear"), ring.split(), strict=False)
        for name in names
        for number in range(2)
    ]
    (use,) = [use for use in check_recordings(recordings, window=60).uses if "specimens" in use.name]
    windows = cut_windows(recordings, length=60)
    try:
        split_by_recording(windows, group=recording_groups(recordings, "specimen"))
    except DataError:
        assert use.state == "no"
    else:
        assert use.state == "yes"
