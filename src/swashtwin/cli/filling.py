"""Options and output of commands by which twins fill the cells of training data."""

from collections.abc import Mapping, Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from swashtwin.cli.console import print_note, print_rows, progress, require_existing
from swashtwin.cli.options import fault_dimensions, fault_from
from swashtwin.foundation import InputError

if TYPE_CHECKING:
    from swashtwin.calibration import Calibration
    from swashtwin.learning import WindowSet
    from swashtwin.pump import Fault, Pump
    from swashtwin.recordings import Recording
    from swashtwin.synthesis import Filling, FillingPlan


class FillName(StrEnum):
    """Which cells twins fill (`synthesis.Fill`)."""

    cells = "cells"
    points = "points"
    all = "all"


FillOption = Annotated[
    FillName | None,
    typer.Option(
        "--fill",
        help="What twins fill. A cell is a class at an operating point, and short with fewer than "
        "half as many recordings as the others there. cells: short cells alone; points: every "
        "class at operating points with a short cell; all: every cell. Default: points.",
    ),
]
FaultOfOption = Annotated[
    list[str] | None,
    typer.Option(
        "--fault-of",
        metavar="CLASS=FAULT",
        help='Fault that twins simulate for a class: "Kolbenverschleiss=piston:clearance=60um". '
        "Several for one class take turns. Adds to fault_of of the index. Repeatable.",
    ),
]


def is_calibration(source: str) -> bool:
    """Return whether a text names a calibration file rather than a pump."""
    return Path(source).suffix == ".json"


def twin_files(sources: Sequence[str]) -> list[Path]:
    """Return the files among calibrations and pumps; a pump may be a name instead."""
    return [Path(source) for source in sources if is_calibration(source) or Path(source).suffix]


def load_twin_sources(sources: Sequence[str]) -> "list[Calibration | Pump]":
    """Return the calibrations and pumps that texts name."""
    from swashtwin.calibration import load_calibration
    from swashtwin.pump import load_pump

    require_existing([Path(source) for source in sources if is_calibration(source)])
    for source in sources:
        _require_twin(source)
    return [
        load_calibration(source) if is_calibration(source) else load_pump(source)
        for source in sources
    ]


def _require_twin(source: str) -> None:
    """Raise an error if a text names a file that is neither a calibration nor a pump."""
    from swashtwin.foundation import artifact_kind
    from swashtwin.pump import available_pumps

    path = Path(source)
    if is_calibration(source) or path.suffix == ".toml" or not path.exists():
        return  # they, or an unknown name, are refused by what reads them
    if source in available_pumps():
        return

    kind = artifact_kind(source) if path.is_file() else ""
    what = f"holds a {kind}, not a twin" if kind else "is not a twin"
    if kind == "window set":
        what = "holds synthetic windows, not a twin: add them with train --add"
    raise InputError(
        f"{source} {what}. A twin is a calibration (.json, written by calibrate), a pump file "
        f"(.toml), or one of {', '.join(available_pumps())}."
    )


def read_fault_texts(texts: Sequence[str] | None) -> dict[str, list[str]]:
    """Return the faults that each class stands for, from the texts of ``--fault-of``."""
    faults: dict[str, list[str]] = {}
    for text in texts or ():
        label, equals, fault = text.partition("=")
        if not (label.strip() and equals and fault.strip()):
            raise typer.BadParameter(f"{text!r} must be CLASS=FAULT.", param_hint="--fault-of")
        faults.setdefault(label.strip(), []).append(fault.strip())
    return faults


def collect_fault_texts(index: Path, texts: Sequence[str] | None) -> dict[str, list[str]]:
    """Return the faults that each class stands for, from an index and ``--fault-of``.

    The option takes precedence over the index.
    """
    from swashtwin.recordings import declared_faults

    declared = {label: [fault] for label, fault in declared_faults(index).items()}
    return {**declared, **read_fault_texts(texts)}


def fault_names(fault_texts: Mapping[str, Sequence[str]]) -> dict[str, str]:
    """Return the name of the first fault of each class, without its dimensions."""
    return {label: fault_dimensions(texts[0])[0] for label, texts in fault_texts.items()}


def build_filling(
    sources: Sequence[str],
    fault_texts: Mapping[str, Sequence[str]],
    *,
    fill: FillName | None,
    count: int | None,
    seed: int,
) -> "Filling":
    """Return the filling that the options of a command describe."""
    from swashtwin.pump import is_healthy
    from swashtwin.synthesis import DEFAULT_FILL, WINDOWS_PER_CELL, Filling

    fault_of: dict[str, list[Fault | str]] = {}
    for label, texts in fault_texts.items():
        # A text for a healthy pump is refused by the filling.
        faults = [_fault_of_class(label, text) or text for text in texts]
        if not (is_healthy(label) and all(map(is_healthy, texts))):
            fault_of[label] = faults
    return Filling(
        load_twin_sources(sources),
        fill=DEFAULT_FILL if fill is None else fill.value,
        count=count or WINDOWS_PER_CELL,
        fault_of=fault_of,
        seed=seed,
    )


def _fault_of_class(label: str, text: str) -> "Fault | None":
    """Return the fault that a text describes, with errors that name the class."""
    try:
        return fault_from(text)
    except InputError as cause:
        raise cause.with_context(f"The class {label!r} stands for {text!r}. ") from cause


def print_plan(plan: "FillingPlan") -> None:
    """Print what a plan adds to which cells, and its notes."""
    print_rows(plan.title, plan.header, plan.rows)
    for text in plan.notes:
        print_note(f"note: {text}")


def simulate_plan(plan: "FillingPlan") -> "WindowSet":
    """Return the windows of a plan, and show the progress."""
    with progress("synthesizing") as bar:
        return plan.simulate(bar)


class ReportedFilling:
    """A filling that prints its plan before it simulates (`learning.TrainingFiller`)."""

    def __init__(self, filling: "Filling", *, is_silent: bool) -> None:
        self.filling = filling
        self.is_silent = is_silent
        """Whether the plan is not printed, since it is part of a JSON answer."""
        self.plan: FillingPlan | None = None
        """The plan of the training; None before it was made."""

    @property
    def manifest(self) -> dict[str, tuple[str, ...]]:
        """Recordings that the twins were calibrated on."""
        return self.filling.manifest

    def check(self, recordings: "Sequence[Recording]") -> tuple[str, ...]:
        """Require that the twins are of the pump that was recorded."""
        return self.filling.check(recordings)

    def fill_training(self, training: "WindowSet") -> "tuple[WindowSet, tuple[str, ...]]":
        """Return the synthetic windows; the notes are printed with the plan."""
        self.plan = self.filling.plan(training)
        if not self.is_silent:
            print_plan(self.plan)
        return simulate_plan(self.plan), ()
