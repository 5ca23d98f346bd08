"""Windows keep the facts of their recording; splits and folds keep each group on one side."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swashtwin.foundation import DataError, InputError, LeakError, MPa, rpm
from swashtwin.learning import (
    WindowSet,
    check_disjoint,
    check_recordings,
    cut_windows,
    group_folds,
    split_by_recording,
    without_overlap,
)
from swashtwin.learning.windows.splitting import fold_training_rows, is_made_without
from swashtwin.learning.windows.window_set import operating_points
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import Recording, recording_groups

CLASSES = ("normal", "swash_plate", "piston")


def recording(
    name: str,
    label: str | None = "normal",
    *,
    pressure: float = 15,
    samples: int = 1000,
    **facts,
) -> Recording:
    # seeded by the name, so that only recordings of one name are copies
    noise = np.random.default_rng(list(name.encode())).normal(size=(1, samples))
    condition = OperatingCondition(speed=rpm(860), discharge_pressure=MPa(pressure))
    return Recording(noise, 1000.0, name, label=label, **{"condition": condition, **facts})


def rig(*, per_cell: int = 3, pressures: tuple[float, ...] = (5, 10, 15)) -> list[Recording]:
    recordings = []
    for label, pressure, index in itertools.product(CLASSES, pressures, range(per_cell)):
        name = f"{label}-{pressure}-{index}"
        specimen = f"pump-{index}"
        recordings.append(recording(name, label, pressure=pressure, specimen=specimen))

    return recordings


def ids(windows: WindowSet) -> set[str]:
    return set(windows.recording_id.tolist())


def test_a_window_holds_the_samples_from_its_start():
    source = recording("a")
    windows = cut_windows([source], length=100, stride=30)

    assert windows.start.tolist() == list(range(0, 901, 30))
    for window, start in zip(windows.signal, windows.start, strict=True):
        expected = source.signal[:, start : start + 100].astype(np.float32)
        np.testing.assert_array_equal(window, expected)


def test_windows_carry_label_specimen_condition_and_origin():
    created = recording("b", "piston", pressure=5, specimen="pump-2", synthetic=True)
    windows = cut_windows([recording("a"), created], length=500)

    assert windows.label.tolist() == ["normal", "normal", "piston", "piston"]
    assert windows.specimen.tolist() == ["", "", "pump-2", "pump-2"]
    assert windows.discharge_pressure.tolist() == [15e6, 15e6, 5e6, 5e6]
    assert windows.synthetic.tolist() == [False, False, True, True]

    unknown = cut_windows([recording("a", None, condition=None)], length=500)
    assert unknown.classes == ()
    assert unknown.target.tolist() == [-1, -1]
    assert unknown.label.tolist() == ["", ""]
    assert np.isnan(unknown.speed).all()
    np.testing.assert_allclose(windows.turns_per_sample * windows.length, 0.5 * 860 / 60)


def test_an_unknown_label_is_refused_and_the_nearest_class_offered():
    with pytest.raises(InputError, match=r"'swashplate'.*Did you mean 'swash_plate'"):
        cut_windows([recording("a", "swashplate")], length=500, classes=CLASSES)


@pytest.mark.parametrize(
    ("change", "values"),
    [
        ({"sample_rate": 2000.0}, ("1000 Hz", "2000 Hz")),
        ({"channels": ("velocity",)}, ("acceleration", "velocity")),
        ({"unit": "g"}, ("m/s\\^2", "g")),
    ],
)
def test_recordings_of_different_layouts_are_refused_with_both_names_and_values(change, values):
    changed = replace(recording("b"), **change)
    with pytest.raises(DataError, match=r"differ \({}: a \(.*; {}: b \(".format(*values)):
        cut_windows([recording("a"), changed], length=200)
    with pytest.raises(InputError, match="{} against {}".format(*values)):
        cut_windows([recording("a")], length=200) + cut_windows([changed], length=200)


def test_a_recording_too_short_for_one_window_is_named():
    with pytest.raises(DataError, match=r"short has 150 samples .* one window of 200"):
        cut_windows([recording("a"), recording("short", samples=150)], length=200)


def test_a_window_shorter_than_a_revolution_is_refused_with_the_minimum_length_unless_allowed():
    # a revolution at 860 rev/min lasts 69.8 samples at 1 kHz
    with pytest.raises(InputError, match="use a window of 70 or more"):
        cut_windows([recording("a")], length=69)
    with pytest.raises(InputError, match="it has only 60 samples: record longer"):
        cut_windows([recording("a", samples=60)], length=50)
    assert cut_windows([recording("a")], length=70).length == 70
    assert cut_windows([recording("a")], length=69, allow_partial_revolution=True).length == 69
    assert cut_windows([recording("a", condition=None)], length=69).length == 69


def test_a_dead_channel_a_duplicate_id_and_no_recording_are_refused():
    with pytest.raises(DataError, match="dead"):
        cut_windows([replace(recording("dead"), signal=np.ones((1, 1000)))], length=200)
    with pytest.raises(InputError, match="Two recordings have the id 'a'"):
        cut_windows([recording("a"), recording("a")], length=200)
    with pytest.raises(DataError, match="no recording"):
        cut_windows([], length=200)


@pytest.mark.parametrize("sizes", [{"length": 1}, {"length": 100, "stride": 0}])
def test_invalid_lengths_are_refused(sizes):
    with pytest.raises(InputError):
        cut_windows([recording("a")], **sizes)


def test_windows_are_taken_by_number_slice_and_mask_and_as_an_array():
    windows = cut_windows(rig(per_cell=1), length=128)

    third = windows[3]
    assert (len(third), third.start[0]) == (1, windows.start[3])
    assert windows[-2:].start.tolist() == windows.start[-2:].tolist()
    assert ids(windows[windows.label == "piston"]) == ids(windows.subset(windows.target == 1))
    assert len(list(windows)) == len(windows)
    with pytest.raises(IndexError):
        windows[len(windows)]
    np.testing.assert_array_equal(np.asarray(windows), windows.signal)


def test_sets_of_other_classes_or_layout_do_not_add():
    normal = cut_windows([recording("a")], length=200)
    with pytest.raises(InputError, match="Cut the second like the first"):
        normal + cut_windows([recording("b", "piston")], length=200)
    with pytest.raises(InputError, match="length 200 against 250"):
        normal + cut_windows([recording("b")], length=250)


def test_the_fingerprint_changes_with_one_sample_and_with_one_label():
    windows = cut_windows(rig(), length=200)
    louder = windows.signal.copy()
    relabeled = windows.target.copy()
    louder[3, 0, 7] += 1
    relabeled[0] = 2
    changed = [replace(windows, signal=louder), replace(windows, target=relabeled)]

    assert len({part.fingerprint() for part in (windows, *changed)}) == 3
    assert windows.fingerprint() == cut_windows(rig(), length=200).fingerprint()


@settings(max_examples=25, deadline=None)
@given(
    sizes=st.lists(st.tuples(st.integers(2, 6), st.integers(1, 4)), min_size=2, max_size=4),
    fraction=st.floats(0.05, 0.5),
    seed=st.integers(0, 1000),
    stride=st.sampled_from([10, 25, 50]),
)
def test_a_split_shares_no_recording_and_keeps_every_class_on_both_sides(
    sizes, fraction, seed, stride
):
    recordings = []
    for label, (count, length) in enumerate(sizes):
        for index in range(count):
            facts = {"samples": 100 * length, "pressure": 5 * (1 + index % 3)}
            recordings.append(recording(f"c{label}-{index}", f"class {label}", **facts))

    windows = cut_windows(recordings, length=100, stride=stride)
    train, test = split_by_recording(windows, test_fraction=fraction, seed=seed)

    assert not ids(train) & ids(test)
    assert ids(train) | ids(test) == ids(windows)
    assert len(train) + len(test) == len(windows)
    assert set(train.target.tolist()) == set(test.target.tolist()) == set(range(len(sizes)))

    check_disjoint(train, test)


def test_with_enough_recordings_a_fifth_is_tested_and_every_cell_is_on_both_sides():
    windows = cut_windows(rig(per_cell=5), length=100)
    train, test = split_by_recording(windows, test_fraction=0.2, seed=1)

    assert len(test) / len(windows) == pytest.approx(0.2, abs=0.03)
    assert all(test.counts().values())
    assert all(train.counts().values())


def test_a_class_of_one_recording_cannot_be_split_and_is_named():
    windows = cut_windows([*rig(), recording("only", "valve_plate")], length=100)
    message = r"valve_plate has windows of 1 recording.*name the recordings of the test"
    with pytest.raises(DataError, match=message):
        split_by_recording(windows)


def test_a_split_refuses_synthetic_and_unlabeled_windows_and_unknown_groups():
    with pytest.raises(LeakError, match="made"):
        split_by_recording(cut_windows([*rig(), recording("made", synthetic=True)], length=100))
    with pytest.raises(DataError, match="mute has no label"):
        split_by_recording(cut_windows([*rig(), recording("mute", None)], length=100))

    without_specimen = cut_windows([*rig(), recording("nowhere")], length=100)
    with pytest.raises(DataError, match="nowhere specifies no specimen"):
        split_by_recording(without_specimen, group="specimen")
    with pytest.raises(InputError, match="Invalid group 'window'"):
        split_by_recording(cut_windows(rig(), length=100), group="window")
    with pytest.raises(InputError, match="test_fraction"):
        split_by_recording(cut_windows(rig(), length=100), test_fraction=20.0)


def test_recordings_kept_in_training_are_never_tested_and_the_remaining_ones_are_split():
    windows = cut_windows(rig(), length=100)
    training_ids = [f"{label}-5-{index}" for label in CLASSES for index in range(3)]
    train, test = split_by_recording(windows, keep_in_training=[*training_ids, "elsewhere"])

    assert set(training_ids) <= ids(train)
    assert ids(train) | ids(test) == ids(windows)
    assert not ids(train) & ids(test)
    assert {name.split("-")[0] for name in ids(test)} == set(CLASSES)

    message = r"normal has windows of 0 recording.s. without a part in synthetic ones"
    with pytest.raises(DataError, match=message):
        split_by_recording(windows, keep_in_training=ids(windows))


def test_a_leak_is_named():
    first = cut_windows([recording("a")], length=100)
    second = cut_windows([recording("b")], length=100)
    check_disjoint(first, second)

    with pytest.raises(LeakError, match="recording a is in training and in test"):
        check_disjoint(first + second, first)

    copied = cut_windows([replace(recording("a"), recording_id="a copy")], length=100)
    with pytest.raises(
        LeakError,
        match="recording a copy, of the same measurement as a",
    ):
        check_disjoint(first + second, copied)

    later_samples = recording("a").signal[:, 200:400]
    part = cut_windows([Recording(later_samples, 1000.0, "a part", label="normal")], length=100)
    with pytest.raises(LeakError, match="a part holds a window of the training recording a"):
        check_disjoint(first + second, part)
    with pytest.raises(LeakError, match="b is synthetic"):
        check_disjoint(first, cut_windows([recording("b", synthetic=True)], length=100))


def without_condition(name: str, label: str = "normal", samples: int = 400, **facts) -> Recording:
    return recording(name, label, samples=samples, **{"condition": None, **facts})


def recordings_with_attribute(values: list[str], name: str = "day") -> list[Recording]:
    return [
        without_condition(f"{label}-{value}-{index}", label, attributes={name: value})
        for label, value, index in itertools.product(("normal", "leak"), values, range(2))
    ]


@settings(deadline=None, max_examples=25)
@given(st.integers(2, 4), st.integers(0, 50), st.integers(20, 60))
def test_folds_share_no_group_if_windows_overlap(n_folds, seed, stride):
    recordings = recordings_with_attribute(["mon", "tue", "wed", "thu"])
    windows = cut_windows(recordings, length=60, stride=stride)
    groups = recording_groups(recordings, "day")
    folds = group_folds(windows, group=groups, n_folds=n_folds, seed=seed)

    for trained, tested in folds:
        trained_groups = {groups[name] for name in windows.recording_id[trained].tolist()}
        tested_groups = {groups[name] for name in windows.recording_id[tested].tolist()}

        assert not trained_groups & tested_groups
        assert len(trained) + len(tested) == len(windows)

    assert len(folds) == n_folds
    all_tested = np.concatenate([tested for _, tested in folds])
    assert sorted(all_tested.tolist()) == list(range(len(windows)))


def test_a_fold_that_leaves_nothing_of_a_class_to_train_on_is_refused_with_the_group():
    recordings = [
        *recordings_with_attribute(["mon", "tue"]),
        without_condition("odd", "crack", attributes={"day": "wed"}),
    ]
    windows = cut_windows(recordings, length=100)

    with pytest.raises(DataError, match="wed held out, nothing of the class crack"):
        group_folds(windows, group=recording_groups(recordings, "day"), n_folds=3)


def test_more_folds_than_groups_and_one_group_are_refused():
    recordings = recordings_with_attribute(["mon", "tue"])
    windows = cut_windows(recordings, length=100)

    with pytest.raises(InputError, match=r"n_folds \(3\) must be 2 to 2"):
        group_folds(windows, group=recording_groups(recordings, "day"), n_folds=3)


def test_a_condition_is_speed_and_pressure_if_specified_and_close_speeds_are_the_same():
    speeds = ["700 rpm", "714 rpm", "703 rpm", "1003 rpm", "1000 rpm", "105 rad/s"]
    recordings = [
        without_condition(f"r{number}", attributes={"speed": speed})
        for number, speed in enumerate(speeds)
    ]
    groups = recording_groups(recordings, "condition")

    assert groups["r0"] == groups["r1"] == groups["r2"] == "705.7 rev/min"
    assert groups["r3"] == groups["r4"] == groups["r5"] != groups["r0"]

    point = OperatingCondition(rpm(1500), MPa(15))
    assert recording_groups([without_condition("both", condition=point)], "condition") == {
        "both": "1500 rev/min, 15 MPa"
    }


def test_close_speeds_and_pressures_are_one_operating_point():
    condition = np.array(
        [[90.0, 15e6], [90.5, 15.1e6], [150.0, 15e6], [90.0, 10e6], [150.5, 15.05e6]]
    )
    points, index = operating_points(condition)

    assert len(points) == 3
    assert index[0] == index[1]
    assert index[2] == index[4]
    np.testing.assert_allclose(points[index], condition, rtol=0.01)


def test_windows_have_the_speed_of_an_attribute_and_are_split_by_it():
    recordings = recordings_with_attribute(["700 rpm", "1000 rpm", "1200 rpm"], "speed")
    windows = cut_windows(recordings, length=100)

    assert set(np.round(windows.speed * 30 / math.pi).tolist()) == {700, 1000, 1200}

    train, test = split_by_recording(windows, group="condition", test_fraction=0.34)
    assert not set(train.speed.tolist()) & set(test.speed.tolist())


def test_conditions_that_not_all_recordings_specify_are_refused_by_name():
    silent = [without_condition("a"), without_condition("b")]
    with pytest.raises(DataError, match=r"a specifies no operating point \(no speed"):
        recording_groups(silent, "condition")
    with pytest.raises(DataError, match=r"a specifies no speed and c does"):
        recording_groups(
            [*silent, without_condition("c", attributes={"speed": "700 rpm"})],
            "condition",
        )


def test_an_attribute_that_no_recording_has_is_refused_and_the_nearest_offered():
    with pytest.raises(InputError, match=r"attribute 'dya'; did you mean 'day'"):
        recording_groups(recordings_with_attribute(["mon", "tue"]), "dya")
    with pytest.raises(DataError, match=r"bare specifies no day"):
        recording_groups([*recordings_with_attribute(["mon"]), without_condition("bare")], "day")
    with pytest.raises(DataError, match=r"a specifies no group"):
        split_by_recording(
            cut_windows([without_condition("a"), without_condition("b", "leak")], length=100),
            group={"b": "x"},
        )


def test_folds_depend_on_the_seed_alone():
    windows = cut_windows(rig(), length=100)

    def tested_ids(seed: int) -> list[set[str]]:
        folds = group_folds(windows, n_folds=3, seed=seed)
        return [set(windows.recording_id[tested].tolist()) for _, tested in folds]

    assert tested_ids(0) == tested_ids(0)
    assert tested_ids(0) != tested_ids(1)


FOLD_ROWS = [
    # class, specimen, synthetic, trained on if the recordings of A are tested
    (0, "A", False, False),
    (0, "B", False, True),
    (1, "A", False, False),
    (1, "B", False, True),
    (0, "twin of A", True, False),
    (0, "twin of B", True, True),
    (0, "twin of 25scy14-1b", True, True),
    (1, "copies of A", True, False),
    (1, "A", True, False),
    (1, "copies of B", True, True),
    # nobody recorded this class: no tested row is of it
    (2, "twin of A", True, True),
]


def test_a_fold_trains_on_other_machines_and_on_what_was_made_without_the_tested_ones():
    target, specimen, synthetic, is_trained = map(np.array, zip(*FOLD_ROWS, strict=True))
    tested = np.flatnonzero((specimen == "A") & ~synthetic)

    trained = fold_training_rows(target, specimen, synthetic, tested)

    assert trained.tolist() == np.flatnonzero(is_trained).tolist()


def test_a_twin_of_a_machine_that_is_trained_on_too_is_kept_and_copies_of_it_are_not():
    specimens = np.array(["twin of A", "copies of A", "A", "copies of BA"])
    tested = np.array(["A", ""])

    assert is_made_without(specimens, trained=np.array(["A"]), tested=tested).tolist() == [
        *(True, False, False, True)
    ]
    # windows without a machine are of no machine that something is made from
    nameless = np.array(["copies of ", ""])
    assert is_made_without(nameless, trained=np.array(["A"]), tested=tested).all()


@given(st.integers(5, 70))
def test_thinned_windows_do_not_overlap_and_no_other_could_be_added(stride):
    windows = cut_windows(
        [without_condition("a"), without_condition("b", "leak")],
        length=50,
        stride=stride,
    )
    thinned = without_overlap(windows)
    for name in ("a", "b"):
        start = thinned.start[thinned.recording_id == name]
        assert (np.diff(start) >= 50).all()
        assert (np.diff(start) < 50 + stride).all()
        assert start[0] == 0


@pytest.mark.parametrize("ring", ["ab ab", "ab cd", "ab ac", "ab bc ca", "a b", "ab b"])
def test_a_check_and_a_split_agree_on_whether_machines_can_be_held_out(
    ring: str,
) -> None:
    # each word lists the machines of one class
    recordings = []
    for label, machines in zip(("normal", "leak", "wear"), ring.split(), strict=False):
        for machine, number in itertools.product(machines, range(2)):
            recordings.append(
                without_condition(f"{label}-{machine}-{number}", label, specimen=machine)
            )

    uses = check_recordings(recordings, window=60).uses
    (use,) = [use for use in uses if "specimens" in use.name]
    windows = cut_windows(recordings, length=60)

    try:
        split_by_recording(windows, group=recording_groups(recordings, "specimen"))
    except DataError:
        assert use.state == "no"
    else:
        assert use.state == "yes"
