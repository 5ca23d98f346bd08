"""Windows keep their recording's facts, and no split puts one recording on both sides."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swashtwin.foundation import DataError, InputError, LeakError, MPa, rpm
from swashtwin.learning import WindowSet, check_disjoint, cut_windows, split_by_recording
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import Recording

CLASSES = ("normal", "swash_plate", "piston")


def recording(
    name: str, label: str | None = "normal", *, pressure: float = 15, samples: int = 1000, **facts
) -> Recording:
    noise = np.random.default_rng(list(name.encode())).normal(size=(1, samples))
    condition = OperatingCondition(speed=rpm(860), discharge_pressure=MPa(pressure))
    return Recording(noise, 1000.0, name, label=label, **{"condition": condition, **facts})


def rig(*, per_cell: int = 3, pressures: tuple[float, ...] = (5, 10, 15)) -> list[Recording]:
    return [
        recording(f"{label}-{pressure}-{index}", label, pressure=pressure, specimen=f"pump-{index}")
        for label in CLASSES
        for pressure in pressures
        for index in range(per_cell)
    ]


def ids(windows: WindowSet) -> set[str]:
    return set(windows.recording_id.tolist())


def test_a_window_holds_the_readings_from_its_start_on():
    source = recording("a")
    windows = cut_windows([source], length=100, stride=30)
    assert windows.start.tolist() == list(range(0, 901, 30))
    for window, start in zip(windows.signal, windows.start, strict=True):
        np.testing.assert_array_equal(window, source.signal[:, start : start + 100].astype(np.float32))


def test_windows_carry_label_specimen_condition_and_origin():
    created = recording("b", "piston", pressure=5, specimen="pump-2", synthetic=True)
    windows = cut_windows([recording("a"), created], length=500)
    assert windows.label.tolist() == ["normal", "normal", "piston", "piston"]
    assert windows.specimen.tolist() == ["", "", "pump-2", "pump-2"]
    assert windows.discharge_pressure.tolist() == [15e6, 15e6, 5e6, 5e6]
    assert windows.synthetic.tolist() == [False, False, True, True]
    unknown = cut_windows([recording("a", None, condition=None)], length=500)
    assert (unknown.classes, unknown.target.tolist(), unknown.label.tolist()) == ((), [-1, -1], ["", ""])
    assert np.isnan(unknown.speed).all()
    np.testing.assert_allclose(windows.turns_per_sample * windows.length, 0.5 * 860 / 60)


def test_classes_are_sorted_unless_their_order_is_given():
    recordings = [recording("a", "swash_plate"), recording("b", "normal")]
    assert cut_windows(recordings, length=500).classes == ("normal", "swash_plate")
    ordered = cut_windows(recordings, length=500, classes=["swash_plate", "normal"])
    assert ordered.classes == ("swash_plate", "normal")
    assert ordered.target.tolist() == [0, 0, 1, 1]


def test_an_unknown_label_is_refused_and_the_nearest_class_offered():
    with pytest.raises(InputError, match=r"'swashplate'.*Did you mean 'swash_plate'"):
        cut_windows([recording("a", "swashplate")], length=500, classes=CLASSES)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"sample_rate": 2000.0}, ("1000 Hz", "2000 Hz")),
        ({"channels": ("velocity",)}, ("acceleration", "velocity")),
        ({"unit": "g"}, ("m/s\\^2", "g")),
    ],
)
def test_recordings_that_do_not_fit_together_are_refused_with_both_names_and_values(change, words):
    other = replace(recording("b"), **change)
    with pytest.raises(DataError, match=r"differ \({}: a \(.*; {}: b \(".format(*words)):
        cut_windows([recording("a"), other], length=200)
    with pytest.raises(InputError, match="{} against {}".format(*words)):
        cut_windows([recording("a")], length=200) + cut_windows([other], length=200)


def test_a_recording_too_short_for_one_window_is_named():
    with pytest.raises(DataError, match=r"short has 150 samples .* one window of 200"):
        cut_windows([recording("a"), recording("short", samples=150)], length=200)


def test_a_window_shorter_than_one_revolution_needs_permission_and_the_least_length_is_told():
    with pytest.raises(InputError, match="take length 70 or more"):
        cut_windows([recording("a")], length=69)
    assert cut_windows([recording("a")], length=70).length == 70
    assert cut_windows([recording("a")], length=69, allow_partial_revolution=True).length == 69
    assert cut_windows([recording("a", condition=None)], length=69).length == 69


def test_unfit_recordings_one_id_twice_and_no_recording_are_refused():
    with pytest.raises(DataError, match="dead"):
        cut_windows([replace(recording("dead"), signal=np.ones((1, 1000)))], length=200)
    with pytest.raises(InputError, match="two recordings have the id 'a'"):
        cut_windows([recording("a"), recording("a")], length=200)
    with pytest.raises(DataError, match="no recording"):
        cut_windows([], length=200)


@pytest.mark.parametrize("sizes", [{"length": 1}, {"length": 100, "stride": 0}])
def test_lengths_that_cannot_be_are_refused(sizes):
    with pytest.raises(InputError):
        cut_windows([recording("a")], **sizes)


def test_counts_show_empty_cells():
    recordings = [recording("a", "normal", pressure=5), recording("b", "piston", pressure=15)]
    assert cut_windows(recordings, length=500).counts() == {
        ("normal", 5e6): 2,
        ("normal", 15e6): 0,
        ("piston", 5e6): 0,
        ("piston", 15e6): 2,
    }


def test_sets_of_other_classes_or_layout_do_not_add():
    normal = cut_windows([recording("a")], length=200)
    with pytest.raises(InputError, match="cut the second like the first"):
        normal + cut_windows([recording("b", "piston")], length=200)
    with pytest.raises(InputError, match="length 200 against 250"):
        normal + cut_windows([recording("b")], length=250)


def test_the_fingerprint_changes_with_one_reading_and_with_one_label():
    windows = cut_windows(rig(), length=200)
    louder, relabeled = windows.signal.copy(), windows.target.copy()
    louder[3, 0, 7] += 1
    relabeled[0] = 2
    prints = {w.fingerprint() for w in (windows, replace(windows, signal=louder), replace(windows, target=relabeled))}
    assert len(prints) == 3
    assert windows.fingerprint() == cut_windows(rig(), length=200).fingerprint()


@settings(max_examples=25, deadline=None)
@given(
    sizes=st.lists(st.tuples(st.integers(2, 6), st.integers(1, 4)), min_size=2, max_size=4),
    fraction=st.floats(0.05, 0.5),
    seed=st.integers(0, 1000),
    stride=st.sampled_from([10, 25, 50]),
)
def test_a_split_shares_no_recording_and_keeps_every_class_on_both_sides(sizes, fraction, seed, stride):
    recordings = [
        recording(f"c{label}-{index}", f"class {label}", samples=100 * length, pressure=5 * (1 + index % 3))
        for label, (count, length) in enumerate(sizes)
        for index in range(count)
    ]
    windows = cut_windows(recordings, length=100, stride=stride)
    train, test = split_by_recording(windows, test_fraction=fraction, seed=seed)
    assert not ids(train) & ids(test)
    assert ids(train) | ids(test) == ids(windows)
    assert len(train) + len(test) == len(windows)
    assert set(train.target.tolist()) == set(test.target.tolist()) == set(range(len(sizes)))
    check_disjoint(train, test)


def test_with_recordings_enough_a_fifth_is_tested_and_every_cell_stands_on_both_sides():
    windows = cut_windows(rig(per_cell=5), length=100)
    train, test = split_by_recording(windows, test_fraction=0.2, seed=1)
    assert len(test) / len(windows) == pytest.approx(0.2, abs=0.03)
    assert all(test.counts().values())
    assert all(train.counts().values())


def test_the_same_seed_draws_the_same_split_and_another_seed_another():
    windows = cut_windows(rig(per_cell=5), length=100)
    draws = [ids(split_by_recording(windows, seed=seed)[1]) for seed in (0, 0, 1, 2)]
    assert draws[0] == draws[1]
    assert not draws[0] == draws[2] == draws[3]


@pytest.mark.parametrize(("group", "fact"), [("specimen", "specimen"), ("condition", "discharge_pressure")])
def test_a_split_by_group_keeps_each_group_whole(group, fact):
    train, test = split_by_recording(cut_windows(rig(), length=100), group=group)
    assert not set(getattr(train, fact).tolist()) & set(getattr(test, fact).tolist())


def test_a_class_of_one_recording_cannot_be_split_and_is_named():
    windows = cut_windows([*rig(), recording("only", "valve_plate")], length=100)
    with pytest.raises(DataError, match=r"valve_plate has windows of 1 recording.*name the recordings of the test"):
        split_by_recording(windows)


def test_a_split_refuses_synthetic_and_unlabeled_windows_and_unknown_groups():
    with pytest.raises(LeakError, match="made"):
        split_by_recording(cut_windows([*rig(), recording("made", synthetic=True)], length=100))
    with pytest.raises(DataError, match="mute has no label"):
        split_by_recording(cut_windows([*rig(), recording("mute", None)], length=100))
    with pytest.raises(DataError, match="nowhere has no specimen"):
        split_by_recording(cut_windows([*rig(), recording("nowhere")], length=100), group="specimen")
    with pytest.raises(InputError, match="'window' is none of"):
        split_by_recording(cut_windows(rig(), length=100), group="window")
    with pytest.raises(InputError, match="test_fraction"):
        split_by_recording(cut_windows(rig(), length=100), test_fraction=20.0)


def test_recordings_kept_in_training_are_never_tested_on_and_the_rest_is_split():
    windows = cut_windows(rig(), length=100)
    training_ids = [f"{label}-5-{index}" for label in CLASSES for index in range(3)]
    train, test = split_by_recording(windows, keep_in_training=[*training_ids, "elsewhere"])
    assert set(training_ids) <= ids(train)
    assert ids(train) | ids(test) == ids(windows)
    assert not ids(train) & ids(test)
    assert {name.split("-")[0] for name in ids(test)} == set(CLASSES)
    with pytest.raises(DataError, match=r"normal has windows of 0 recording.s. without a part in synthetic ones"):
        split_by_recording(windows, keep_in_training=ids(windows))


def test_a_leak_is_named():
    first, second = cut_windows([recording("a")], length=100), cut_windows([recording("b")], length=100)
    check_disjoint(first, second)
    with pytest.raises(LeakError, match="recording a stands in training and in test"):
        check_disjoint(first + second, first)
    copied = cut_windows([replace(recording("a"), recording_id="a copy")], length=100)
    with pytest.raises(
        LeakError,
        match="recording a copy, which holds the samples of a, as they are or altered",
    ):
        check_disjoint(first + second, copied)
    part = cut_windows([Recording(recording("a").signal[:, 200:], 1000.0, "a part", label="normal")], length=100)
    with pytest.raises(LeakError, match="a part holds a window of training recording a"):
        check_disjoint(first + second, part)
    with pytest.raises(LeakError, match="b is synthetic"):
        check_disjoint(first, cut_windows([recording("b", synthetic=True)], length=100))
