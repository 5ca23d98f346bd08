"""Test, validation and training share no recording, and only training has synthetic windows."""

from dataclasses import replace

import numpy as np
import pytest

from swashtwin.foundation import InputError, LeakError, MPa, rpm
from swashtwin.learning import WindowSet, cut_windows, prepare_training_data
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import Recording

CLASSES = ("normal", "piston")


def cut_rig(recordings_per_class: int) -> WindowSet:
    condition = OperatingCondition(speed=rpm(1200), discharge_pressure=MPa(10))
    rng = np.random.default_rng(0)
    recordings = []
    for label in CLASSES:
        for number in range(recordings_per_class):
            signal = rng.normal(size=(1, 600))
            name = f"{label}-{number}"
            recordings.append(Recording(signal, 1000.0, name, label=label, condition=condition))

    return cut_windows(recordings, length=100)


def make_synthetic(measured: WindowSet, *, label: str, made_from: dict[str, tuple[str, ...]]):
    copies = measured.subset(np.arange(4))
    return replace(
        copies,
        signal=copies.signal + 1,
        classes=(label,),
        target=np.zeros(4, dtype=np.int64),
        recording_id=np.array([f"synthetic-{number}" for number in range(4)]),
        synthetic=np.ones(4, dtype=np.bool_),
        manifest=made_from,
        content={},
    )


def recording_names(windows: WindowSet) -> set[str]:
    return set(windows.recording_id.tolist())


def test_no_recording_stands_in_two_of_the_three_sets():
    measured = cut_rig(12)
    data = prepare_training_data(measured, test_fraction=0.2, validation_fraction=0.4)

    assert data.validation is not None

    sets = [recording_names(part) for part in (data.training, data.test, data.validation)]
    assert sum(map(len, sets)) == len(set.union(*sets)) == 24
    assert data.test_recordings == tuple(sorted(sets[1]))
    assert data.validation_recordings == tuple(sorted(sets[2]))


def test_without_fractions_everything_is_trained_on():
    measured = cut_rig(2)
    data = prepare_training_data(measured)

    assert len(data.training) == len(measured)
    assert (len(data.test), data.validation, data.error_rate) == (0, None, 0.1)
    assert data.test_recordings == data.validation_recordings == data.notes == ()


def test_synthetic_windows_join_the_training_set_with_their_class():
    measured = cut_rig(12)
    synthetic = make_synthetic(measured, label="valve_plate", made_from={"normal-0": ()})
    data = prepare_training_data(measured, [synthetic], validation_fraction=0.4)

    assert data.validation is not None
    assert data.training.classes == data.validation.classes == (*CLASSES, "valve_plate")
    assert data.training.synthetic.sum() == 4
    assert "normal-0" in recording_names(data.training)


def test_a_test_recording_that_synthetic_windows_were_made_from_is_refused():
    measured = cut_rig(6)
    everything = dict.fromkeys(recording_names(measured), ())
    synthetic = make_synthetic(measured, label="piston", made_from=everything)

    with pytest.raises(LeakError, match="had a part in the synthetic windows"):
        prepare_training_data(measured, [synthetic], test_fraction=0.2)


def test_too_few_validation_recordings_lower_a_default_rate_and_refuse_a_requested_one():
    measured = cut_rig(5)
    data = prepare_training_data(measured, validation_fraction=0.3)

    assert data.error_rate > 0.1
    assert data.notes[0].startswith("An error rate of 0.1 needs 9 validation recordings")
    with pytest.raises(InputError, match="needs 9 validation recordings"):
        prepare_training_data(measured, validation_fraction=0.3, error_rate=0.1)


def test_a_duplicate_recording_is_reported():
    measured = cut_rig(3)
    is_first = measured.recording_id == "normal-0"
    names = np.where(is_first, "normal-9", measured.recording_id)
    renamed = {"normal-9": measured.content["normal-0"]}
    duplicate = replace(measured, recording_id=names, content=renamed).subset(is_first)
    (note,) = prepare_training_data(measured + duplicate).notes

    assert "normal-9 holds samples of the same measurement as normal-0" in note
