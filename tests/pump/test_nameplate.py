"""Pumps scaled from a nameplate: they meet it, and each number states its source."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swashtwin.foundation import InputError, MPa, UnitError, deg, rpm
from swashtwin.physics import Twin, sensitivities
from swashtwin.pump import (
    Nameplate,
    OperatingCondition,
    Pump,
    load_pump,
    new_pump,
    pump_numbers,
    read_nameplate,
    scaled_pump,
    stroke_of,
)
from swashtwin.pump.geometry import compression_angle, decompression_angle
from swashtwin.pump.nameplate import catalog_mass
from swashtwin.pump.parameters import RotatingGroup

PUMP_MASS = 24 + 4.6 + 0.7
"""Mass of the shipped pump's shell, rotor and retainer [kg]."""

PLATE_45 = Nameplate(45e-6, 9, rpm(1500), MPa(28))
PLATE_140 = Nameplate(140e-6, 9, rpm(1800), MPa(35), deg(18))
PLATES = [
    PLATE_45,
    PLATE_140,
    Nameplate(10e-6, 7, rpm(3000), MPa(10)),
    Nameplate(71e-6, 11, rpm(1500), MPa(25)),
]


def values_of(pump: Pump) -> dict[str, Any]:
    """Return the numbers of a pump by their paths."""
    return {path: value for path, value, _ in pump_numbers(pump)}


def assert_meets(group: RotatingGroup, plate: Nameplate, original: RotatingGroup) -> None:
    """Fail unless a group has the values of a nameplate, and otherwise the original's angle."""
    assert group.displacement == pytest.approx(plate.displacement, rel=1e-9)
    assert group.piston_count == plate.piston_count
    swash_angle = plate.swash_angle or original.swash_angle
    assert group.swash_angle == pytest.approx(swash_angle, rel=1e-9)


@pytest.mark.parametrize("plate", PLATES, ids=str)
def test_a_scaled_pump_meets_its_nameplate(pump: Pump, plate: Nameplate) -> None:
    scaled = scaled_pump(pump, plate, "mine")
    assert_meets(scaled.rotating_group, plate, pump.rotating_group)


@pytest.mark.parametrize("plate", PLATES, ids=str)
def test_the_file_of_a_scaled_pump_holds_the_same_pump(
    pump: Pump, plate: Nameplate, tmp_path: Path
) -> None:
    scaled = scaled_pump(pump, plate, "mine")
    loaded = load_pump(new_pump("mine", nameplate=plate, folder=tmp_path))

    assert_meets(loaded.rotating_group, plate, pump.rotating_group)
    assert loaded.rated is not None
    assert loaded.rated.speed == pytest.approx(plate.speed)
    assert loaded.rated.discharge_pressure == pytest.approx(plate.discharge_pressure)
    loaded_values = values_of(loaded)
    for path, value in values_of(scaled).items():
        # the file rounds scaled numbers
        assert loaded_values[path] == pytest.approx(value, rel=1e-5), path
    assert loaded_values.keys() == values_of(scaled).keys()
    assert dict(loaded.sources) == dict(scaled.sources)


def test_scaling_to_the_pump_s_own_nameplate_changes_nothing(pump: Pump) -> None:
    assert pump.rated is not None
    plate = Nameplate(
        pump.rotating_group.displacement,
        7,
        pump.rated.speed,
        pump.rated.discharge_pressure,
        mass=PUMP_MASS,
    )

    scaled_values = values_of(scaled_pump(pump, plate, "again"))

    original_values = values_of(pump)
    assert scaled_values.keys() == original_values.keys()
    for path, value in scaled_values.items():
        assert value == pytest.approx(original_values[path], rel=1e-12), path


def test_every_source_states_whether_a_number_is_the_nameplate_s_scaled_or_a_guess(
    pump: Pump,
) -> None:
    scaled = scaled_pump(pump, PLATE_140, "mine")
    values = values_of(scaled)
    origins = {path: scaled.sources[path].split(":")[0] for path in values}

    assert set(origins.values()) == {"nameplate", "scaled", "guess"}
    assert sorted(path for path, origin in origins.items() if origin == "nameplate") == [
        "rated.discharge_pressure",
        "rated.speed",
        "rotating_group.piston_count",
        "rotating_group.swash_angle",
    ]
    # a guess is the value of the original
    original_values = values_of(pump)
    assert values.keys() == original_values.keys()
    for path, origin in origins.items():
        if origin == "guess":
            assert values[path] == original_values[path], path


# Eight times the displacement, and mass, is twice the size.
@pytest.mark.parametrize(
    ("path", "factor"),
    [
        ("rotating_group.piston_diameter", 2),
        ("rotating_group.slipper_diameter", 2),
        ("positions.mount", 2),
        # volumes and masses: size^3
        ("rotating_group.dead_volume", 8),
        ("line.volume", 8),
        ("masses.shell", 8),
        ("masses.piston_slipper", 8),
        # mass times size^2
        ("masses.rotor_inertia", 32),
        # stiffness: pressure times size, and about an axis times size^2 more
        ("mount.stiffness_x", 2),
        ("mount.stiffness_tilt", 8),
        # force: pressure times size^2
        ("coupling.spring_preload", 4),
        ("interfaces.slipper_swash.damping", 2),
        ("interfaces.block_valve.stiffness", 2),
        ("interfaces.piston_bore.stiffness", 2),
        # angles and the oil do not scale
        ("valve_plate.discharge_open", 1),
        ("oil.bulk_modulus", 1),
    ],
)
def test_each_number_scales_with_its_power_of_the_size(
    pump: Pump, path: str, factor: float
) -> None:
    assert pump.rated is not None
    plate = Nameplate(
        8 * pump.rotating_group.displacement,
        7,
        pump.rated.speed,
        pump.rated.discharge_pressure,
        mass=8 * PUMP_MASS,
    )

    values = values_of(scaled_pump(pump, plate, "eight"))

    assert values[path] == pytest.approx(factor * values_of(pump)[path], rel=1e-9)


@pytest.mark.parametrize(
    ("plate", "mass"),
    [
        pytest.param(PLATE_45, 21, id="without a mass, as in catalogs"),
        pytest.param(replace(PLATE_140, mass=77.0), 77, id="with a mass"),
    ],
)
def test_a_scaled_pump_has_the_mass_of_its_nameplate_or_of_catalogs(
    pump: Pump, plate: Nameplate, mass: float
) -> None:
    masses = scaled_pump(pump, plate, "mine").masses
    assert masses.shell + masses.rotor + masses.retainer == pytest.approx(mass, rel=0.05)


@pytest.mark.parametrize(
    ("displacement_ml", "mass"), [(18, 12), (28, 15), (45, 21), (71, 33), (100, 45), (140, 60)]
)
def test_the_mass_of_a_displacement_is_that_of_catalogs(
    displacement_ml: float, mass: float
) -> None:
    assert catalog_mass(displacement_ml * 1e-6) == pytest.approx(mass, rel=0.12)


def test_a_mass_in_grams_is_refused() -> None:
    with pytest.raises(InputError, match="check its unit"):
        replace(PLATE_45, mass=21000.0)


def test_the_closed_chamber_reaches_the_given_pressure_at_the_compression_angle(pump: Pump) -> None:
    group = pump.rotating_group
    angle = compression_angle(group, pump.oil, MPa(15))

    # volume of a chamber that moves away from bottom dead center
    turn = np.linspace(0, angle, 20001)
    piston_travel = stroke_of(group) / 2 * (1 + np.cos(turn))
    volume = group.dead_volume + group.piston_area * piston_travel
    pressure = pump.oil.bulk_modulus * (volume[0] - volume[-1]) / volume[0]
    assert pressure == pytest.approx(MPa(15), rel=1e-9)


def test_the_angles_of_the_paper_s_pump_are_those_of_the_documents(pump: Pump) -> None:
    # docs/explanation/physics.md, section 5
    compression = compression_angle(pump.rotating_group, pump.oil, MPa(15))
    assert math.degrees(compression) == pytest.approx(17, abs=0.3)
    decompression = decompression_angle(pump.rotating_group, pump.oil, MPa(15))
    assert math.degrees(decompression) == pytest.approx(11, abs=0.4)


def test_the_discharge_kidney_opens_later_by_the_added_compression_angle(pump: Pump) -> None:
    group = pump.rotating_group
    plate = Nameplate(group.displacement, 7, rpm(860), MPa(30))

    scaled = scaled_pump(pump, plate, "higher")

    rated_angle = compression_angle(group, pump.oil, MPa(15))
    added_angle = compression_angle(group, pump.oil, MPa(30)) - rated_angle
    shift = scaled.valve_plate.discharge_open - pump.valve_plate.discharge_open
    assert shift == pytest.approx(added_angle, rel=1e-9)


def test_a_chamber_that_one_stroke_cannot_compress_is_refused(pump: Pump) -> None:
    group = replace(pump.rotating_group, dead_volume=4e-4)

    message = r"too little to bring a chamber of 400 mL to 15 MPa; reduce dead_volume"
    with pytest.raises(InputError, match=message):
        decompression_angle(group, pump.oil, MPa(15))


def test_a_scaled_pump_runs(pump: Pump) -> None:
    condition = OperatingCondition(rpm(1500), MPa(28))

    signal = Twin(scaled_pump(pump, PLATE_45, "mine"), condition).simulate(0.1, 25600.0).signal

    assert np.isfinite(signal).all()
    # accelerations that pumps of this size have, in m/s^2
    assert 0.1 < np.sqrt(np.mean(signal**2)) < 100


def test_the_sensitivities_are_sorted_and_cover_the_numbers_that_change_the_vibration(
    pump: Pump, at_15: OperatingCondition
) -> None:
    effects = sensitivities(Twin(pump, at_15, bandwidth=1500.0))

    magnitudes = [effect.effect for effect in effects]
    assert magnitudes == sorted(magnitudes, reverse=True)
    # The rated point is no property of the pump, and the number of pistons is a whole number.
    paths = {
        path
        for path in values_of(pump)
        if not path.startswith(("rated.", "rotating_group.piston_c"))
    }
    assert {effect.path for effect in effects} == paths | {"rotating_group.piston_clearance"}


def test_the_effect_of_a_number_is_that_of_changing_it_alone(
    pump: Pump, at_15: OperatingCondition
) -> None:
    twin = Twin(pump, at_15, bandwidth=1500.0)
    effects = {effect.path: effect for effect in sensitivities(twin)}

    masses = replace(pump.masses, shell=1.05 * pump.masses.shell)
    heavier_twin = replace(twin, pump=replace(pump, masses=masses))
    nominal = np.abs(twin.acceleration().numpy())
    heavier = np.abs(heavier_twin.acceleration().numpy())
    change = np.linalg.norm(heavier - nominal) / np.linalg.norm(nominal)

    assert effects["masses.shell"].effect == pytest.approx(change, rel=1e-12)
    assert effects["masses.shell"].step == "+5%"
    # 5 % of an angle would depend on where its zero lies
    assert effects["valve_plate.discharge_open"].step == "+2 deg"


@pytest.mark.parametrize(
    "text", ["45 cm3/rev", "45 cm^3", "45 cm³ per rev", "45 mL", "45 ml/U", "45 cc", "45 ccm/r"]
)
def test_a_displacement_is_read_as_nameplates_write_it(text: str) -> None:
    plate = read_nameplate(displacement=text, pistons=9, speed="1500 rpm", pressure="280 bar")

    assert plate.displacement == pytest.approx(45e-6)
    assert plate.discharge_pressure == pytest.approx(28e6)


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        pytest.param(
            {"displacement": "45"},
            UnitError,
            "displacement = '45' is not a volume per revolution; write it as",
            id="displacement without a unit",
        ),
        pytest.param(
            {"displacement": "45 mm"},
            UnitError,
            "displacement = '45 mm' is not a volume per revolution",
            id="displacement in millimeters",
        ),
        pytest.param(
            {"displacement": "45 m3/rev"},
            InputError,
            r"displacement \(4.5e\+07 mL per revolution\) must lie in 0.01",
            id="displacement in cubic meters",
        ),
        pytest.param(
            {"pistons": 2},
            InputError,
            r"piston_count \(2\) must lie in 3...19; most pumps have 7 or 9",
            id="two pistons",
        ),
        pytest.param(
            {"swash_angle": "50 deg"},
            InputError,
            r"swash_angle \(50 deg\) must lie within 0...45 deg",
            id="steep swash plate",
        ),
        pytest.param(
            {"pressure": "280"},
            UnitError,
            "pressure = '280' has no unit",
            id="pressure without a unit",
        ),
        pytest.param(
            {"speed": "25 1/s"}, UnitError, 'write it as "1500 rpm"', id="speed in turns a second"
        ),
    ],
)
def test_an_impossible_nameplate_is_refused_in_a_line(
    change: dict[str, object], error: type[Exception], message: str
) -> None:
    nameplate: dict[str, object] = {
        "displacement": "45 cm3",
        "pistons": 9,
        "speed": "1500 rpm",
        "pressure": "28 MPa",
    }

    with pytest.raises(error, match=message):
        read_nameplate(**{**nameplate, **change})  # type: ignore[arg-type]
