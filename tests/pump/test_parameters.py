"""Pumps, their files, and every way in which a file can be wrong."""

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

TEXT = (resources.files("swashtwin.pump") / "pumps" / "25scy14-1b.toml").read_text(encoding="utf-8")


def save(folder: Path, text: str) -> Path:
    path = folder / "mine.toml"
    path.write_text(text, encoding="utf-8")
    return path


def edited(folder: Path, old: str, new: str) -> Path:
    """Pump file in which the first `old` (a regular expression) reads `new`."""
    text, count = re.subn(old, lambda _: new, TEXT, count=1, flags=re.MULTILINE)
    assert count == 1, f"{old} is not in the file"
    return save(folder, text)


def tables_of(pump: Pump) -> dict[str, Any]:
    """The pump as its file holds it."""
    tables: dict[str, Any] = {"format": 1, "name": pump.name}
    tables["sensors"] = [
        {"name": sensor.name, "direction": list(sensor.direction)} for sensor in pump.sensors
    ]
    for path, value, unit in pump_numbers(pump):
        texts = [
            f"{number!r} {unit}".removesuffix(" 1")
            for number in (value if type(value) is tuple else [value])
        ]
        table: Any = tables
        *sections, name = path.replace("[", ".").replace("]", "").split(".")
        for section in sections:
            table = table[int(section)] if section.isdecimal() else table.setdefault(section, {})
        table[name] = {"value": texts if type(value) is tuple else texts[0], "source": "test"}
    return tables


def test_the_papers_pump_displaces_what_its_name_plate_says(pump: Pump) -> None:
    group = pump.rotating_group
    expected = 7 * math.pi / 4 * mm(17) ** 2 * 2 * mm(26) * math.tan(deg(16.8))
    assert group.displacement == pytest.approx(expected, rel=1e-12)
    assert group.displacement == pytest.approx(25e-6, rel=0.01)
    assert pump.channels == ("cover_z", "body_y", "body_x")


def test_every_number_of_every_pump_has_a_source() -> None:
    for name in available_pumps():
        pump = load_pump(name)
        paths = {path for path, _, _ in pump_numbers(pump)}
        assert len(paths) > 60
        assert paths == set(pump.sources)
        assert all(source.strip() for source in pump.sources.values())


@settings(
    max_examples=10, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(factors=st.lists(st.floats(0.99, 1.01), min_size=150, max_size=150))
def test_any_pump_comes_back_from_its_file_as_it_was(
    pump: Pump, tmp_path: Path, factors: list[float]
) -> None:
    supply = iter(factors)

    def varied(path: str, value: Any, unit: str) -> Any:
        if isinstance(value, tuple):
            return tuple(number * next(supply) for number in value)
        return value * next(supply) if isinstance(value, float) else value

    written = map_numbers(pump, varied)
    back = load_pump(save(tmp_path, tomli_w.dumps(tables_of(written))))
    for (path, number, _), (_, expected, _) in zip(
        pump_numbers(back), pump_numbers(written), strict=True
    ):
        assert number == pytest.approx(expected, rel=6e-15), path  # 15 digits are kept
    assert (back.name, back.channels) == (written.name, written.channels)


@pytest.mark.parametrize(
    ("old", "new", "error", "message"),
    [
        ("^pitch_radius = .*$", "pitch_radius = 26", UnitError,
         r'rotating_group.pitch_radius = 26 is a bare value; write pitch_radius = { value = "... m", source = "..." }'),
        ('"26 mm"', '"26"', UnitError, r"rotating_group.pitch_radius = '26' has no unit; write .* \"26 m\""),
        (', source = "paper" }$', " }", DataError, r'rotating_group.piston_count has no source; add source = "..."'),
        ("^pitch_radius", "pitch_radios", DataError,
         r"\[rotating_group\] has an unknown entry 'pitch_radios'; the entries are piston_count,.* pitch_radius"),
        ("^pitch_radius = .*$", "", DataError, r"\[rotating_group\] lacks pitch_radius \(unit m\)"),
        (r"^\[oil\]$", "[oils]", DataError, "the pump has an unknown entry 'oils'; the entries are format, name, rot"),
        (r"^\[interfaces.block_valve\]$", "[interfaces.block_valves]", DataError,
         r"\[interfaces\] has an unknown entry 'block_valves'; the entries are slipper_swash, block_valve, pis"),
        ("^format = 1$", "format = 2", DataError, "format is 2; this version reads format = 1"),
        ("^format = 1$", "format = = 1", DataError, "not valid TOML: .*line 4"),
        ('"26 mm"', '["26 mm", "27 mm"]', DataError, r"rotating_group.pitch_radius = .* must be one quantity"),
        (r'\["35 mm", "140 mm", "170 mm"\]', '"35 mm"', DataError, "bearings.positions = '35 mm' must be a list of qu"),
        (r', "170 mm"\]', "]", InputError, "bearings: positions and stiffnesses must be lists of the same length"),
        ('"26 mm"', '"-26 mm"', InputError, r"rotating_group.pitch_radius \(-0.026 m\) must be positive"),
        ('"870 kg/m\\^3"', '"0 kg/m^3"', InputError, r"oil.density \(0 kg/m\^3\) must be positive"),
        ('"7"', '"7.5"', InputError, r"rotating_group.piston_count \(7.5\) must be a whole number"),
        ('"7"', '"2"', InputError, r"piston_count \(2\) must lie in 3...19"),
        ('"7"', '"11"', InputError, r"11 bores of 17 mm overlap on a pitch radius of 26 mm; enlarge pitch_radius"),
        ('"26 mm"', '"26 m"', InputError, r"give 2.494e\+04 mL per revolution, outside 0.01...5000 mL"),
        ('"0.6"', '"6"', InputError, r"piston_eccentricity \(6\) must lie in 0...1"),
        ('"29 mm"', '"39 mm"', InputError,
         r"valve_plate.outer_land_inner_radius \(0.039\) must be below outer_land_outer_radius \(0.033\)"),
        ('"26 mm"', '"31 mm"', InputError,
         r"pitch_radius \(31 mm\) must lie between the sealing lands .* below outer_land_inner_radius \(29 mm\)"),
        ('"22 mm"', '"23 mm"', InputError, r"7 slippers of 23 mm overlap .* 22.56 mm apart"),
        ('"16.8 deg"', '"35 deg"', InputError, r"the stroke of 36.41 mm .* pulls the pistons out .* over 35 mm"),
        ('"0.8 mm"', '"18 mm"', InputError, r"orifice_diameter \(18 mm\) must be below pocket_diameter \(14 mm\)"),
        ('"358 deg"', '"372 deg"', InputError, r"kidneys overlap at top dead center: discharge_close .372 deg. .*370"),
        ('"8 deg"', '"80 deg"', InputError, r"groove of 80 deg .* cannot be milled"),
        ('"0.92"', '"1.1"', InputError, r"balance_ratio \(1.1\) must be below 1: otherwise the oil pushes"),
        ('film_radius = { value = "26 mm"', 'film_radius = { value = "36 mm"', InputError,
         r"film_radius \(36 mm\) must lie on the valve plate"),
        ('"194 deg"', '"170 deg"', InputError,
         r"valve_plate.suction_close \(3.107\) must be below discharge_open \(2.967\)"),
        ('^name = "cover_z"$', "", DataError, r"sensors\[0\] lacks name"),
        (r"direction = \[0, 1, 0\]", 'direction = ["0", "1", "0"]', DataError, "must be bare numbers: it has no unit"),
        (r"direction = \[0, 1, 0\]", "direction = [0, 0, 0]", DataError, r"sensors\[1\].direction .* must be finite"),
        (r'\["0 mm", "80 mm", "50 mm"\]', '"80 mm"', DataError, r"sensors\[1\].position = '80 mm' must be a list of"),
        ('"body_y"', '"cover_z"', DataError, r"sensors\[1\]: another sensor is already named 'cover_z'"),
        (r"^(\[\[sensors\]\]\n(.+\n)+\n*)+", "", DataError, r"no \[\[sensors\]\]; give at least one"),
    ],
)  # fmt: skip
def test_a_wrong_file_is_refused_in_one_line_that_names_file_entry_and_remedy(
    tmp_path: Path, old: str, new: str, error: type[Exception], message: str
) -> None:
    path = edited(tmp_path, old, new)
    with pytest.raises(error, match=message) as caught:
        load_pump(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)
    assert type(caught.value) is error


def test_an_unknown_pump_is_answered_with_those_there_are() -> None:
    with pytest.raises(
        MissingFileError,
        match=r"Unknown pump '25scy': must be one of 25scy14-1b, 25scy14-1b-13, or a",
    ):
        load_pump("25scy")


def test_a_file_takes_what_it_lacks_from_the_pump_it_is_like(pump: Pump, tmp_path: Path) -> None:
    sensor = '[[sensors]]\nname = "a"\nposition = {value = ["1 mm", "2 mm", "3 mm"], source = "s"}\ndirection = [0, 0, 1]'
    mine = load_pump(save(tmp_path, f'format = 1\nlike = "25scy14-1b"\n{sensor}'))
    assert mine.name == "mine"
    assert mine.channels == ("a",)
    assert replace(mine, name=pump.name, sensors=pump.sensors) == pump
    assert mine.sources["sensors[0].position"] == "s"
    assert mine.sources["masses.shell"] == pump.sources["masses.shell"]
    with pytest.raises(DataError, match=r"like = 'other' must be one of 25scy14-1b,"):
        load_pump(save(tmp_path, 'format = 1\nlike = "other"'))


def test_a_new_pump_is_its_model_under_another_name(pump: Pump, tmp_path: Path) -> None:
    path = new_pump("mine", folder=tmp_path)
    assert path == tmp_path / "mine.toml"
    mine = load_pump(path)
    assert mine == replace(pump, name="mine")
    assert dict(mine.sources) == dict(pump.sources)
    text = path.read_text(encoding="utf-8")
    assert text.startswith("# Copied from 25scy14-1b.toml; edit the values and their sources.\n")
    assert all(line in text for line in TEXT.splitlines() if line.startswith("#"))


def test_a_new_pump_overwrites_nothing(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text("precious")
    with pytest.raises(
        InputError, match=r"mine\.toml already exists; choose another name or remove it"
    ):
        new_pump("mine", folder=tmp_path)
    assert (tmp_path / "mine.toml").read_text() == "precious"
    assert os.listdir(tmp_path) == ["mine.toml"]


@pytest.mark.parametrize("name", ["", "a/b", "../a", "a b", 'a"b', ".hidden", "a\n"])
def test_a_name_that_is_none_for_a_file_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match=r"Invalid pump name .*: use letters, digits"):
        new_pump(name, folder=tmp_path)
    assert os.listdir(tmp_path) == []


@given(values=st.lists(st.floats(1e-3, 1e12), min_size=6, max_size=6))
def test_the_six_values_come_back_in_their_order(values: list[float]) -> None:
    interfaces = Interfaces.from_values(values)
    assert interfaces.values() == tuple(values)
    for name, value in zip(PARAMETERS, values, strict=True):
        joint, kind = name.split(".")
        assert getattr(getattr(interfaces, joint), kind) == value


@pytest.mark.parametrize("wrong", [0.0, -1.0, math.nan, math.inf])
def test_an_interface_value_that_is_not_positive_is_named(wrong: float) -> None:
    with pytest.raises(
        InputError, match=rf"block_valve.stiffness \({wrong:g}\) must be a positive number"
    ):
        Interfaces.from_values([1, 1, 1, wrong, 1, 1])
