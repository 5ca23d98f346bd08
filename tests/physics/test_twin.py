"""The twin: levels that physics.md quotes, solvers against each other, gradients, and errors."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from swashtwin.foundation import InputError, deg, mm, um
from swashtwin.physics import RK4, Scales, SensorPath, Twin
from swashtwin.physics.dynamics import Topology
from swashtwin.pump import (
    BoreDefect,
    DamScratch,
    Fault,
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

RECESS = SwashPlateDefect(depth=mm(0.6), length=mm(30), width=mm(24))
NARROW_RECESS = replace(RECESS, width=mm(11))
"""Half as wide as a slipper."""
WIDE_BANDWIDTH_HZ = 10034.0
"""The band of the levels in physics.md: 700 shaft orders."""


def fault_name(parameter: object) -> str | None:
    """Id of a fault in a test's name; other parameters keep pytest's."""
    if isinstance(parameter, SwashPlateDefect):
        return f"{parameter.contact} recess" + ("" if parameter.off_axis else " on the axis")
    return type(parameter).__name__ if isinstance(parameter, Fault) else None


def rms(lines: np.ndarray) -> np.ndarray:
    return np.sqrt(0.5 * np.sum(np.abs(lines) ** 2, axis=-1))


def lines_of(twin: Twin) -> np.ndarray:
    return twin.acceleration().detach().numpy()


def off_piston_pass(twin: Twin) -> np.ndarray:
    """Share of the energy that lies off the multiples of the piston-pass frequency."""
    energy = np.abs(lines_of(twin)) ** 2
    return energy[:, twin.orders % 7 != 0].sum(axis=1) / energy.sum(axis=1)


@pytest.mark.parametrize(
    ("topology", "fault", "expected"),  # rms of each channel [m/s^2]
    [
        ("T1", None, (1.39, 1.77, 0.02)),
        ("T2", None, (1.35, 1.33, 0.01)),
        ("T1", replace(RECESS, off_axis=False), (6.57, 2.48, 0.02)),
        ("T1", RECESS, (6.57, 2.48, 1.34)),
        ("T1", replace(RECESS, contact="literal", off_axis=False), (49.38, 11.98, 0.02)),
        ("T1", replace(RECESS, contact="physical"), (1.37, 1.74, 0.02)),
        ("T2", replace(RECESS, off_axis=False), (16.71, 4.99, 0.01)),
        ("T2", RECESS, (16.71, 4.99, 11.53)),
        ("T1", PistonWear(um(60)), (1.38, 1.83, 0.02)),
        ("T1", SealingLandScratch(2.5e-12), (1.37, 1.82, 0.02)),
        ("T1", DamScratch(1e-6), (1.26, 1.56, 0.02)),
        ("T1", GrooveErosion(deg(6)), (1.32, 1.29, 0.01)),
        ("T1", BoreDefect(um(300)), (1.35, 1.74, 0.02)),
    ],
    ids=fault_name,
)
def test_levels_are_those_of_the_reference_model(
    pump: Pump,
    at_15: OperatingCondition,
    topology: Topology,
    fault: Fault | None,
    expected: tuple[float, ...],
) -> None:
    twin = Twin(pump, at_15, fault, topology=topology, bandwidth=WIDE_BANDWIDTH_HZ)
    np.testing.assert_allclose(rms(lines_of(twin)), expected, rtol=0.01, atol=0.006)


def test_the_identified_dampings_of_the_paper_change_the_levels_as_in_the_reference(
    pump: Pump, at_15: OperatingCondition
) -> None:
    interfaces = Interfaces.from_values([0.778e6, 1e8, 6e4, 1.2e8, 15.3e4, 5e7])
    twin = Twin(pump, at_15, RECESS, interfaces, bandwidth=WIDE_BANDWIDTH_HZ)
    np.testing.assert_allclose(rms(lines_of(twin)), (10.84, 3.46, 4.78), rtol=0.01)


@pytest.mark.parametrize(
    ("fault", "share"),
    [
        (PistonWear(um(60)), 0.0422),
        (BoreDefect(um(300)), 0.0476),
        (SealingLandScratch(2.5e-12), 0.0338),
    ],
    ids=fault_name,
)
def test_one_bad_piston_puts_energy_off_the_piston_pass_lines(
    pump: Pump, at_15: OperatingCondition, fault: Fault | None, share: float
) -> None:
    twin = Twin(pump, at_15, fault, bandwidth=WIDE_BANDWIDTH_HZ)
    assert off_piston_pass(twin)[0] == pytest.approx(share, rel=0.03)


def test_a_tilted_block_face_adds_sidebands_one_shaft_order_from_the_piston_pass_lines(
    pump: Pump, at_15: OperatingCondition
) -> None:
    tilted = Twin(pump, at_15, TiltedBlockFace(0.2), bandwidth=1000)
    amplitudes = np.abs(lines_of(tilted)[1])
    amplitude = dict(zip(tilted.orders.tolist(), amplitudes, strict=True))

    # beside the sixth piston-pass line, 42: neighbors, and the orders beyond them
    for sideband, beyond in ((41, 40), (43, 44)):
        assert amplitude[sideband] > 20 * amplitude[beyond]
        assert amplitude[sideband] > 1e-3 * amplitude[42]


def test_a_tilt_that_vanishes_leaves_the_healthy_lines(
    pump: Pump, at_15: OperatingCondition
) -> None:
    healthy = Twin(pump, at_15, bandwidth=1000)
    barely_tilted = healthy.with_fault(TiltedBlockFace(1e-9))
    has_healthy_line = np.isin(barely_tilted.orders, healthy.orders)
    lines = lines_of(barely_tilted)[:, has_healthy_line]
    np.testing.assert_allclose(lines, lines_of(healthy), rtol=1e-5, atol=1e-9)


def test_rk4_in_steady_state_is_harmonic_balance(pump: Pump, at_15: OperatingCondition) -> None:
    # up to 1 kHz; at 5 kHz the phase error of RK4 shows (step 0.5 us)
    twin = Twin(pump, at_15, RECESS, bandwidth=1000)
    exact = lines_of(twin)
    stepped = twin.acceleration(solver=RK4(step=2e-7)).detach().numpy()
    assert np.abs(stepped - exact).max() < 1e-7 * np.abs(exact).max()


@pytest.mark.parametrize(
    ("fault", "topology"),
    [
        (RECESS, "T1"),
        (RECESS, "T2"),
        (replace(RECESS, contact="physical"), "T1"),
        (BoreDefect(um(300)), "T1"),
        (ValvePlateWear(um(5)), "T1"),
        (TiltedBlockFace(0.2), "T1"),
    ],
    ids=fault_name,
)
def test_acceleration_has_exact_gradients(
    pump: Pump, at_15: OperatingCondition, fault: Fault | None, topology: Topology
) -> None:
    # a tilted face couples all orders, which takes long
    bandwidth = 120 if isinstance(fault, TiltedBlockFace) else 300
    twin = Twin(pump, at_15, fault, bandwidth=bandwidth, topology=topology)
    nominal_values = twin.values

    def lines(factors: torch.Tensor, scales: torch.Tensor) -> torch.Tensor:
        return torch.view_as_real(twin.acceleration(factors * nominal_values, scales=scales))

    factors = torch.ones(6, dtype=torch.float64, requires_grad=True)
    scales = torch.ones(11, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lines, (factors, scales))


def test_a_simulation_contains_the_lines_of_its_twin(pump: Pump, at_15: OperatingCondition) -> None:
    twin = Twin(pump, at_15, RECESS)
    samples_per_revolution = 1024
    recording = twin.simulate(4 * at_15.period, samples_per_revolution / at_15.period)

    spectrum = np.fft.rfft(recording.signal, axis=1) * 2 / recording.signal.shape[1]
    np.testing.assert_allclose(spectrum[:, 4 * twin.orders], lines_of(twin), atol=2e-2)


def test_a_simulation_is_labeled_as_a_synthetic_recording_of_its_fault(
    pump: Pump, at_15: OperatingCondition
) -> None:
    twin = Twin(pump, at_15, RECESS)
    recording = twin.simulate(4 * at_15.period, 1024 / at_15.period)
    assert recording.label == "swash_plate"
    assert recording.synthetic is True
    assert recording.channels == pump.channels


def test_the_scale_of_the_sensors_multiplies_their_lines(
    pump: Pump, at_15: OperatingCondition
) -> None:
    twin = Twin(pump, at_15, RECESS)
    louder = replace(twin, scales=Scales(sensor=2.0))
    np.testing.assert_allclose(lines_of(louder), 2 * lines_of(twin))


def test_the_scale_of_the_excitation_acts_as_a_deeper_recess(
    pump: Pump, at_15: OperatingCondition
) -> None:
    stronger = Twin(pump, at_15, RECESS, scales=Scales(excitation=2.0))
    deeper = Twin(pump, at_15, replace(RECESS, depth=mm(1.2)))
    np.testing.assert_allclose(lines_of(stronger), lines_of(deeper))


def test_the_fourth_piston_pass_line_is_the_tallest_of_the_cover(
    pump: Pump, at_15: OperatingCondition
) -> None:
    # physics.md 4: 401 Hz lies on the axial mode
    twin = Twin(pump, at_15)
    cover = np.abs(lines_of(twin)[0])
    tallest_order = twin.orders[cover.argmax()]
    assert tallest_order * at_15.shaft_frequency == pytest.approx(401, abs=1)
    assert math.isclose(cover[twin.orders == 28][0], 1.239, rel_tol=0.005)


@pytest.mark.parametrize("topology", ["T1", "T2"])
@pytest.mark.parametrize(
    "fault", [None, RECESS, PistonWear(um(60)), LooseSlipper(mm(0.2))], ids=fault_name
)
def test_single_precision_differs_by_ten_thousandths_of_the_largest_line(
    pump: Pump, at_15: OperatingCondition, fault: Fault | None, topology: str
) -> None:
    twin = Twin(pump, at_15, fault, topology=topology)
    values = twin.values * torch.tensor([[0.5], [1.0], [2.0]], dtype=torch.float64)
    exact = twin.acceleration(values)
    single = twin.acceleration(values.float())

    assert single.dtype == torch.complex64
    # of each set of values; not exact either, or the precision would not be single
    error = (single - exact).abs().amax(dim=(1, 2)) / exact.abs().amax(dim=(1, 2))
    assert 1e-7 < float(error.max()) < 3e-4


@pytest.mark.parametrize(
    ("values", "scales", "name"),
    [
        ({1: -1e8}, {}, r"slipper_swash.stiffness \(-1e\+08\)"),
        ({0: 0.0, 5: -1.0}, {}, r"slipper_swash.damping \(0\)"),
        ({}, {1: -0.5}, r"scales.bearing \(-0.5\)"),
    ],
    ids=["stiffness", "first of two dampings and stiffnesses", "scale"],
)
def test_values_and_scales_that_are_not_positive_are_refused_by_name(
    pump: Pump,
    at_15: OperatingCondition,
    values: dict[int, float],
    scales: dict[int, float],
    name: str,
) -> None:
    twin = Twin(pump, at_15)
    batch = twin.values.repeat(3, 1)
    factors = torch.ones(3, len(Scales().values()), dtype=torch.float64)
    for index, value in values.items():
        batch[2, index] = value
    for index, value in scales.items():
        factors[1, index] = value

    with pytest.raises(InputError, match=name + " must be positive"):
        twin.acceleration(batch.requires_grad_(), scales=factors)


def test_a_twin_reports_that_slippers_bridge_a_narrow_recess(
    pump: Pump, at_15: OperatingCondition
) -> None:
    note = Twin(pump, at_15, NARROW_RECESS).notes()[0]
    assert "smaller than a slipper" in note
    # d min(1, w/a)^2
    assert "depth of 0.6 mm counts as 0.15 mm" in note
    assert "extrapolation" in note


@pytest.mark.parametrize(
    "fault",
    [None, RECESS, replace(NARROW_RECESS, depth=0.0), PistonWear(um(60))],
    ids=["healthy", "wide recess", "no depth", "other fault"],
)
def test_a_twin_reports_no_bridging_without_a_narrow_recess(
    pump: Pump, at_15: OperatingCondition, fault: Fault | None
) -> None:
    notes = Twin(pump, at_15, fault).notes()
    assert not any("smaller than a slipper" in note for note in notes)


def test_a_sensor_path_multiplies_the_lines_by_gain_and_housing_modes(
    pump: Pump, at_15: OperatingCondition
) -> None:
    rigid = Twin(pump, at_15, replace(RECESS, depth=mm(0.07)))
    path = SensorPath(
        gain=(2.0, 1.0, 1.0),
        frequency=(1204.0,),
        damping_ratio=(0.03,),
        residue=((0.0,), (0.1,), (0.0,)),
    )
    lines = np.abs(lines_of(rigid))
    bent_lines = np.abs(lines_of(replace(rigid, path=path)))

    np.testing.assert_allclose(bent_lines[0], 2 * lines[0])
    np.testing.assert_allclose(bent_lines[2], lines[2])

    # at resonance, in quadrature: the residue over twice the damping ratio
    resonance = np.argmin(np.abs(rigid.orders * at_15.shaft_frequency - 1204))
    amplification = bent_lines[1, resonance] / lines[1, resonance]
    assert amplification == pytest.approx(np.hypot(1, 0.1 / 0.06), rel=0.03)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"residue": ((0.1,), (0.1,))}, "a residue for"),
        ({"gain": (1.0, -1.0, 1.0)}, "must be positive"),
    ],
    ids=["two residues for three channels", "negative gain"],
)
def test_impossible_sensor_paths_are_refused(changes: dict, message: str) -> None:
    valid = SensorPath(
        gain=(1.0, 1.0, 1.0),
        frequency=(1e3,),
        damping_ratio=(0.03,),
        residue=((0.1,),) * 3,
    )
    with pytest.raises(InputError, match=message):
        replace(valid, **changes)


def test_crosstalk_adds_shares_of_the_rigid_channels_before_the_gain(
    pump: Pump, at_15: OperatingCondition
) -> None:
    shares = ((0.0, 0.1, -0.2), (0.05, 0.0, 0.0), (0.0, 0.3, 0.0))
    gains = (2.0, 1.0, 1.0)
    plain = Twin(pump, at_15, bandwidth=1000)
    mixed = replace(plain, path=SensorPath(gains, cross_talk=shares))

    lines = lines_of(plain)
    expected = np.array(gains)[:, None] * (lines + np.array(shares) @ lines)
    np.testing.assert_allclose(lines_of(mixed), expected, rtol=1e-12)


def test_crosstalk_needs_a_share_for_each_pair_of_channels() -> None:
    with pytest.raises(InputError, match="a share for each pair"):
        SensorPath((1.0, 1.0), cross_talk=((0.0,), (0.0,)))
