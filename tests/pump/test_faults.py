"""Class names and faults with dimensions."""

import math
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swashtwin.foundation import InputError, mm
from swashtwin.pump import (
    CLASSES,
    FAULT_KINDS,
    canonical_label,
    is_healthy,
    propose_class,
)

FAULTS: tuple[Any, ...] = tuple(FAULT_KINDS[name] for name in FAULT_KINDS if name != "normal")
PAPERS = FAULTS[0]


@pytest.mark.parametrize("name", CLASSES)
@pytest.mark.parametrize("spelling", ["{}", " {} ", "{} fault", "{}_fault", "{}-Fault"])
def test_a_class_is_known_however_it_is_spelled(name: str, spelling: str) -> None:
    for word in (name, name.upper(), name.replace("_", " "), name.replace("_", "-")):
        assert canonical_label(spelling.format(word)) == name


@pytest.mark.parametrize(
    ("text", "nearest"),
    [
        ("pistn", "piston"),
        ("swahs plate", "swash_plate"),
        ("plungr", "piston"),
        ("valv_plate", "valve_plate"),
    ],
)
def test_an_unknown_class_offers_the_nearest(text: str, nearest: str) -> None:
    with pytest.raises(
        InputError,
        match=f"Invalid class '{text}': must be one of normal, swash_plate.* Did you mean '{nearest}'?",
    ):
        canonical_label(text)


@pytest.mark.wrong_types
def test_what_is_no_text_is_no_class() -> None:
    with pytest.raises(InputError, match=r"^Invalid class 3: must be one of normal"):
        canonical_label(3)  # type: ignore[arg-type]


@given(fault=st.sampled_from(FAULTS), factor=st.floats(0, 2))
def test_scaling_a_fault_scales_its_severity_and_nothing_else(fault: Any, factor: float) -> None:
    scaled = fault.scaled(factor)
    first = next(iter(vars(fault)))
    assert scaled.severity == pytest.approx(factor * fault.severity, rel=1e-15)
    assert replace(scaled, **{first: fault.severity}) == fault
    assert scaled.label == fault.label


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: type(fault).__name__)
@pytest.mark.parametrize("value", [-1e-9, math.nan, math.inf])
def test_a_severity_is_zero_or_positive(fault: Any, value: float) -> None:
    first = next(iter(vars(fault)))
    with pytest.raises(
        InputError, match=rf"{type(fault).__name__}\.{first} .* must be zero or a positive number"
    ):
        replace(fault, **{first: value})


@pytest.mark.parametrize(
    ("kind", "changes", "message"),
    [
        ("swash_plate", {"length": 30}, ""),
        ("swash_plate", {"width": 24}, ""),
        ("swash_plate", {"depth": 0.6}, ""),
        ("piston", {"clearance": 40}, ""),
        ("cylinder_block", {"depth": 0.15}, ""),
        ("valve_plate", {"film_increase": 0.01}, ""),
        ("loose_slipper", {"clearance": 0.1}, ""),
        ("swash_plate", {"length": 0.0}, "length and width must be positive"),
        ("swash_plate", {"width": 0.0}, "length and width must be positive"),
        (
            "tilted_block",
            {"variation": 1.0},
            r"variation \(1\) must be below 1: a film cannot pull",
        ),
        ("scratched_valve_plate", {"width": 0.0}, "DamScratch.width must be positive"),
        (
            "swash_plate",
            {"contact": "none"},
            r"contact \('none'\) must be one of shared, literal, physical",
        ),
    ],
)
@pytest.mark.wrong_types
def test_an_impossible_dimension_or_one_in_millimeters_is_refused(
    kind: str, changes: dict[str, Any], message: str
) -> None:
    (name, value), = changes.items()  # fmt: skip
    message = message or rf"{name} \({value:g} m\) exceeds .* in meters: 30 mm is mm\(30\)"
    with pytest.raises(InputError, match=message):
        replace(FAULT_KINDS[kind], **changes)  # type: ignore[type-var]


@given(length=st.floats(1e-3, 0.3), width=st.floats(1e-3, 0.3))
def test_a_slipper_reaches_the_whole_depth_only_of_a_recess_larger_than_itself(
    length: float, width: float
) -> None:
    defect = replace(PAPERS, length=length, width=width)
    reached = defect.effective_depth(mm(22))
    assert 0 <= reached <= defect.depth
    assert (reached == defect.depth) == (length >= mm(22) and width >= mm(22))


def test_what_people_call_a_sound_machine_is_healthy_in_any_spelling() -> None:
    labels = (
        "normal",
        "healthy",
        "ok",
        "Healthy",
        " OK ",
        "gut",
        "Good",
        "baseline",
        "GESUND",
        "in Ordnung",
        "i.O.",
    )
    labels += ("fault-free", "no_fault", "unbescha\u0308digt", "ｏｋ")
    assert all(is_healthy(label) for label in labels)
    assert not any(
        is_healthy(label)
        for label in (None, "", "piston", "abnormal", "unhealthy", "not ok", "n.i.O.")
    )
    assert canonical_label("Gut") == "normal"


@pytest.mark.parametrize(
    ("label", "fault"),
    [
        ("Axialkolbenpumpe A4", None),
        ("柱塞泵", None),
        ("piston ok", None),
        ("ohne Kolbenschaden", None),
        ("hospiston", None),
        ("piston pump, valve plate worn", "valve_plate"),
        ("柱塞泵滑靴松动", "loose_slipper"),
        ("Kolbenschuh lose", "loose_slipper"),
        ("Verschleiss_Kolben", "piston"),
    ],
)
def test_a_word_for_the_machine_or_a_sound_part_proposes_no_fault(
    label: str, fault: str | None
) -> None:
    assert propose_class(label) == fault
