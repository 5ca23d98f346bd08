"""Training for conditions that are new: every condition counts the same, pairs are mixed, features drawn together."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from swashtwin.foundation import DataError, InputError, MPa, rpm, stream
from swashtwin.learning import BiTCN, TrainingSettings, WindowSet, cut_windows, fit
from swashtwin.learning.training.domains import conditions_of, epoch_order, misalignment, mixing
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import Recording

BY_CONDITION = TrainingSettings(balance="condition")


@pytest.fixture(scope="module")
def windows() -> WindowSet:
    """Two classes at two pressures, of which one has nine times the windows."""
    recordings = []
    for pressure, turns in ((MPa(5), 900), (MPa(15), 100)):
        for number, label in enumerate(("normal", "piston")):
            condition = OperatingCondition(speed=rpm(6000), discharge_pressure=pressure)
            signal = stream(0, label, pressure).normal(size=(1, turns * 2)) * (1 + number)
            recordings.append(
                Recording(signal, 1000.0, f"{label} {pressure:g}", label=label, condition=condition, unit="m/s^2")
            )
    return cut_windows(recordings, length=20, classes=("normal", "piston"))


def test_each_speed_and_pressure_is_one_condition_where_they_are_asked_for(windows):
    condition = conditions_of(windows, BY_CONDITION)
    assert len({*zip(condition.tolist(), windows.discharge_pressure.tolist(), strict=True)}) == 2
    assert set(conditions_of(windows, TrainingSettings())) == {0}
    nowhere = replace(windows, speed=windows.speed * np.nan, discharge_pressure=windows.speed * np.nan)
    with pytest.raises(DataError, match="no condition"):
        conditions_of(nowhere, BY_CONDITION)


def test_a_balanced_epoch_draws_every_class_under_every_condition_alike(windows):
    condition = conditions_of(windows, BY_CONDITION)
    order = epoch_order(windows.target, condition, "condition", stream(0, "order"))
    assert len(order) == len(windows)
    counts = np.unique(np.column_stack([windows.target, condition])[order], axis=0, return_counts=True)[1]
    assert counts.min() > 0.75 * counts.max()
    plain = epoch_order(windows.target, condition, "none", stream(0, "order"))
    assert sorted(plain) == list(range(len(windows)))


def test_mixing_keeps_a_share_and_takes_each_window_once_as_a_partner():
    partner, share = mixing(7, 0.2, stream(0, "mix"))
    assert sorted(partner) == list(range(7))
    assert 0 <= share <= 1


@pytest.mark.parametrize("kind", ["coral", "mmd"])
def test_features_are_misaligned_where_a_condition_changes_them(kind):
    same = torch.as_tensor(stream(0, "features").normal(size=(400, 3)))
    condition = torch.arange(400) % 2
    spread = torch.where(condition[:, None] == 1, 3.0, 1.0) * same
    alike, distance = (float(misalignment(features, condition, kind)) for features in (same, spread))
    assert alike < 0.1 * distance
    assert float(misalignment(same, torch.zeros_like(condition), kind)) == 0


def test_the_covariances_misalignment_has_the_right_derivative():
    features = torch.as_tensor(stream(1, "features").normal(size=(8, 3))).requires_grad_()
    assert torch.autograd.gradcheck(lambda values: misalignment(values, torch.arange(8) % 2, "coral"), features)


@pytest.mark.parametrize(
    "changes", [{"balance": "condition"}, {"mixup": 0.2}, {"alignment": "coral"}, {"alignment": "mmd"}]
)
def test_each_remedy_trains_to_the_same_bits_twice_and_to_others_than_without(windows, changes):
    network = BiTCN(1, 2, channels=(4,), dilations=(1,), kernel_size=2)
    plain = TrainingSettings(epochs=2)
    settings = replace(plain, **changes)
    first, again, without = (fit(network, windows, settings=variant, seed=3) for variant in (settings, settings, plain))
    for weight, other in zip(first.network.parameters(), again.network.parameters(), strict=True):
        assert torch.equal(weight, other)
    pairs = zip(first.network.parameters(), without.network.parameters(), strict=True)
    assert any(not torch.equal(weight, other) for weight, other in pairs)
    assert first.settings == settings


@pytest.mark.parametrize("wrong", [{"balance": "all"}, {"alignment": "dann"}, {"mixup": -1.0}])
def test_a_remedy_that_does_not_exist_is_refused(wrong):
    with pytest.raises(InputError, match=next(iter(wrong))):
        TrainingSettings(**wrong)
