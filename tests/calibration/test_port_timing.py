"""The angles at which ports open are estimated, and kept by the twin and in its file."""

import json
from pathlib import Path

import pytest
import torch
from twin_recordings import DAMPER, recording_of

from swashtwin.calibration import (
    Calibration,
    GaussNewton,
    Nuisances,
    SeveritySettings,
    calibrate,
    is_warning,
    load_calibration,
)
from swashtwin.calibration.fault_dimensions import build_fault_space
from swashtwin.calibration.severity.severity_search import build_fault_comparison, build_inversion
from swashtwin.foundation import MPa, deg, um
from swashtwin.physics import PortTiming, Twin
from swashtwin.pump import OperatingCondition, PistonWear, Pump

TIMING = PortTiming(discharge_open=deg(-0.5), suction_open=deg(0.5))


@pytest.fixture(scope="module")
def twin(pump: Pump, at_15: OperatingCondition) -> Twin:
    return Twin(pump, at_15.replace(discharge_pressure=MPa(10)), bandwidth=2600)


@pytest.fixture(scope="module")
def calibration(twin: Twin) -> Calibration:
    """From one recording of a machine whose ports open half a degree from the drawing."""
    machine = Twin(TIMING.apply(twin.pump), twin.condition, bandwidth=twin.bandwidth)
    return calibrate(twin, [recording_of(machine)], method=GaussNewton(starts=1))


def test_ports_within_their_tolerance_bias_no_value_and_cause_no_warning(
    twin: Twin, calibration: Calibration
) -> None:
    assert not [note for note in calibration.notes if is_warning(note)]
    truth = twin.values.numpy() * DAMPER
    for estimate, value in zip(calibration.estimates, truth.tolist(), strict=True):
        assert estimate.interval[0] <= value <= estimate.interval[1], estimate.symbol


def test_the_twin_keeps_the_estimated_ports(calibration: Calibration) -> None:
    assert calibration.twin.port_timing.values() == pytest.approx(TIMING.values(), abs=deg(0.1))
    assert calibration.twin.pump == calibration.nominal.pump
    assert calibration.fits[0].calibrated_agreement.spectrum_value_error < 0.05


def test_a_saved_calibration_keeps_the_ports(calibration: Calibration, tmp_path: Path) -> None:
    loaded = load_calibration(calibration.save(tmp_path / "calibration.json"))
    assert loaded.twin.port_timing == calibration.twin.port_timing
    assert torch.equal(loaded.twin.acceleration(), calibration.twin.acceleration())


def test_a_severity_counts_the_error_of_estimated_ports_once(
    twin: Twin, calibration: Calibration
) -> None:
    settings = SeveritySettings()
    space = build_fault_space(PistonWear(um(60)), None)
    faulty = recording_of(twin.with_fault(space.reference))
    comparison = build_fault_comparison(calibration, [faulty], space.reference, [], settings.band)
    assert "discharge_open" in calibration.posterior.unknowns.names
    assert build_inversion(calibration, [comparison], space, [], settings).port_timing == 0.0


def test_a_calibration_without_ports_is_read_as_drawn(twin: Twin, tmp_path: Path) -> None:
    as_drawn = calibrate(
        twin, [recording_of(twin)], method=GaussNewton(starts=1), nuisances=Nuisances.housing()
    )
    table = as_drawn.to_dict()
    table["format"] = "swashtwin calibration 9"
    del table["suspected_mistakes"]
    del table["twin"]["port_timing"]
    del table["nominal"]["port_timing"]
    del table["posterior"]["unknowns"]["nuisances"]["port_timing"]
    path = tmp_path / "calibration.json"
    path.write_text(json.dumps(table))

    loaded = load_calibration(path)
    assert loaded.twin.port_timing == PortTiming()
    assert torch.equal(loaded.twin.acceleration(), as_drawn.twin.acceleration())
