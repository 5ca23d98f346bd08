"""Class names and faults with dimensions."""

import math
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swashtwin.foundation import InputError, UnitError, mm
from swashtwin.pump import (
    CLASSES,
    FAULT_KINDS,
    canonical_label,
    is_healthy,
    propose_class,
    read_fault,
)

FAULTS: tuple[Any, ...] = tuple(fault for name, fault in FAULT_KINDS.items() if name != "normal")
SWASH_PLATE_DEFECT = FAULTS[0]


def main_dimension(fault: Any) -> str:
    """Return the name of a fault's first dimension, which is its severity."""
    return next(iter(vars(fault)))


@pytest.mark.parametrize("name", CLASSES)
@pytest.mark.parametrize("spelling", ["{}", " {} ", "{} fault", "{}_fault", "{}-Fault"])
def test_a_class_is_known_in_every_spelling(name: str, spelling: str) -> None:
    for text in (name, name.upper(), name.replace("_", " "), name.replace("_", "-")):
        assert canonical_label(spelling.format(text)) == name


@pytest.mark.parametrize(
    ("text", "nearest"),
    [
        ("pistn", "piston"),
        ("swahs plate", "swash_plate"),
        ("plungr", "piston"),
        ("valv_plate", "valve_plate"),
    ],
)
def test_a_misspelled_class_is_answered_with_the_nearest(text: str, nearest: str) -> None:
    message = (
        f"Invalid class '{text}': must be one of normal, swash_plate.* Did you mean '{nearest}'?"
    )
    with pytest.raises(InputError, match=message):
        canonical_label(text)


@pytest.mark.wrong_types
def test_a_number_is_no_class() -> None:
    with pytest.raises(InputError, match=r"^Invalid class 3: must be one of normal"):
        canonical_label(3)  # type: ignore[arg-type]


@given(fault=st.sampled_from(FAULTS), factor=st.floats(0, 2))
def test_scaling_a_fault_scales_its_severity_and_nothing_else(fault: Any, factor: float) -> None:
    scaled = fault.scaled(factor)

    assert scaled.severity == pytest.approx(factor * fault.severity, rel=1e-15)
    assert replace(scaled, **{main_dimension(fault): fault.severity}) == fault
    assert scaled.label == fault.label


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: type(fault).__name__)
@pytest.mark.parametrize("value", [-1e-9, math.nan, math.inf])
def test_a_severity_must_be_zero_or_positive(fault: Any, value: float) -> None:
    dimension = main_dimension(fault)

    message = rf"{type(fault).__name__}\.{dimension} .* must be zero or a positive number"
    with pytest.raises(InputError, match=message):
        replace(fault, **{dimension: value})


@pytest.mark.parametrize(
    ("kind", "dimension", "value"),
    [
        ("swash_plate", "length", 30),
        ("swash_plate", "width", 24),
        ("swash_plate", "depth", 0.6),
        ("piston", "clearance", 40),
        ("cylinder_block", "depth", 0.15),
        ("valve_plate", "film_increase", 0.01),
        ("loose_slipper", "clearance", 0.1),
    ],
)
@pytest.mark.wrong_types
def test_a_dimension_in_millimeters_is_refused_with_its_remedy(
    kind: str, dimension: str, value: float
) -> None:
    message = rf"{dimension} \({value:g} m\) exceeds .* in meters: 30 mm is mm\(30\)"
    with pytest.raises(InputError, match=message):
        replace(FAULT_KINDS[kind], **{dimension: value})  # type: ignore[type-var]


@pytest.mark.parametrize(
    ("kind", "changes", "message"),
    [
        pytest.param(
            "swash_plate", {"length": 0.0}, "length and width must be positive", id="no length"
        ),
        pytest.param(
            "swash_plate", {"width": 0.0}, "length and width must be positive", id="no width"
        ),
        pytest.param(
            "tilted_block",
            {"variation": 1.0},
            r"variation \(1\) must be below 1: a film cannot pull",
            id="film that opens",
        ),
        pytest.param(
            "scratched_valve_plate",
            {"width": 0.0},
            "DamScratch.width must be positive",
            id="scratch without width",
        ),
        pytest.param(
            "swash_plate",
            {"contact": "none"},
            r"contact \('none'\) must be one of shared, literal, physical",
            id="unknown contact law",
        ),
    ],
)
@pytest.mark.wrong_types
def test_an_impossible_dimension_is_refused(
    kind: str, changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        replace(FAULT_KINDS[kind], **changes)  # type: ignore[type-var]


@given(length=st.floats(1e-3, 0.3), width=st.floats(1e-3, 0.3))
def test_a_slipper_reaches_the_whole_depth_only_of_a_recess_larger_than_itself(
    length: float, width: float
) -> None:
    slipper_diameter = mm(22)
    defect = replace(SWASH_PLATE_DEFECT, length=length, width=width)

    depth = defect.effective_depth(slipper_diameter)

    assert 0 <= depth <= defect.depth
    is_larger = length >= slipper_diameter and width >= slipper_diameter
    assert (depth == defect.depth) == is_larger


@pytest.mark.parametrize(
    "label",
    [
        *("normal", "healthy", "ok", "Healthy", " OK ", "Good", "baseline"),
        *("gut", "GESUND", "in Ordnung", "i.O."),
        *("fault-free", "no_fault"),
        # an umlaut of two characters, and letters of full width as in Chinese text
        *("unbescha\u0308digt", "ｏｋ"),
    ],
)
def test_a_label_for_a_sound_machine_is_healthy(label: str) -> None:
    assert is_healthy(label)


@pytest.mark.parametrize("label", [None, "", "piston", "abnormal", "unhealthy", "not ok", "n.i.O."])
def test_a_label_that_is_absent_or_negated_is_not_healthy(label: str | None) -> None:
    assert not is_healthy(label)


def test_a_healthy_label_belongs_to_the_class_normal() -> None:
    assert canonical_label("Gut") == "normal"


@pytest.mark.parametrize(
    "label",
    [
        # `Kolben` and 柱塞 (piston) as part of the word for the machine
        "Axialkolbenpumpe A4",
        "柱塞泵",
        "piston ok",
        "ohne Kolbenschaden",
        # another word that contains the name of a part
        "hospiston",
    ],
)
def test_a_word_for_the_machine_or_a_sound_part_proposes_no_fault(label: str) -> None:
    assert propose_class(label) is None


@pytest.mark.parametrize(
    ("label", "fault"),
    [
        ("piston pump, valve plate worn", "valve_plate"),
        ("柱塞泵滑靴松动", "loose_slipper"),
        ("Kolbenschuh lose", "loose_slipper"),
        ("Verschleiss_Kolben", "piston"),
    ],
)
def test_a_label_in_words_proposes_the_fault_of_the_part_that_it_names(
    label: str, fault: str
) -> None:
    assert propose_class(label) == fault


def test_dimensions_within_the_name_of_a_fault_are_refused() -> None:
    # The word "piston" gave the typical clearance of 40 um instead.
    with pytest.raises(InputError, match="must be the name of a typical fault"):
        read_fault("piston:clearance=60um")


@pytest.mark.parametrize(
    ("kind", "dimension", "example"),
    [
        pytest.param("piston", "clearance", "40 um", id="clearance"),
        pytest.param("swash_plate", "depth", "0.6 mm", id="depth"),
    ],
)
def test_a_dimension_without_a_unit_is_refused_with_one_of_its_size(
    kind: str, dimension: str, example: str
) -> None:
    with pytest.raises(UnitError, match=f"has no unit. Write it like '{example}'"):
        read_fault(kind, **{dimension: "60"})
