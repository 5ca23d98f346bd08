"""Names that are suggested for a name that does not exist."""

import pytest

from swashtwin.foundation import closest_name

CLASSES = ("normal", "swash_plate", "cylinder_block", "piston", "valve_plate")


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        pytest.param("pistn", "piston", id="missing letter"),
        pytest.param("psiton", "piston", id="swapped letters"),
        pytest.param("Swash Plate", "swash_plate", id="other separator"),
        pytest.param("cylindre_bloc", "cylinder_block", id="two slips in a long name"),
        pytest.param("cylinder", "cylinder_block", id="abbreviation"),
        pytest.param("PI", "pi", id="two letters in capitals"),
    ],
)
def test_a_slip_or_an_abbreviation_is_suggested(name: str, expected: str) -> None:
    assert closest_name(name, (*CLASSES, "pi")) == expected


@pytest.mark.parametrize(
    ("name", "names"),
    [
        pytest.param("swash_plate", ("normal", "valve_plate"), id="other part"),
        pytest.param("port_plate", CLASSES, id="shared second word"),
        pytest.param("position", CLASSES, id="similar word"),
        pytest.param("bearing_2", ("bearing_1", "bearing_3"), id="other number"),
        pytest.param("wear", ("wear_high", "wear_low"), id="ambiguous abbreviation"),
        pytest.param("x" * 1_000_000, CLASSES, id="a million letters"),
        pytest.param("piston", (), id="no names"),
        pytest.param("x", ("c",), id="one letter"),
        pytest.param("lr", ("rr", "lf"), id="two letters"),
        pytest.param("de", ("nde", "d"), id="two letters of a place"),
    ],
)
def test_another_name_is_not_suggested(name: str, names: tuple[str, ...]) -> None:
    assert closest_name(name, names) is None
