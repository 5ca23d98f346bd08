"""Quantities with units: what they become in SI, and what is refused rather than guessed."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swashtwin.foundation import MPa, UnitError, bar, celsius, deg, parse_quantity, rpm, um, units

NUMBERS = st.floats(-1e9, 1e9, allow_nan=False).filter(lambda x: x == 0 or abs(x) > 1e-9)


@settings(deadline=None)  # the first quantity loads the table of units
@given(x=st.floats(0.01, 1e5))
def test_text_and_code_convert_alike(x: float) -> None:
    assert parse_quantity(f"{x} rpm", "rad/s") == pytest.approx(rpm(x), rel=1e-12)
    assert parse_quantity(f"{x} MPa", "Pa") == pytest.approx(MPa(x), rel=1e-12)
    assert parse_quantity(f"{x} bar", "Pa") == pytest.approx(bar(x), rel=1e-12)
    assert parse_quantity(f"{x} um", "m") == pytest.approx(um(x), rel=1e-12)
    assert parse_quantity(f"{x} deg", "rad") == pytest.approx(deg(x), rel=1e-12)
    assert parse_quantity(f"{x} degC", "K") == pytest.approx(celsius(x), rel=1e-12)


@pytest.mark.parametrize(
    ("text", "unit", "expected"),
    [
        ("7", "1", 7.0),
        ("15 %", "1", 0.15),
        (" 31mm ", "m", 0.031),
        ("+.5 m", "m", 0.5),
        ("2. m", "m", 2.0),
        ("1E-3 m", "m", 0.001),
        ("25.6 kHz", "Hz", 25600.0),
        ("14 Hz", "1/s", 14.0),
        ("860 r/min", "rad/s", 860 * math.pi / 30),
        ("2 rev/s", "rad/s", 4 * math.pi),
        ("3 rps", "rad/s", 6 * math.pi),
        ("45 °C", "K", 318.15),
        ("12 µm", "m", 12e-6),
        ("3 m²", "m^2", 3.0),
        ("3 mm**2", "m^2", 3e-6),
        ("0.0366 1/degC", "1/K", 0.0366),
        ("1.5e6 N*m/rad", "N*m/rad", 1.5e6),
        ("180 N·m/deg", "N*m/rad", 180 * 180 / math.pi),
        ("0.6 L", "m^3", 0.0006),
        ("25 Hz", "rad/s", 50 * math.pi),
        ("1500 1/min", "rad/s", 50 * math.pi),
        ("1500 U/min", "rad/s", 50 * math.pi),
        ("1500 RPM", "rad/s", 50 * math.pi),
        ("1500 min⁻¹", "rad/s", 50 * math.pi),
        ("15 Mpa", "Pa", 15e6),
        ("120BAR", "Pa", 12e6),
        ("120 kpa", "Pa", 120e3),
        ("2000 PSI", "Pa", 2000 * 6894.757293168361),
        ("20 khz", "Hz", 20e3),
        ("2 g", "m/s^2", 19.6133),
        ("2 m/s2", "m/s^2", 2.0),
        ("2 mm/s²", "m/s^2", 0.002),
        ("2 g", "kg", 0.002),
    ],
)
def test_a_quantity_is_one_number_and_its_unit(text: str, unit: str, expected: float) -> None:
    assert parse_quantity(text, unit) == pytest.approx(expected, rel=1e-14)


def test_a_decimal_number_of_millimeters_is_the_nearest_double() -> None:
    assert any(
        whole * 1e-3 != whole / 1000 for whole in range(1, 1000)
    )  # what plain multiplication costs
    for whole in range(1, 1000):
        assert parse_quantity(f"{whole} mm", "m") == whole / 1000


@pytest.mark.parametrize(
    ("text", "unit", "message"),
    [
        ("14 1/s", "rad/s", 'is a frequency; write it as "840 rpm"'),
        ("15 mPa", "Pa", 'is in thousandths of a pascal; was "15 MPa" meant?'),
        ("860 rpm", "Hz", 'is an angular speed; write it as "14.3333 Hz"'),
        ("90 rad/s", "Hz", 'is an angular speed; write it as "14.3239 Hz"'),
        ("1 N*m", "N*m/rad", "not a quantity in N*m/rad"),
        ("3 deg", "1", "must be a plain number; write it without a unit"),
        ("15 MPa", "m", "not a quantity in m; write it in m or a multiple of it"),
        ("3 m", "rad/s", "not a quantity in rad/s"),
    ],
)
def test_a_unit_of_another_dimension_is_refused_and_two_pi_never_slips_in(
    text: str, unit: str, message: str
) -> None:
    with pytest.raises(UnitError) as caught:
        parse_quantity(text, unit, name="it")
    assert str(caught.value).startswith(f"it = '{text}' ")
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("text", "unit", "example"),
    [
        ("31", "m", '"31 m"'),
        ("16.8", "rad", '"16.8 rad"'),
        ("860", "rad/s", '"860 rpm"'),
        ("15", "Pa", '"15 MPa"'),
    ],
)
def test_a_number_without_a_unit_is_refused_and_shown_with_one(
    text: str, unit: str, example: str
) -> None:
    with pytest.raises(UnitError, match=f"has no unit; write it with one, for example {example}"):
        parse_quantity(text, unit)


@pytest.mark.parametrize(
    "text",
    [
        "", "m", "1 foo", "1,5 mm", "1..2 m", "[1, 2] m", "1+2j m", "nan m", "inf m", "- 3 m", "1_0 m", "0x10 m",
        "3 (m", "3 m/", "3 m//", "3 m^0", "1 m + 2 m", "3 mm*2", "9**9**9 m", "3 m**99", "3 m**m", "1/0 m",
        "__import__('os') m",        "3 " + "m" * 5000 + "!",
    ],
)  # fmt: skip
def test_what_is_no_single_number_with_a_unit_is_refused_at_once(text: str) -> None:
    with pytest.raises(UnitError, match="is not a quantity; write a number and a unit") as caught:
        parse_quantity(text, "m", name="length")
    assert "\n" not in str(caught.value)


def test_an_infinite_number_is_refused() -> None:
    with pytest.raises(UnitError, match=r"1e400 m' is not finite"):
        parse_quantity("1e400 m", "m")


@pytest.mark.parametrize(("unit", "example"), [("m", '"17 m"'), ("1", '"17"')])
def test_a_bare_number_is_refused_even_where_no_unit_is_wanted(unit: str, example: str) -> None:
    with pytest.raises(
        UnitError, match=f"piston is the bare number 17; write it .* for example {example}"
    ):
        parse_quantity(17, unit, name="piston")


@given(
    number=NUMBERS,
    digits=st.integers(1, 17),
    symbol=st.sampled_from(sorted(set(units._COMMON) - {"1"})),
)
def test_a_common_unit_means_what_pint_says(number: float, digits: int, symbol: str) -> None:
    text = f"{number:.{digits}g} {symbol}"
    for target in {symbol, units._COMMON[symbol][0]}:
        value = parse_quantity(text, target)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(units, "_COMMON", {})
            assert parse_quantity(text, target) == value
