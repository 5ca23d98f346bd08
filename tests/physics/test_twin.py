"""The twin against the levels that physics.md quotes, its solvers against each other, its
gradients, its refusals.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from swashtwin.foundation import InputError, deg, mm, um
from swashtwin.physics import RK4, Scales, SensorPath, Twin
from swashtwin.pump import (
    BoreDefect,
    DamScratch,
    GrooveErosion,
    Interfaces,
    LooseSlipper,
    OperatingCondition,
    PistonWear,
    Pump,
    SealingLandScratch,
    SwashPlateDefect,
    TiltedBlockFace,
    ValvePlateWear,
)

RECESS = {"depth": mm(0.6), "length": mm(30), "width": mm(24)}
WIDE = 10034.0
"""The band of the levels in physics.md: 700 shaft orders."""


def rms(lines: np.ndarray) -> np.ndarray:
    return np.sqrt(0.5 * np.sum(np.abs(lines) ** 2, axis=-1))


def lines_of(twin: Twin) -> np.ndarray:
    return twin.acceleration().detach().numpy()


def off_piston_pass(twin: Twin) -> np.ndarray:
    """Share of the energy that lies off the multiples of the piston-pass frequency."""
    energy = np.abs(lines_of(twin)) ** 2
    return energy[:, twin.orders % 7 != 0].sum(axis=1) / energy.sum(axis=1)


@pytest.mark.parametrize(
    ("topology", "fault", "expected"),
    [
        ("T1", None, (1.41, 1.78, 0.02)),
        ("T2", None, (1.36, 1.34, 0.01)),
        ("T1", SwashPlateDefect(**RECESS, off_axis=False), (6.57, 2.49, 0.02)),
        ("T1", SwashPlateDefect(**RECESS), (6.57, 2.49, 1.34)),
        ("T1", SwashPlateDefect(**RECESS, contact="literal", off_axis=False), (49.37, 11.99, 0.02)),
        ("T1", SwashPlateDefect(**RECESS, contact="physical"), (1.39, 1.76, 0.02)),
        ("T2", SwashPlateDefect(**RECESS, off_axis=False), (16.71, 4.99, 0.01)),
        ("T2", SwashPlateDefect(**RECESS), (16.71, 4.99, 11.53)),
        ("T1", PistonWear(um(60)), (1.38, 1.83, 0.02)),
        ("T1", SealingLandScratch(2.5e-12), (1.38, 1.83, 0.02)),
        ("T1", DamScratch(1e-6), (1.22, 1.51, 0.02)),
        ("T1", GrooveErosion(deg(6)), (1.33, 1.31, 0.01)),
        ("T1", BoreDefect(um(300)), (1.37, 1.76, 0.02)),
    ],
)
def test_levels_are_those_of_the_reference_model(
    pump: Pump, at_15: OperatingCondition, topology: str, fault: object, expected: tuple[float, ...]
) -> None:
    twin = Twin(pump, at_15, fault, topology=topology, bandwidth=WIDE)  # type: ignore[arg-type]
    np.testing.assert_allclose(rms(lines_of(twin)), expected, rtol=0.01, atol=0.006)


def test_the_identified_dampings_of_the_paper_change_the_levels_as_in_the_reference(
    pump: Pump, at_15: OperatingCondition
) -> None:
    interfaces = Interfaces.from_values([0.778e6, 1e8, 6e4, 1.2e8, 15.3e4, 5e7])
    twin = Twin(pump, at_15, SwashPlateDefect(**RECESS), interfaces, bandwidth=WIDE)
    np.testing.assert_allclose(rms(lines_of(twin)), (10.84, 3.47, 4.77), rtol=0.01)


@pytest.mark.parametrize(
    ("fault", "share"),
    [
        (PistonWear(um(60)), 0.0339),
        (BoreDefect(um(300)), 0.0466),
        (SealingLandScratch(2.5e-12), 0.0322),
    ],
)
def test_one_bad_piston_puts_energy_off_the_piston_pass_lines(
    pump: Pump, at_15: OperatingCondition, fault: object, share: float
) -> None:
    twin = Twin(pump, at_15, fault, bandwidth=WIDE)  # type: ignore[arg-type]
    assert off_piston_pass(twin)[0] == pytest.approx(share, rel=0.03)


def test_a_tilted_block_face_adds_sidebands_one_shaft_order_from_the_piston_pass_lines(
    pump: Pump, at_15: OperatingCondition
) -> None:
    healthy = Twin(pump, at_15, bandwidth=1000)
    tilted = healthy.with_fault(TiltedBlockFace(0.2))
    level = dict(zip(tilted.orders.tolist(), np.abs(lines_of(tilted)[1]), strict=True))
    for sideband, beyond in ((41, 40), (43, 44)):
        assert level[sideband] > 20 * level[beyond]
        assert level[sideband] > 1e-3 * level[42]
    barely = healthy.with_fault(TiltedBlockFace(1e-9))
    at = np.isin(barely.orders, healthy.orders)
    np.testing.assert_allclose(lines_of(barely)[:, at], lines_of(healthy), rtol=1e-5, atol=1e-9)


def test_rk4_in_steady_state_is_harmonic_balance(pump: Pump, at_15: OperatingCondition) -> None:
    """To 1e-7 up to 1 kHz; at 5 kHz RK4's own phase error shows (step 0.5 us)."""
    twin = Twin(pump, at_15, SwashPlateDefect(**RECESS), bandwidth=1000)
    exact, stepped = lines_of(twin), twin.acceleration(solver=RK4(step=2e-7)).detach().numpy()
    assert np.abs(stepped - exact).max() < 1e-7 * np.abs(exact).max()


@pytest.mark.parametrize(
    ("fault", "topology"),
    [
        (SwashPlateDefect(**RECESS), "T1"),
        (SwashPlateDefect(**RECESS), "T2"),
        (SwashPlateDefect(**RECESS, contact="physical"), "T1"),
        (BoreDefect(um(300)), "T1"),
        (ValvePlateWear(um(5)), "T1"),
        (TiltedBlockFace(0.2), "T1"),
    ],
)
def test_acceleration_has_exact_gradients(
    pump: Pump, at_15: OperatingCondition, fault: object, topology: str
) -> None:
    bandwidth = 120 if isinstance(fault, TiltedBlockFace) else 300
    twin = Twin(pump, at_15, fault, bandwidth=bandwidth, topology=topology)  # type: ignore[arg-type]
    scale = twin.values

    def read(relative: torch.Tensor, scales: torch.Tensor) -> torch.Tensor:
        return torch.view_as_real(twin.acceleration(relative * scale, scales=scales))

    relative = torch.ones(6, dtype=torch.float64, requires_grad=True)
    scales = torch.ones(11, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(read, (relative, scales))


def test_a_simulation_has_the_lines_it_was_made_of(pump: Pump, at_15: OperatingCondition) -> None:
    twin = Twin(pump, at_15, SwashPlateDefect(**RECESS))
    period = 1024
    recording = twin.simulate(4 * at_15.period, period / at_15.period)
    assert (recording.label, recording.synthetic, recording.channels) == (
        "swash_plate",
        True,
        pump.channels,
    )
    spectrum = np.fft.rfft(recording.signal, axis=1) * 2 / recording.signal.shape[1]
    np.testing.assert_allclose(spectrum[:, 4 * twin.orders], lines_of(twin), atol=2e-2)


def test_scales_act_on_what_they_name(pump: Pump, at_15: OperatingCondition) -> None:
    twin = Twin(pump, at_15, SwashPlateDefect(**RECESS))
    louder = Twin(pump, at_15, SwashPlateDefect(**RECESS), scales=Scales(sensor=2.0))
    np.testing.assert_allclose(lines_of(louder), 2 * lines_of(twin))
    deeper = Twin(pump, at_15, SwashPlateDefect(depth=mm(1.2), length=mm(30), width=mm(24)))
    stronger = Twin(pump, at_15, SwashPlateDefect(**RECESS), scales=Scales(excitation=2.0))
    np.testing.assert_allclose(lines_of(stronger), lines_of(deeper))


def test_the_fourth_piston_pass_line_is_the_tallest_of_the_cover(
    pump: Pump, at_15: OperatingCondition
) -> None:
    twin = Twin(pump, at_15)
    strongest = twin.orders[np.abs(lines_of(twin)[0]).argmax()]
    assert strongest * at_15.shaft_frequency == pytest.approx(401, abs=1)
    assert math.isclose(abs(lines_of(twin)[0, twin.orders == 28][0]), 1.251, rel_tol=0.01)


@pytest.mark.parametrize("topology", ["T1", "T2"])
@pytest.mark.parametrize(
    "fault", [None, SwashPlateDefect(**RECESS), PistonWear(um(60)), LooseSlipper(mm(0.2))]
)
def test_single_precision_is_off_by_ten_thousandths_of_the_largest_line(
    pump: Pump, at_15: OperatingCondition, fault: object, topology: str
) -> None:
    twin = Twin(pump, at_15, fault, topology=topology)  # type: ignore[arg-type]
    values = twin.values * torch.tensor([[0.5], [1.0], [2.0]], dtype=torch.float64)
    exact, single = twin.acceleration(values), twin.acceleration(values.float())
    assert single.dtype == torch.complex64
    error = (single - exact).abs().amax(dim=(1, 2)) / exact.abs().amax(dim=(1, 2))
    assert 1e-7 < float(error.max()) < 3e-4


@pytest.mark.parametrize(
    ("values", "scales", "name"),
    [
        ({1: -1e8}, {}, r"slipper_swash.stiffness \(-1e\+08\)"),
        ({0: 0.0, 5: -1.0}, {}, r"slipper_swash.damping \(0\)"),
        ({}, {1: -0.5}, r"scales.bearing \(-0.5\)"),
    ],
)
def test_a_spring_that_would_push_is_refused_by_name(
    pump: Pump,
    at_15: OperatingCondition,
    values: dict[int, float],
    scales: dict[int, float],
    name: str,
) -> None:
    twin = Twin(pump, at_15)
    batch, factors = (
        twin.values.repeat(3, 1),
        torch.ones(3, len(Scales().values()), dtype=torch.float64),
    )
    for index, value in values.items():
        batch[2, index] = value
    for index, value in scales.items():
        factors[1, index] = value
    with pytest.raises(InputError, match=name + " must be positive"):
        twin.acceleration(batch.requires_grad_(), scales=factors)


def test_a_twin_says_where_a_slipper_bridges_its_defect(
    pump: Pump, at_15: OperatingCondition
) -> None:
    slipper = pump.rotating_group.slipper_diameter
    narrow = SwashPlateDefect(depth=mm(0.6), length=mm(30), width=slipper / 2)
    note = Twin(pump, at_15, narrow).notes()[0]
    assert "smaller than a slipper" in note
    assert "depth of 0.6 mm counts as 0.15 mm" in note
    assert "extrapolation" in note
    for fault in (None, SwashPlateDefect(**RECESS), replace(narrow, depth=0.0), PistonWear(um(60))):
        assert not any(
            "smaller than a slipper" in note for note in Twin(pump, at_15, fault).notes()
        )


def test_a_sensor_path_bends_what_the_rigid_shell_does(
    pump: Pump, at_15: OperatingCondition
) -> None:
    twin = Twin(pump, at_15, SwashPlateDefect(mm(0.07), mm(30), mm(24)))
    path = SensorPath((2.0, 1.0, 1.0), (1204.0,), (0.03,), ((0.0,), (0.1,), (0.0,)))
    bent, rigid = (
        candidate.acceleration().abs().numpy() for candidate in (replace(twin, path=path), twin)
    )
    np.testing.assert_allclose(bent[0], 2 * rigid[0])
    np.testing.assert_allclose(bent[2], rigid[2])
    near = int(np.argmin(np.abs(twin.orders * at_15.shaft_frequency - 1204)))
    assert bent[1, near] / rigid[1, near] == pytest.approx(np.hypot(1, 0.1 / 0.06), rel=0.03)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"residue": ((0.1,), (0.1,))}, "a residue for"),
        ({"gain": (1.0, -1.0, 1.0)}, "must be positive"),
    ],
)
def test_impossible_paths_are_refused(changes: dict, message: str) -> None:
    good = {
        "gain": (1.0, 1.0, 1.0),
        "frequency": (1e3,),
        "damping_ratio": (0.03,),
        "residue": ((0.1,),) * 3,
    }
    with pytest.raises(InputError, match=message):
        SensorPath(**{**good, **changes})


def test_a_channel_reads_its_shares_of_the_others(pump: Pump, at_15: OperatingCondition) -> None:
    shares = ((0.0, 0.1, -0.2), (0.05, 0.0, 0.0), (0.0, 0.3, 0.0))
    plain = Twin(pump, at_15, bandwidth=1000)
    mixed = replace(plain, path=SensorPath((2.0, 1.0, 1.0), cross_talk=shares))
    lines = plain.acceleration().numpy()
    expected = np.array([2.0, 1.0, 1.0])[:, None] * (lines + np.array(shares) @ lines)
    np.testing.assert_allclose(mixed.acceleration().numpy(), expected, rtol=1e-12)
    with pytest.raises(InputError, match="a share for each pair"):
        SensorPath((1.0, 1.0), cross_talk=((0.0,), (0.0,)))
