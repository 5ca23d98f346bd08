"""A fault from outside the package, as CONTRIBUTING.md describes: it simulates, saves and loads."""

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
import pytest

from swashtwin.calibration import (
    Dimension,
    GaussNewton,
    Nuisances,
    SeveritySearch,
    calibrate,
    estimate_severity,
    register_severity,
    twin_from_dict,
    twin_to_dict,
)
from swashtwin.foundation import InputError
from swashtwin.physics import AddedLeakage, Twin, added_leakage, interface_factors
from swashtwin.physics.fault_forcing import UNCHANGED
from swashtwin.pump import (
    Fault,
    Interface,
    Interfaces,
    OperatingCondition,
    Pump,
    fault_type,
    read_fault,
    register_fault,
)
from swashtwin.pump.faults import _faults


@dataclass(frozen=True)
class CrackedPlate(Fault):
    """Crack in the valve plate under one bore: its chamber leaks, and the film is softer."""

    label: ClassVar[str] = "cracked_plate"

    conductance: float = field(metadata={"unit": "m^3/(s*Pa)"})
    """Added leakage conductance [m^3/(s Pa)]."""
    softening: float = 1.0
    """Factor on the film's stiffness."""


register_severity(CrackedPlate, SeveritySearch((Dimension("conductance", "mm³/(s MPa)", 1e-15),)))


@added_leakage.register(CrackedPlate)
def _(fault: CrackedPlate, pump: Pump) -> AddedLeakage:
    is_cracked = np.arange(pump.rotating_group.piston_count) == 0
    return AddedLeakage(conductance=np.where(is_cracked, fault.conductance, 0.0))


@interface_factors.register(CrackedPlate)
def _(fault: CrackedPlate, pump: Pump) -> Interfaces:
    softened = Interface(1.0, fault.softening)
    return Interfaces(UNCHANGED.slipper_swash, softened, UNCHANGED.piston_bore)


@pytest.fixture(scope="module", autouse=True)
def _registered() -> Iterator[None]:
    register_fault("cracked_plate", CrackedPlate(1e-12))
    yield
    del _faults["cracked_plate"]  # other tests list the package's own faults


def lines_of(pump: Pump, condition: OperatingCondition, fault: Fault | None) -> dict[int, complex]:
    """Lines of the first channel by shaft order."""
    twin = Twin(pump, condition, fault, bandwidth=1500)
    return dict(zip(twin.orders.tolist(), twin.acceleration()[0].tolist(), strict=True))


@pytest.mark.parametrize(
    ("name", "dimensions", "expected"),
    [
        ("cracked_plate", {}, CrackedPlate(1e-12)),
        (
            "Cracked plate",
            {"conductance": "2e-12 m^3/(s*Pa)", "softening": "0.9"},
            CrackedPlate(2e-12, 0.9),
        ),
    ],
    ids=["typical", "other spelling and dimensions"],
)
def test_a_registered_fault_is_read_from_its_name_and_dimensions(
    name: str, dimensions: dict[str, str], expected: Fault
) -> None:
    assert read_fault(name, **dimensions) == expected


def test_an_unknown_dimension_of_a_registered_fault_is_refused_with_the_known_ones() -> None:
    message = "cracked_plate has no dimension 'depth'; it has conductance, softening"
    with pytest.raises(InputError, match=message):
        read_fault("cracked_plate", depth="1 mm")


def test_an_installed_fault_is_discovered_by_its_entry_point(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class EntryPoint:
        name = "cracked_plate"

        def load(self) -> Fault:
            return CrackedPlate(1e-12)

    groups = {"swashtwin.faults": [EntryPoint()]}
    monkeypatch.setattr("swashtwin.pump.faults.entry_points", lambda group: groups[group])

    # by its name, and, forgotten again, by its type
    monkeypatch.delitem(_faults, "cracked_plate")
    assert read_fault("Cracked plate", softening="0.9") == CrackedPlate(1e-12, 0.9)
    monkeypatch.delitem(_faults, "cracked_plate")
    assert fault_type("CrackedPlate") is CrackedPlate


def test_an_own_fault_of_no_severity_changes_no_line(pump: Pump, at_15: OperatingCondition) -> None:
    assert lines_of(pump, at_15, CrackedPlate(0.0)) == lines_of(pump, at_15, None)


def test_a_registered_leak_of_one_chamber_adds_lines(pump: Pump, at_15: OperatingCondition) -> None:
    healthy = lines_of(pump, at_15, None)
    leaking = lines_of(pump, at_15, CrackedPlate(1e-12))
    # one piston differs: lines between the multiples of the piston count
    assert set(healthy) < set(leaking)


def test_a_registered_softening_changes_lines_and_adds_none(
    pump: Pump, at_15: OperatingCondition
) -> None:
    healthy = lines_of(pump, at_15, None)
    soft = lines_of(pump, at_15, CrackedPlate(0.0, softening=0.8))
    assert set(soft) == set(healthy)
    assert soft != healthy


def test_a_twin_with_an_own_fault_is_saved_and_loaded(
    pump: Pump, at_15: OperatingCondition
) -> None:
    twin = Twin(pump, at_15, CrackedPlate(1e-12, softening=0.9))
    table = json.loads(json.dumps(twin_to_dict(twin)))
    assert twin_from_dict(table).fault == twin.fault


def test_a_saved_fault_that_is_not_registered_is_refused(
    pump: Pump, at_15: OperatingCondition
) -> None:
    table = twin_to_dict(Twin(pump, at_15, CrackedPlate(1e-12)))
    table["fault"]["kind"] = "Unheard"
    message = r"No fault of the type Unheard is registered.*register_fault"
    with pytest.raises(InputError, match=message):
        twin_from_dict(table)


def test_the_severity_of_an_own_fault_is_estimated(pump: Pump, at_15: OperatingCondition) -> None:
    twin = Twin(pump, at_15, bandwidth=1000)
    healthy = twin.simulate(2.0, 4000, recording_id="healthy")
    cracked = twin.with_fault(CrackedPlate(2e-12)).simulate(2.0, 4000, recording_id="cracked")

    calibration = calibrate(
        twin, [healthy], method=GaussNewton(starts=1), nuisances=Nuisances(), band=(0, 1000)
    )
    (estimate,) = estimate_severity(calibration, [cracked], CrackedPlate(1e-12)).estimates

    assert isinstance(estimate.fault, CrackedPlate)
    assert estimate.fault.conductance == pytest.approx(2e-12, rel=0.1)


@pytest.mark.parametrize(
    ("name", "typical", "message"),
    [
        (
            "piston",
            CrackedPlate(1e-12),
            r"piston \(CrackedPlate\) is already registered as piston \(PistonWear\); rename it",
        ),
        ("normal", CrackedPlate(1e-12), "is already registered as normal"),
        (
            "other",
            type("Fault2", (Fault,), {})(),
            "Fault2 is not a fault: derive a frozen dataclass from Fault",
        ),
    ],
    ids=["name of a fault", "name of the healthy state", "not a dataclass"],
)
def test_a_fault_that_cannot_be_registered_is_refused(
    name: str, typical: Fault, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        register_fault(name, typical)


def test_a_severity_search_must_begin_with_the_first_dimension() -> None:
    search = SeveritySearch((Dimension("softening", "", 1.0),))
    message = r"CrackedPlate has the dimensions conductance, softening; .* begin with cond"
    with pytest.raises(InputError, match=message):
        register_severity(CrackedPlate, search)
