"""A fault from outside the package, written in the places that CONTRIBUTING.md names: it simulates,
saves and loads.
"""

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
    """Crack in the valve plate under one bore: that chamber leaks, and the plate's film is
    softer.
    """

    label: ClassVar[str] = "cracked_plate"

    conductance: float = field(metadata={"unit": "m^3/(s*Pa)"})
    """Added leakage conductance [m^3/(s Pa)]."""
    softening: float = 1.0
    """Factor on the film's stiffness."""


register_severity(CrackedPlate, SeveritySearch((Dimension("conductance", "mm³/(s MPa)", 1e-15),)))


@added_leakage.register(CrackedPlate)
def _(fault: CrackedPlate, pump: Pump) -> AddedLeakage:
    first = np.arange(pump.rotating_group.piston_count) == 0
    return AddedLeakage(conductance=np.where(first, fault.conductance, 0.0))


@interface_factors.register(CrackedPlate)
def _(fault: CrackedPlate, pump: Pump) -> Interfaces:
    return Interfaces(
        UNCHANGED.slipper_swash, Interface(1.0, fault.softening), UNCHANGED.piston_bore
    )


@pytest.fixture(scope="module", autouse=True)
def _registered() -> Iterator[None]:
    register_fault("cracked_plate", CrackedPlate(1e-12))
    yield
    del _faults["cracked_plate"]  # other tests list the package's own faults


def lines_of(pump: Pump, condition: OperatingCondition, fault: Fault | None) -> dict[int, complex]:
    twin = Twin(pump, condition, fault, bandwidth=1500)
    return dict(zip(twin.orders.tolist(), twin.acceleration()[0].tolist(), strict=True))


def test_an_own_fault_is_read_as_the_shell_writes_it() -> None:
    assert read_fault("cracked_plate") == CrackedPlate(1e-12)
    assert read_fault(
        "Cracked plate", conductance="2e-12 m^3/(s*Pa)", softening="0.9"
    ) == CrackedPlate(2e-12, 0.9)
    with pytest.raises(
        InputError, match="cracked_plate has no dimension 'depth'; it has conductance, softening"
    ):
        read_fault("cracked_plate", depth="1 mm")


def test_an_installed_fault_is_found_by_its_entry_point(monkeypatch: pytest.MonkeyPatch) -> None:
    class EntryPoint:
        name = "cracked_plate"

        def load(self) -> Fault:
            return CrackedPlate(1e-12)

    groups = {"swashtwin.faults": [EntryPoint()]}
    monkeypatch.setattr("swashtwin.pump.faults.entry_points", lambda group: groups[group])
    monkeypatch.delitem(_faults, "cracked_plate")
    assert read_fault("Cracked plate", softening="0.9") == CrackedPlate(1e-12, 0.9)
    monkeypatch.delitem(_faults, "cracked_plate")
    assert fault_type("CrackedPlate") is CrackedPlate


def test_an_own_fault_acts_by_its_registered_effects(pump: Pump, at_15: OperatingCondition) -> None:
    healthy, none = lines_of(pump, at_15, None), lines_of(pump, at_15, CrackedPlate(0.0))
    assert healthy == none
    cracked = lines_of(pump, at_15, CrackedPlate(1e-12))
    assert set(healthy) < set(
        cracked
    )  # one piston differs: lines between the multiples of the piston count
    soft = lines_of(pump, at_15, CrackedPlate(0.0, softening=0.8))
    assert set(soft) == set(healthy)
    assert soft != healthy


def test_a_twin_with_an_own_fault_is_saved_and_loaded(
    pump: Pump, at_15: OperatingCondition
) -> None:
    twin = Twin(pump, at_15, CrackedPlate(1e-12, softening=0.9))
    table = json.loads(json.dumps(twin_to_dict(twin)))
    assert twin_from_dict(table).fault == twin.fault
    table["fault"]["kind"] = "Unheard"
    with pytest.raises(
        InputError, match=r"No fault of the type Unheard is registered.*register_fault"
    ):
        twin_from_dict(table)


def test_the_severity_of_an_own_fault_is_estimated(pump: Pump, at_15: OperatingCondition) -> None:
    healthy = Twin(pump, at_15, bandwidth=1000)
    recording = healthy.with_fault(CrackedPlate(2e-12)).simulate(2.0, 4000, recording_id="worn")
    sound = healthy.simulate(2.0, 4000, recording_id="sound")
    calibration = calibrate(
        healthy, [sound], method=GaussNewton(starts=1), nuisances=Nuisances(), band=(0, 1000)
    )
    trend = estimate_severity(calibration, [recording], CrackedPlate(1e-12))
    (estimate,) = trend.estimates
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
)
def test_a_fault_that_cannot_be_registered_is_refused(
    name: str, typical: Fault, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        register_fault(name, typical)


def test_a_search_begins_with_the_severity() -> None:
    with pytest.raises(
        InputError,
        match=r"CrackedPlate has the dimensions conductance, softening; .* begin with cond",
    ):
        register_severity(CrackedPlate, SeveritySearch((Dimension("softening", "", 1.0),)))
