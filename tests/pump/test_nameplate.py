"""Pumps scaled from a nameplate: the nameplate is met, the original comes back, and each number
says its source.
"""

import math
from dataclasses import replace
from pathlib import Path

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

MASS = 24 + 4.6 + 0.7
"""Mass of the shipped pump [kg]."""
PLATES = [
    Nameplate(45e-6, 9, rpm(1500), MPa(28)),
    Nameplate(140e-6, 9, rpm(1800), MPa(35), deg(18)),
    Nameplate(10e-6, 7, rpm(3000), MPa(10)),
    Nameplate(71e-6, 11, rpm(1500), MPa(25)),
]


@pytest.mark.parametrize("plate", PLATES, ids=str)
def test_a_scaled_pump_meets_its_nameplate_and_comes_back_from_its_file(
    pump: Pump, plate: Nameplate, tmp_path: Path
) -> None:
    scaled = scaled_pump(pump, plate, "mine")
    loaded = load_pump(new_pump("mine", nameplate=plate, folder=tmp_path))
    for group in (scaled.rotating_group, loaded.rotating_group):
        assert group.displacement == pytest.approx(plate.displacement, rel=1e-9)
        assert group.piston_count == plate.piston_count
        assert group.swash_angle == pytest.approx(
            plate.swash_angle or pump.rotating_group.swash_angle, rel=1e-9
        )
    assert loaded.rated is not None
    assert (loaded.rated.speed, loaded.rated.discharge_pressure) == pytest.approx(
        (plate.speed, plate.discharge_pressure)
    )
    for (path, written, _), (_, read, _) in zip(
        pump_numbers(scaled), pump_numbers(loaded), strict=True
    ):
        assert read == pytest.approx(written, rel=1e-5), path
    assert dict(loaded.sources) == dict(scaled.sources)


def test_the_original_comes_back_from_its_own_nameplate(pump: Pump) -> None:
    assert pump.rated is not None
    plate = Nameplate(
        pump.rotating_group.displacement,
        7,
        pump.rated.speed,
        pump.rated.discharge_pressure,
        mass=MASS,
    )
    again = scaled_pump(pump, plate, "again")
    for (path, value, _), (_, before, _) in zip(
        pump_numbers(again), pump_numbers(pump), strict=True
    ):
        assert value == pytest.approx(before, rel=1e-12), path


def test_every_number_says_whether_it_is_the_nameplates_scaled_or_a_guess(pump: Pump) -> None:
    scaled = scaled_pump(pump, PLATES[1], "mine")
    origins = {path: scaled.sources[path].split(":")[0] for path, _, _ in pump_numbers(scaled)}
    assert set(origins.values()) == {"nameplate", "scaled", "guess"}
    assert sorted(path for path, origin in origins.items() if origin == "nameplate") == [
        "rated.discharge_pressure", "rated.speed", "rotating_group.piston_count", "rotating_group.swash_angle",
    ]  # fmt: skip
    for (path, value, _), (_, before, _) in zip(
        pump_numbers(scaled), pump_numbers(pump), strict=True
    ):
        assert origins[path] != "guess" or value == before, path


def test_eight_times_the_displacement_is_twice_the_size(pump: Pump) -> None:
    assert pump.rated is not None
    rated = (pump.rated.speed, pump.rated.discharge_pressure)
    eight = Nameplate(8 * pump.rotating_group.displacement, 7, *rated, mass=8 * MASS)
    scaled = {path: value for path, value, _ in pump_numbers(scaled_pump(pump, eight, "eight"))}
    expected = {
        "rotating_group.piston_diameter": 2, "rotating_group.slipper_diameter": 2, "positions.mount": 2,
        "rotating_group.dead_volume": 8, "line.volume": 8, "masses.shell": 8, "masses.piston_slipper": 8,
        "masses.rotor_inertia": 32, "mount.stiffness_x": 2, "mount.stiffness_tilt": 8, "coupling.spring_preload": 4,
        "interfaces.slipper_swash.damping": 2, "interfaces.block_valve.stiffness": 2,
        "interfaces.piston_bore.stiffness": 2, "valve_plate.discharge_open": 1, "oil.bulk_modulus": 1,
    }  # fmt: skip
    for path, value, _ in pump_numbers(pump):
        if path in expected:
            assert scaled[path] == pytest.approx(expected[path] * value, rel=1e-9), path


def test_a_scaled_pump_weighs_what_catalogs_or_its_plate_say(pump: Pump) -> None:
    for plate, mass in ((PLATES[0], 21), (replace(PLATES[1], mass=77.0), 77)):
        masses = scaled_pump(pump, plate, "mine").masses
        assert masses.shell + masses.rotor + masses.retainer == pytest.approx(mass, rel=0.05)
    for size, mass in ((18, 12), (28, 15), (45, 21), (71, 33), (100, 45), (140, 60)):
        assert catalog_mass(size * 1e-6) == pytest.approx(mass, rel=0.12)
    with pytest.raises(InputError, match="check its unit"):
        replace(PLATES[0], mass=21000.0)


def test_the_kidneys_open_where_the_oil_has_reached_the_stated_pressure(pump: Pump) -> None:
    """The closed chamber at bottom dead center, compressed step by step, against the closed
    formula.
    """
    group, oil = pump.rotating_group, pump.oil
    angle = compression_angle(group, oil, MPa(15))
    turn = np.linspace(0, angle, 20001)
    volume = group.dead_volume + group.piston_area * stroke_of(group) / 2 * (1 + np.cos(turn))
    assert oil.bulk_modulus * (volume[0] - volume[-1]) / volume[0] == pytest.approx(
        MPa(15), rel=1e-9
    )
    assert math.degrees(angle) == pytest.approx(
        17, abs=0.3
    )  # docs/explanation/physics.md, section 5
    assert math.degrees(decompression_angle(group, oil, MPa(15))) == pytest.approx(11, abs=0.4)
    higher = scaled_pump(
        pump, Nameplate(group.displacement, 7, rpm(860), MPa(30)), "higher"
    ).valve_plate
    shift = compression_angle(group, oil, MPa(30)) - angle
    assert higher.discharge_open - pump.valve_plate.discharge_open == pytest.approx(shift, rel=1e-9)
    with pytest.raises(
        InputError, match=r"too little to bring a chamber of 400 mL to 15 MPa; reduce dead_volume"
    ):
        decompression_angle(replace(group, dead_volume=4e-4), oil, MPa(15))


def test_a_scaled_pump_runs(pump: Pump) -> None:
    twin = Twin(scaled_pump(pump, PLATES[0], "mine"), OperatingCondition(rpm(1500), MPa(28)))
    signal = twin.simulate(0.1, 25600.0).signal
    assert np.isfinite(signal).all()
    assert 0.1 < np.sqrt(np.mean(signal**2)) < 100


def test_the_effect_of_each_number_is_that_of_changing_it_alone(
    pump: Pump, at_15: OperatingCondition
) -> None:
    twin = Twin(pump, at_15, bandwidth=1500.0)
    effects = {effect.path: effect for effect in sensitivities(twin)}
    assert list(effects.values()) == sorted(effects.values(), key=lambda effect: -effect.effect)
    assert set(effects) == {
        path
        for path, _, _ in pump_numbers(pump)
        if not path.startswith(("rated.", "rotating_group.piston_c"))
    } | {"rotating_group.piston_clearance"}
    heavier = replace(
        twin, pump=replace(pump, masses=replace(pump.masses, shell=1.05 * pump.masses.shell))
    )
    before, after = (np.abs(each.acceleration().numpy()) for each in (twin, heavier))
    expected = np.linalg.norm(after - before) / np.linalg.norm(before)
    assert effects["masses.shell"].effect == pytest.approx(expected, rel=1e-12)
    assert effects["masses.shell"].step == "+5%"
    assert effects["valve_plate.discharge_open"].step == "+2 deg"


@pytest.mark.parametrize(
    "text", ["45 cm3/rev", "45 cm^3", "45 cm³ per rev", "45 mL", "45 ml/U", "45 cc", "45 ccm/r"]
)
def test_a_displacement_is_read_as_plates_write_it(text: str) -> None:
    plate = read_nameplate(displacement=text, pistons=9, speed="1500 rpm", pressure="280 bar")
    assert (plate.displacement, plate.discharge_pressure) == pytest.approx((45e-6, 28e6))


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        (
            {"displacement": "45"},
            UnitError,
            "displacement = '45' is not a volume per revolution; write it as",
        ),
        (
            {"displacement": "45 mm"},
            UnitError,
            "displacement = '45 mm' is not a volume per revolution",
        ),
        (
            {"displacement": "45 m3/rev"},
            InputError,
            r"displacement \(4.5e\+07 mL per revolution\) must lie in 0.01",
        ),
        (
            {"pistons": 2},
            InputError,
            r"piston_count \(2\) must lie in 3...19; most pumps have 7 or 9",
        ),
        (
            {"swash_angle": "50 deg"},
            InputError,
            r"swash_angle \(50 deg\) must lie within 0...45 deg",
        ),
        ({"pressure": "280"}, UnitError, "pressure = '280' has no unit"),
        ({"speed": "25 1/s"}, UnitError, 'write it as "1500 rpm"'),
    ],
)
def test_an_impossible_nameplate_is_refused_in_a_line(
    change: dict[str, object], error: type[Exception], message: str
) -> None:
    stated: dict[str, object] = {
        "displacement": "45 cm3",
        "pistons": 9,
        "speed": "1500 rpm",
        "pressure": "28 MPa",
    }
    with pytest.raises(error, match=message):
        read_nameplate(**{**stated, **change})  # type: ignore[arg-type]
