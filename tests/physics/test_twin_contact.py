"""A twin whose slippers differ, lift off or rattle, and where a linear one leaves its range."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from swashtwin.foundation import InputError, mm
from swashtwin.physics import RK4, OperatingProfile, SensorPath, SlipperContact, Twin, accelerations, simulate_profile
from swashtwin.pump import Fault, LooseSlipper, OperatingCondition, Pump, SwashPlateDefect, TiltedBlockFace

RECESS = SwashPlateDefect(length=mm(30), width=mm(24), depth=mm(0.07))
LIFTING = SlipperContact(one_sided=True)


def rms(twin: Twin) -> np.ndarray:
    """Root mean square of each sensor's acceleration [m/s^2]."""
    return np.sqrt((twin.acceleration().abs().numpy() ** 2).sum(axis=1) / 2)


def test_a_healthy_pump_keeps_its_slippers_down_and_lifting_changes_nothing(
    pump: Pump, at_15: OperatingCondition
) -> None:
    healthy = Twin(pump, at_15, bandwidth=2500)
    lifting = replace(healthy, contact=LIFTING)
    assert healthy.contact_check().within_range
    assert healthy.notes() == ()
    lines = lifting.acceleration()[:, torch.as_tensor(healthy.orders - 1)]
    exact = healthy.acceleration()
    assert float((lines - exact).abs().max() / exact.abs().max()) < 3e-4


def test_the_slippers_carry_what_presses_the_pistons_and_the_spring(pump: Pump, at_15: OperatingCondition) -> None:
    """Equilibrium of retainer and slippers: N cos(gamma) = sum f + preload."""
    twin = Twin(pump, at_15)
    pressed = -float(twin.pressure[0, 12].real)
    upright = np.cos(pump.rotating_group.swash_angle)
    expected = (pressed + pump.coupling.spring_preload) / upright
    assert twin.contact_check().hold_down == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("depth", [0.07, 0.6])
@pytest.mark.parametrize("contact", [SlipperContact(), SlipperContact(unloaded=0.5), LIFTING])
def test_the_slippers_carry_as_much_over_a_recess(
    pump: Pump, at_15: OperatingCondition, depth: float, contact: SlipperContact
) -> None:
    recess = SwashPlateDefect(length=mm(30), width=mm(24), depth=mm(depth))
    healthy = Twin(pump, at_15).contact_check().hold_down
    load = Twin(pump, at_15, recess, contact=contact).slipper_forces().sum(axis=0).mean()
    assert load == pytest.approx(healthy, rel=0.01)


def test_a_linear_twin_says_where_it_pulls_at_its_slippers(pump: Pump, at_15: OperatingCondition) -> None:
    twin = Twin(pump, at_15, RECESS)
    (note,) = twin.notes()
    assert "the linear twin pulls at its slippers during" in note
    assert "SlipperContact(one_sided=True)" in note
    lifting = replace(twin, contact=LIFTING)
    assert lifting.notes() == ()
    assert lifting.slipper_forces().min() == 0
    assert rms(lifting)[0] > rms(twin)[0]


@pytest.mark.parametrize("contact", [LIFTING, SlipperContact(unloaded=0.4)], ids=["lifting", "differing"])
def test_gradients_pass_through_slippers_that_lift_or_differ(
    pump: Pump, at_15: OperatingCondition, contact: SlipperContact
) -> None:
    twin = Twin(pump, at_15, RECESS, bandwidth=1000, contact=contact)
    logs = twin.values.log().requires_grad_()

    def level(point: torch.Tensor) -> torch.Tensor:
        return twin.acceleration(point.exp()).abs().square().sum()

    (slope,) = torch.autograd.grad(level(logs), logs)
    for i in (0, 2, 4):
        shift = 1e-4 * torch.eye(6, dtype=torch.float64)[i]
        with torch.no_grad():
            difference = (level(logs + shift) - level(logs - shift)) / 2e-4
        assert float(slope[i]) == pytest.approx(float(difference), rel=1e-4, abs=1e-5)


def test_a_healthy_pump_has_the_gradients_of_the_linear_twin(pump: Pump, at_15: OperatingCondition) -> None:
    twin, slopes = Twin(pump, at_15, bandwidth=1000), []
    for candidate in (twin, replace(twin, contact=LIFTING)):
        values = candidate.values.requires_grad_()
        (slope,) = torch.autograd.grad(candidate.acceleration(values).abs().square().sum(), values)
        slopes.append(slope * values.detach())
    torch.testing.assert_close(slopes[1], slopes[0], rtol=2e-3, atol=2e-4 * float(slopes[0].abs().max()))


def test_a_loose_slipper_shows_once_a_revolution(pump: Pump, at_15: OperatingCondition) -> None:
    twin = Twin(pump, at_15, LooseSlipper(mm(0.2)))
    power = (twin.acceleration().abs().numpy() ** 2)[0]
    aside = twin.orders % 7 != 0
    assert 0.3 < power[aside].sum() / power.sum() < 0.6
    assert rms(twin)[0] > 1.2 * rms(Twin(pump, at_15))[0]
    tight = Twin(pump, at_15, LooseSlipper(0.0))
    np.testing.assert_allclose(rms(tight), rms(Twin(pump, at_15)), rtol=1e-6)


@pytest.mark.parametrize("fault", [None, RECESS, LooseSlipper(mm(0.1))], ids=["healthy", "recess", "loose"])
def test_twins_with_lifting_slippers_stand_in_a_batch_beside_linear_ones(
    pump: Pump, at_15: OperatingCondition, fault: Fault | None
) -> None:
    path = SensorPath((1.1, 1.0, 0.9), (1200.0,), (0.03,), ((0.1,), (-0.1,), (0.05,)))
    twins = [
        Twin(pump, at_15, fault, bandwidth=1000),
        Twin(pump, at_15, fault, bandwidth=1000, contact=LIFTING, path=path),
        Twin(pump, at_15, fault, bandwidth=1000, path=path),
    ]
    together = accelerations(twins)
    for row, twin in zip(together.lines, twins, strict=True):
        lines = row[:, torch.as_tensor(np.searchsorted(together.orders, twin.orders))]
        torch.testing.assert_close(lines, twin.acceleration(), rtol=1e-12, atol=1e-12)


def test_a_profile_is_read_with_the_gains_of_the_path_and_refuses_its_modes(
    pump: Pump, at_15: OperatingCondition
) -> None:
    profile, twin = OperatingProfile.steady(at_15, 0.3), Twin(pump, at_15, bandwidth=1000)
    louder = replace(twin, path=SensorPath((2.0, 1.0, 0.5)))
    signals = [simulate_profile(candidate, profile, 6400.0).signal for candidate in (twin, louder)]
    np.testing.assert_allclose(signals[1], signals[0] * np.array([[2.0], [1.0], [0.5]]), rtol=1e-9)
    bent = replace(twin, path=SensorPath((1.0,) * 3, (1000.0,), (0.03,), ((0.1,),) * 3))
    with pytest.raises(InputError, match="known for steady lines only"):
        simulate_profile(bent, profile, 6400.0)


def test_slippers_that_lift_off_are_marched_by_no_other_solver(pump: Pump, at_15: OperatingCondition) -> None:
    with pytest.raises(InputError, match="leave the solver at HarmonicBalance"):
        Twin(pump, at_15, contact=LIFTING).acceleration(solver=RK4(step=1e-3))


def test_a_sensor_path_bends_what_the_rigid_shell_does(pump: Pump, at_15: OperatingCondition) -> None:
    twin = Twin(pump, at_15, RECESS)
    path = SensorPath((2.0, 1.0, 1.0), (1204.0,), (0.03,), ((0.0,), (0.1,), (0.0,)))
    bent, rigid = (candidate.acceleration().abs().numpy() for candidate in (replace(twin, path=path), twin))
    np.testing.assert_allclose(bent[0], 2 * rigid[0])
    np.testing.assert_allclose(bent[2], rigid[2])
    near = int(np.argmin(np.abs(twin.orders * at_15.shaft_frequency - 1204)))
    assert bent[1, near] / rigid[1, near] == pytest.approx(np.hypot(1, 0.1 / 0.06), rel=0.03)


@pytest.mark.parametrize(
    ("changes", "message"),
    [({"residue": ((0.1,), (0.1,))}, "a residue for"), ({"gain": (1.0, -1.0, 1.0)}, "must be positive")],
)
def test_impossible_paths_are_refused(changes: dict, message: str) -> None:
    good = {"gain": (1.0, 1.0, 1.0), "frequency": (1e3,), "damping_ratio": (0.03,), "residue": ((0.1,),) * 3}
    with pytest.raises(InputError, match=message):
        SensorPath(**{**good, **changes})


def test_what_cannot_be_solved_together_is_refused(pump: Pump, at_15: OperatingCondition) -> None:
    with pytest.raises(InputError, match="TiltedBlockFace turns with the shaft"):
        Twin(pump, at_15, TiltedBlockFace(0.3), contact=LIFTING).acceleration()
    with pytest.raises(InputError, match="in steady state only"):
        simulate_profile(Twin(pump, at_15, contact=LIFTING), OperatingProfile.steady(at_15, 1.0), 25600.0)


def test_a_channel_reads_its_shares_of_the_others(pump: Pump, at_15: OperatingCondition) -> None:
    shares = ((0.0, 0.1, -0.2), (0.05, 0.0, 0.0), (0.0, 0.3, 0.0))
    plain = Twin(pump, at_15, bandwidth=1000)
    mixed = replace(plain, path=SensorPath((2.0, 1.0, 1.0), cross_talk=shares))
    lines = plain.acceleration().numpy()
    expected = np.array([2.0, 1.0, 1.0])[:, None] * (lines + np.array(shares) @ lines)
    np.testing.assert_allclose(mixed.acceleration().numpy(), expected, rtol=1e-12)
    with pytest.raises(InputError, match="a share for each pair"):
        SensorPath((1.0, 1.0), cross_talk=((0.0,), (0.0,)))
