"""The demo: what it counts, and that every class is filled where no fault was recorded."""

from types import SimpleNamespace

import pytest

from swashtwin.foundation import MPa
from swashtwin_bench import Demo, build_plan, summarize_demo

LABELS = ("piston", "normal", "piston", "normal")
NAMED = {
    "measured": ("normal", "normal", "normal", "piston"),
    "nominal": ("piston", "normal", "normal", "normal"),
    "calibrated": ("piston", "normal", "piston", None),
}
"""Classes that each training names, without a verdict in one case."""


@pytest.fixture
def demo() -> Demo:
    """What the summary of a demo reads; its study and its files are not made."""
    demo = object.__new__(Demo)
    demo.__dict__.update(
        pump="A",
        diagnoses={
            name: tuple(SimpleNamespace(label=label) for label in labels)
            for name, labels in NAMED.items()
        },
        labels=LABELS,
        shown_index=0,
    )
    return demo


def test_the_demo_counts_correct_verdicts_and_false_alarms(demo: Demo) -> None:
    assert [demo.count_correct(name) for name in NAMED] == [1, 3, 3]
    # no verdict is neither correct nor a false alarm
    assert [demo.count_false_alarms(name) for name in NAMED] == [1, 0, 0]


def test_the_answer_of_the_demo_has_all_three_trainings(demo: Demo) -> None:
    answer, limit, shown = summarize_demo(demo)
    counts = "1 (measured windows only), 3 (with nominal twin), 3 (with calibrated twin)"
    assert f"Classified correctly: {counts}, of 4 recordings" in answer
    assert "not a proof" in limit
    assert "piston fault, so this diagnosis is correct" in shown


def test_twins_of_the_demo_fill_every_class_where_no_fault_was_recorded() -> None:
    plan = build_plan("demo")
    assert plan.scenario.pressure == MPa(15)
    assert plan.scenario.scarce_windows == 0
    assert set(plan.scenario.scarce) == {"swash_plate", "cylinder_block", "piston", "valve_plate"}

    sources = {name: training_set.source for name, training_set in plan.training_sets.items()}
    assert sources == {"measured": None, "nominal": "nominal", "calibrated": "law"}
    assert all(entry.every_class for entry in plan.training_sets.values() if entry.source)
