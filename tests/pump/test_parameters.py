"""Pumps and their files: what a file holds, and how each kind of mistake in it is reported."""

import math
import os
import re
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import Any

import pytest
import tomli_w
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from swashtwin.foundation import DataError, InputError, MissingFileError, UnitError, deg, mm
from swashtwin.pump import (
    PARAMETERS,
    Interfaces,
    Pump,
    available_pumps,
    load_pump,
    new_pump,
    pump_numbers,
)
from swashtwin.pump.parameters import map_numbers

PUMP_FILE = (resources.files("swashtwin.pump") / "pumps" / "25scy14-1b.toml").read_text(
    encoding="utf-8"
)


def write_pump(folder: Path, text: str) -> Path:
    path = folder / "mine.toml"
    path.write_text(text, encoding="utf-8")
    return path


def write_edited_pump(folder: Path, pattern: str, replacement: str) -> Path:
    """Write the shipped pump's file with the first match of a pattern replaced."""
    text, count = re.subn(pattern, lambda _: replacement, PUMP_FILE, count=1, flags=re.MULTILINE)
    assert count == 1, f"{pattern} is not in the file"
    return write_pump(folder, text)


def write_quantity(value: Any, unit: str) -> str | list[str]:
    """Return a number, or each number of a tuple, with its unit; 1 stands for none."""
    if isinstance(value, tuple):
        return [f"{number!r} {unit}".removesuffix(" 1") for number in value]
    return f"{value!r} {unit}".removesuffix(" 1")


def tables_of(pump: Pump) -> dict[str, Any]:
    """Return the tables of a pump's file."""
    tables: dict[str, Any] = {"format": 1, "name": pump.name}
    tables["sensors"] = [
        {"name": sensor.name, "direction": list(sensor.direction)} for sensor in pump.sensors
    ]
    for path, value, unit in pump_numbers(pump):
        # such as rotating_group.pitch_radius or sensors[0].position
        *sections, name = path.replace("[", ".").replace("]", "").split(".")
        table: Any = tables
        for section in sections:
            if section.isdecimal():
                table = table[int(section)]
            else:
                table = table.setdefault(section, {})
        table[name] = {"value": write_quantity(value, unit), "source": "test"}
    return tables


def test_the_papers_pump_displaces_what_its_name_plate_says(pump: Pump) -> None:
    group = pump.rotating_group

    # seven pistons of 17 mm on a pitch radius of 26 mm, at a swash angle of 16.8 deg
    piston_area = math.pi / 4 * mm(17) ** 2
    stroke = 2 * mm(26) * math.tan(deg(16.8))
    assert group.displacement == pytest.approx(7 * piston_area * stroke, rel=1e-12)
    # 25 mL per revolution, of which the pump has its name
    assert group.displacement == pytest.approx(25e-6, rel=0.01)


def test_the_papers_pump_has_three_sensors(pump: Pump) -> None:
    assert pump.channels == ("cover_z", "body_y", "body_x")


@pytest.mark.parametrize("name", available_pumps())
def test_every_number_of_every_pump_has_a_source(name: str) -> None:
    pump = load_pump(name)
    paths = {path for path, _, _ in pump_numbers(pump)}

    # so that a pump without numbers does not pass
    assert len(paths) > 60
    assert paths == set(pump.sources)
    assert all(source.strip() for source in pump.sources.values())


# more factors than a pump has numbers
@settings(
    max_examples=10, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(factors=st.lists(st.floats(0.99, 1.01), min_size=150, max_size=150))
def test_any_pump_is_read_from_its_file_unchanged(
    pump: Pump, tmp_path: Path, factors: list[float]
) -> None:
    remaining_factors = iter(factors)

    def vary(path: str, value: Any, unit: str) -> Any:
        if isinstance(value, tuple):
            return tuple(number * next(remaining_factors) for number in value)
        # counts are whole numbers
        return value * next(remaining_factors) if isinstance(value, float) else value

    varied = map_numbers(pump, vary)
    loaded = load_pump(write_pump(tmp_path, tomli_w.dumps(tables_of(varied))))

    pairs = zip(pump_numbers(loaded), pump_numbers(varied), strict=True)
    for (path, number, _), (_, expected, _) in pairs:
        # 15 digits are kept
        assert number == pytest.approx(expected, rel=6e-15), path
    assert loaded.name == varied.name
    assert loaded.channels == varied.channels


def assert_load_fails(path: Path, error: type[Exception], message: str) -> None:
    """Fail unless loading a file raises exactly this error, in one line that names the file."""
    with pytest.raises(error, match=message) as caught:
        load_pump(path)

    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)
    # and no subclass
    assert type(caught.value) is error


@pytest.mark.parametrize(
    ("pattern", "replacement", "error", "message"),
    [
        pytest.param(
            "^pitch_radius = .*$",
            "pitch_radius = 26",
            UnitError,
            "rotating_group.pitch_radius = 26 is a bare value; "
            'write pitch_radius = { value = "... m", source = "..." }',
            id="bare number",
        ),
        pytest.param(
            '"26 mm"',
            '"26"',
            UnitError,
            r"rotating_group.pitch_radius = '26' has no unit; write .* \"26 m\"",
            id="no unit",
        ),
        pytest.param(
            ', source = "paper" }$',
            " }",
            DataError,
            r'rotating_group.piston_count has no source; add source = "..."',
            id="no source",
        ),
        pytest.param(
            '"26 mm"',
            '["26 mm", "27 mm"]',
            DataError,
            r"rotating_group.pitch_radius = .* must be one quantity",
            id="list for one quantity",
        ),
        pytest.param(
            r'\["35 mm", "140 mm", "170 mm"\]',
            '"35 mm"',
            DataError,
            "bearings.positions = '35 mm' must be a list of qu",
            id="one quantity for a list",
        ),
        pytest.param(
            r', "170 mm"\]',
            "]",
            InputError,
            "bearings: positions and stiffnesses must be lists of the same length",
            id="lists of different lengths",
        ),
    ],
)
def test_a_malformed_quantity_is_reported_with_its_remedy(
    tmp_path: Path, pattern: str, replacement: str, error: type[Exception], message: str
) -> None:
    path = write_edited_pump(tmp_path, pattern, replacement)
    assert_load_fails(path, error, message)


@pytest.mark.parametrize(
    ("pattern", "replacement", "message"),
    [
        pytest.param(
            "^pitch_radius",
            "pitch_radios",
            r"\[rotating_group\] has an unknown entry 'pitch_radios'; "
            "the entries are piston_count,.* pitch_radius",
            id="misspelled entry",
        ),
        pytest.param(
            "^pitch_radius = .*$",
            "",
            r"\[rotating_group\] lacks pitch_radius \(unit m\)",
            id="missing entry",
        ),
        pytest.param(
            r"^\[oil\]$",
            "[oils]",
            "the pump has an unknown entry 'oils'; the entries are format, name, rot",
            id="misspelled table",
        ),
        pytest.param(
            r"^\[interfaces.block_valve\]$",
            "[interfaces.block_valves]",
            r"\[interfaces\] has an unknown entry 'block_valves'; "
            "the entries are slipper_swash, block_valve, pis",
            id="misspelled interface",
        ),
        pytest.param(
            "^format = 1$",
            "format = 2",
            "format is 2; this version reads format = 1",
            id="newer format",
        ),
        pytest.param("^format = 1$", "format = = 1", "not valid TOML: .*line 4", id="invalid TOML"),
    ],
)
def test_an_unknown_or_missing_entry_is_reported_with_its_remedy(
    tmp_path: Path, pattern: str, replacement: str, message: str
) -> None:
    path = write_edited_pump(tmp_path, pattern, replacement)
    assert_load_fails(path, DataError, message)


@pytest.mark.parametrize(
    ("pattern", "replacement", "message"),
    [
        pytest.param(
            '"26 mm"',
            '"-26 mm"',
            r"rotating_group.pitch_radius \(-0.026 m\) must be positive",
            id="negative length",
        ),
        pytest.param(
            '"870 kg/m\\^3"',
            '"0 kg/m^3"',
            r"oil.density \(0 kg/m\^3\) must be positive",
            id="zero density",
        ),
        pytest.param(
            '"7"',
            '"7.5"',
            r"rotating_group.piston_count \(7.5\) must be a whole number",
            id="half a piston",
        ),
        pytest.param('"7"', '"2"', r"piston_count \(2\) must lie in 3...19", id="two pistons"),
        pytest.param(
            '"0.6"',
            '"6"',
            r"piston_eccentricity \(6\) must lie in 0...1",
            id="eccentricity above 1",
        ),
        pytest.param(
            '"0.92"',
            '"1.1"',
            r"balance_ratio \(1.1\) must be below 1: otherwise the oil pushes",
            id="balance ratio above 1",
        ),
    ],
)
def test_an_impossible_value_is_reported_with_its_remedy(
    tmp_path: Path, pattern: str, replacement: str, message: str
) -> None:
    path = write_edited_pump(tmp_path, pattern, replacement)
    assert_load_fails(path, InputError, message)


@pytest.mark.parametrize(
    ("pattern", "replacement", "message"),
    [
        pytest.param(
            '"7"',
            '"11"',
            r"11 bores of 17 mm overlap on a pitch radius of 26 mm; enlarge pitch_radius",
            id="overlapping bores",
        ),
        pytest.param(
            '"26 mm"',
            '"26 m"',
            r"give 2.494e\+04 mL per revolution, outside 0.01...5000 mL",
            id="pitch radius in meters",
        ),
        pytest.param(
            '"29 mm"',
            '"39 mm"',
            r"valve_plate.outer_land_inner_radius \(0.039\) "
            r"must be below outer_land_outer_radius \(0.033\)",
            id="land of negative width",
        ),
        pytest.param(
            '"26 mm"',
            '"31 mm"',
            r"pitch_radius \(31 mm\) must lie between the sealing lands "
            r".* below outer_land_inner_radius \(29 mm\)",
            id="bores on the sealing land",
        ),
        pytest.param(
            '"22 mm"',
            '"23 mm"',
            r"7 slippers of 23 mm overlap .* 22.56 mm apart",
            id="overlapping slippers",
        ),
        pytest.param(
            '"16.8 deg"',
            '"35 deg"',
            r"the stroke of 36.41 mm .* pulls the pistons out .* over 35 mm",
            id="pistons leave their bores",
        ),
        pytest.param(
            '"0.8 mm"',
            '"18 mm"',
            r"orifice_diameter \(18 mm\) must be below pocket_diameter \(14 mm\)",
            id="orifice wider than its pocket",
        ),
        pytest.param(
            '"358 deg"',
            '"372 deg"',
            r"kidneys overlap at top dead center: discharge_close .372 deg. .*370",
            id="overlapping kidneys",
        ),
        pytest.param(
            '"8 deg"',
            '"80 deg"',
            r"groove of 80 deg .* cannot be milled",
            id="groove of a quarter turn",
        ),
        pytest.param(
            'film_radius = { value = "26 mm"',
            'film_radius = { value = "36 mm"',
            r"film_radius \(36 mm\) must lie on the valve plate",
            id="film beside the valve plate",
        ),
        pytest.param(
            '"194 deg"',
            '"170 deg"',
            r"valve_plate.suction_close \(3.107\) must be below discharge_open \(2.967\)",
            id="kidneys in a wrong order",
        ),
    ],
)
def test_an_impossible_geometry_is_reported_with_its_remedy(
    tmp_path: Path, pattern: str, replacement: str, message: str
) -> None:
    path = write_edited_pump(tmp_path, pattern, replacement)
    assert_load_fails(path, InputError, message)


@pytest.mark.parametrize(
    ("pattern", "replacement", "message"),
    [
        pytest.param('^name = "cover_z"$', "", r"sensors\[0\] lacks name", id="no name"),
        pytest.param(
            r"direction = \[0, 1, 0\]",
            'direction = ["0", "1", "0"]',
            "must be bare numbers: it has no unit",
            id="direction in quotation marks",
        ),
        pytest.param(
            r"direction = \[0, 1, 0\]",
            "direction = [0, 0, 0]",
            r"sensors\[1\].direction .* must be finite",
            id="direction of length zero",
        ),
        pytest.param(
            r'\["0 mm", "80 mm", "50 mm"\]',
            '"80 mm"',
            r"sensors\[1\].position = '80 mm' must be a list of",
            id="position of one coordinate",
        ),
        pytest.param(
            '"body_y"',
            '"cover_z"',
            r"sensors\[1\]: another sensor is already named 'cover_z'",
            id="name used twice",
        ),
        pytest.param(
            r"^(\[\[sensors\]\]\n(.+\n)+\n*)+",
            "",
            r"no \[\[sensors\]\]; give at least one",
            id="no sensor",
        ),
    ],
)
def test_a_wrong_sensor_is_reported_with_its_remedy(
    tmp_path: Path, pattern: str, replacement: str, message: str
) -> None:
    path = write_edited_pump(tmp_path, pattern, replacement)
    assert_load_fails(path, DataError, message)


def test_an_unknown_pump_is_answered_with_those_that_exist() -> None:
    message = r"Unknown pump '25scy': must be one of 25scy14-1b, 25scy14-1b-13, or a"
    with pytest.raises(MissingFileError, match=message):
        load_pump("25scy")


def test_a_file_takes_what_it_lacks_from_the_pump_that_it_is_like(
    pump: Pump, tmp_path: Path
) -> None:
    sensor = (
        '[[sensors]]\nname = "a"\n'
        'position = {value = ["1 mm", "2 mm", "3 mm"], source = "s"}\n'
        "direction = [0, 0, 1]"
    )

    mine = load_pump(write_pump(tmp_path, f'format = 1\nlike = "25scy14-1b"\n{sensor}'))

    assert mine.name == "mine"
    assert mine.channels == ("a",)
    assert replace(mine, name=pump.name, sensors=pump.sensors) == pump
    assert mine.sources["sensors[0].position"] == "s"
    assert mine.sources["masses.shell"] == pump.sources["masses.shell"]


def test_a_file_cannot_be_like_an_unknown_pump(tmp_path: Path) -> None:
    path = write_pump(tmp_path, 'format = 1\nlike = "other"')
    with pytest.raises(DataError, match=r"like = 'other' must be one of 25scy14-1b,"):
        load_pump(path)


def test_a_new_pump_is_a_copy_under_another_name(pump: Pump, tmp_path: Path) -> None:
    path = new_pump("mine", folder=tmp_path)
    assert path == tmp_path / "mine.toml"

    mine = load_pump(path)
    assert mine == replace(pump, name="mine")
    assert dict(mine.sources) == dict(pump.sources)


def test_the_file_of_a_new_pump_states_its_origin_and_keeps_all_comments(tmp_path: Path) -> None:
    text = new_pump("mine", folder=tmp_path).read_text(encoding="utf-8")

    assert text.startswith("# Copied from 25scy14-1b.toml; edit the values and their sources.\n")
    for line in PUMP_FILE.splitlines():
        if line.startswith("#"):
            assert line in text


def test_a_new_pump_overwrites_no_file(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text("precious")

    message = r"mine\.toml already exists; choose another name or remove it"
    with pytest.raises(InputError, match=message):
        new_pump("mine", folder=tmp_path)

    assert (tmp_path / "mine.toml").read_text() == "precious"
    assert os.listdir(tmp_path) == ["mine.toml"]


@pytest.mark.parametrize("name", ["", "a/b", "../a", "a b", 'a"b', ".hidden", "a\n"])
def test_a_pump_name_that_is_no_file_name_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match=r"Invalid pump name .*: use letters, digits"):
        new_pump(name, folder=tmp_path)

    assert os.listdir(tmp_path) == []


@given(values=st.lists(st.floats(1e-3, 1e12), min_size=6, max_size=6))
def test_the_six_interface_values_keep_their_order(values: list[float]) -> None:
    interfaces = Interfaces.from_values(values)

    assert interfaces.values() == tuple(values)
    for path, value in zip(PARAMETERS, values, strict=True):
        # such as block_valve.stiffness
        joint, kind = path.split(".")
        assert getattr(getattr(interfaces, joint), kind) == value


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_an_interface_value_that_is_not_positive_is_named(value: float) -> None:
    message = rf"block_valve.stiffness \({value:g}\) must be a positive number"
    with pytest.raises(InputError, match=message):
        Interfaces.from_values([1, 1, 1, value, 1, 1])
