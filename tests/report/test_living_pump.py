"""The pump that turns on a page: what it draws is the twin's turn, and a fault is at its piston."""

import base64
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swashtwin import report
from swashtwin.foundation import um
from swashtwin.physics import Twin, solve_turn
from swashtwin.pump import FAULT_KINDS, OperatingCondition, PistonWear, Pump
from swashtwin.report import LivingPump, build_living_pumps, describe_turn
from swashtwin.report.living_pump import load_pump_source

STATIC = Path(report.__file__).parent / "static"


def unpacked(packed: dict[str, Any]) -> np.ndarray:
    """Return the rows of packed numbers, as the script does."""
    integers = np.frombuffer(base64.b64decode(packed["integers"]), "<i2")
    return packed["factor"] * integers.reshape(packed["rows"], -1)


def test_the_page_gets_the_numbers_of_the_twin(pump: Pump, at_15: OperatingCondition) -> None:
    twin = Twin(pump, at_15, bandwidth=1000.0)
    turn = solve_turn(twin)

    content = describe_turn(twin)

    for name, values in (
        ("chamber", 1e-6 * turn.chamber),
        ("discharge", 1e-6 * turn.discharge[None]),
        ("contact", turn.contact),
        ("waveform", turn.acceleration),
    ):
        # 16 bits of the largest value: far less than a pixel
        tolerance = np.abs(values).max() / 50_000
        assert np.abs(unpacked(content[name]) - values).max() <= tolerance, name
    assert content["shape"]["radius"] == 1e3 * pump.rotating_group.pitch_radius


@pytest.mark.parametrize("kind", [kind for kind, fault in FAULT_KINDS.items() if fault])
def test_every_fault_states_what_is_drawn(kind: str, pump: Pump, at_15: OperatingCondition) -> None:
    fault = describe_turn(Twin(pump, at_15, FAULT_KINDS[kind], bandwidth=1000.0))["fault"]
    assert fault["parts"]
    assert re.search(r"drawn|scale", fault["sentence"])


def test_a_fault_is_drawn_at_its_piston_at_a_round_factor(
    pump: Pump, at_15: OperatingCondition
) -> None:
    fault = PistonWear(clearance=um(45), piston=2)
    content = describe_turn(Twin(pump, at_15, fault, bandwidth=1000.0))["fault"]

    assert content["piston"] == 2
    # people count from 1
    assert "past piston 3" in content["sentence"]
    assert "45 µm, drawn 50 times as wide" in content["sentence"]
    assert content["gap"] == pytest.approx(50 * 0.045)


def test_a_machine_without_a_pump_file_gets_a_pump_of_its_number_of_pistons() -> None:
    (block,) = build_living_pumps("piston", pistons=9)

    assert block.content["chamber"]["rows"] == 9
    assert "a pump like 25scy14-1b with 9 pistons" in block.caption


def test_a_pump_is_shown_in_bar() -> None:
    (in_mpa,) = build_living_pumps("piston")
    (in_bar,) = build_living_pumps("piston", pressure_unit="bar")

    assert in_bar.content["pressureUnit"] == "bar"
    for name in ("chamber", "discharge"):
        pressures = unpacked(in_mpa.content[name])
        assert unpacked(in_bar.content[name]) == pytest.approx(10 * pressures), name
    assert "150 bar" in in_bar.caption
    assert "15 MPa" in in_mpa.caption


def test_no_name_ends_the_element_that_holds_the_numbers() -> None:
    html = LivingPump({"name": "</script><b>"}, "A <caption>").html
    numbers = re.findall(r'json">(.*?)</script>', html)

    assert [json.loads(text) for text in numbers] == [{"name": "</script><b>"}]
    assert "A &lt;caption&gt;" in html


def test_the_script_within_a_page_is_short() -> None:
    script = load_pump_source("js")
    assert len(script.encode()) <= 25_000
    assert "/*" not in script
    assert "export class LivingPump {" in script


def test_script_and_style_need_nothing_from_elsewhere() -> None:
    for file in ("living_pump.js", "living_pump.css"):
        text = (STATIC / file).read_text(encoding="utf-8")
        assert not re.search(r"https?:|\bimport\b|@import|url\(", text)
