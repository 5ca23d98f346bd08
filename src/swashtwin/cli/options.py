"""Options that several commands share."""

import json
import os
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from swashtwin.foundation import SwashTwinError

if TYPE_CHECKING:
    from swashtwin.calibration import Nuisances
    from swashtwin.physics import SteadySolver
    from swashtwin.pump import Fault, OperatingCondition

T = TypeVar("T")


def as_folder(path: Path | None) -> Path | None:
    """The same path, refused before any work where no folder can be there or nothing can be written into it."""
    if path is not None:
        there = next(one for one in (path.absolute(), *path.absolute().parents) if one.exists())
        if not there.is_dir():
            raise typer.BadParameter(f"{there} is a file; name a folder.")
        if not os.access(there, os.W_OK):
            raise typer.BadParameter(f"{there} cannot be written to; name a folder elsewhere.")
    return path


ReportFolder = Annotated[Path | None, typer.Option(help="Folder for report.html.", callback=as_folder)]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object on standard output.")]
Seed = Annotated[int, typer.Option(help="Addresses every random draw.")]
Jobs = Annotated[int, typer.Option(min=1, help="Processes that work side by side.")]
Index = Annotated[Path, typer.Argument(help="Index file, the folder that holds recordings.toml, or a store.")]
GroupName = Annotated[
    str, typer.Option("--group", help="What stays whole: recording, specimen, condition, or an attribute (pump_run).")
]
Length = Annotated[int, typer.Option(help="Readings per window; 2048 are 80 ms at 25.6 kHz.")]

PumpName = Annotated[str, typer.Option("--pump", help="Name of a pump, or its .toml file (swashtwin pump show).")]
Speed = Annotated[str, typer.Option(help='Speed of the shaft, such as "860 rpm".')]
Pressure = Annotated[str, typer.Option(help='Absolute pressure at the outlet, such as "15 MPa".')]
Pressures = Annotated[
    list[str],
    typer.Option("--pressure", help='Absolute pressure at the outlet, "15 MPa"; repeat it for several at once.'),
]
Temperature = Annotated[str | None, typer.Option(help='Oil temperature, such as "45 degC".')]
FaultName = Annotated[
    str, typer.Option("--fault", help="Kind of fault, such as swash_plate; normal is a healthy pump.")
]
FaultLength = Annotated[str | None, typer.Option("--length", help='Length of a swash plate defect, such as "30 mm".')]
FaultWidth = Annotated[str | None, typer.Option("--width", help='Width of a swash plate defect, such as "24 mm".')]
FaultDepth = Annotated[str | None, typer.Option("--depth", help='Depth of the defect, such as "0.6 mm".')]
Dimensions = Annotated[
    list[str] | None,
    typer.Option("--dimension", metavar="NAME=QUANTITY", help='Any dimension of the fault: "clearance=60 um".'),
]


class Solver(StrEnum):
    """What solves the equations of motion."""

    harmonic_balance = "harmonic-balance"
    rk4 = "rk4"


SolverName = Annotated[Solver, typer.Option(help="What solves the equations; rk4 is the paper's.")]
Step = Annotated[str | None, typer.Option(help='Step of rk4, such as "1 us"; 0.8 of its stability limit by default.')]


class Freed(StrEnum):
    """Which constants are searched beside the six values."""

    none = "none"
    usual = "usual"
    housing = "housing"


FreedName = Annotated[
    Freed,
    typer.Option(
        help="Constants nobody measured, searched as well: usual (mounting, bearings, excitation, sensors), or "
        "housing (those, each channel's gain, and two modes of the housing)."
    ),
]

SampleRate = Annotated[str | None, typer.Option(help='Readings per second where files do not say: "25.6 kHz".')]
Unit = Annotated[str | None, typer.Option(help='Unit of the readings where files do not say: "g", "m/s^2", "1".')]
CalibrationFactor = Annotated[
    str | None, typer.Option(help='What one unit in the file stands for (full scale of an integer WAV): "50 m/s^2".')
]
Channels = Annotated[list[str] | None, typer.Option(help="Column or variable to read, by name or pattern; repeatable.")]
Names = Annotated[list[str] | None, typer.Option(help="What to call each of the channels; repeatable.")]


def condition_of(speed: str, pressure: str, temperature: str | None) -> "OperatingCondition":
    """Operating condition of the options."""
    from swashtwin.pump import read_condition

    return read_condition(speed=speed, discharge_pressure=pressure, oil_temperature=temperature)


def fault_of(
    kind: str, length: str | None, width: str | None, depth: str | None, dimensions: list[str] | None
) -> "Fault | None":
    """Fault of the options."""
    from swashtwin.pump import read_fault

    named = {"length": length, "width": width, "depth": depth} | pairs_of(dimensions, "--dimension")
    return read_fault(kind, **{name: text for name, text in named.items() if text is not None})


def solver_of(name: Solver, step: str | None) -> "SteadySolver":
    """Solver of the options; a step without rk4 is a wrong command line."""
    from swashtwin.foundation import parse
    from swashtwin.physics import RK4, HarmonicBalance

    if name is Solver.rk4:
        return RK4(step=None if step is None else parse(step, "s", name="step"))
    if step is not None:
        raise typer.BadParameter("belongs to --solver rk4; harmonic balance has no step.", param_hint="--step")
    return HarmonicBalance()


def nuisances_of(name: Freed) -> "Nuisances":
    """Constants of the options, with their priors."""
    from swashtwin.calibration import Nuisances

    return {Freed.none: Nuisances(), Freed.usual: Nuisances.usual(), Freed.housing: Nuisances.housing()}[name]


def pairs_of(texts: list[str] | None, option: str) -> dict[str, str]:
    """``name=value`` texts as a dictionary; anything else is a wrong command line."""
    pairs = {}
    for text in texts or ():
        name, equals, value = text.partition("=")
        if not (name.strip() and equals and value.strip()):
            raise typer.BadParameter(f"{text!r} must be NAME=VALUE.", param_hint=option)
        pairs[name.strip()] = value.strip()
    return pairs


_OF_THE_WINDOWS = {
    "name": "the network is named by --network",
    "n_channels": "the recordings say how many channels there are",
    "n_classes": "the recordings say how many classes there are",
}
"""What looks like a setting of a network and is none, and what says it instead."""


def settings_of(texts: list[str] | None, option: str) -> dict[str, Any]:
    """``name=value`` texts, each value a number, true or false, or several numbers with commas between them."""
    settings = {}
    for name, text in pairs_of(texts, option).items():
        if name in _OF_THE_WINDOWS:
            raise typer.BadParameter(f"{name} is no setting: {_OF_THE_WINDOWS[name]}.", param_hint=option)
        try:
            values = json.loads(f"[{text}]")
        except ValueError:
            values = []
        if not values or not all(isinstance(value, (int, float)) for value in values):
            raise typer.BadParameter(
                f"{name}={text} must be a number, numbers with commas, true or false.", param_hint=option
            )
        settings[name] = tuple(values) if len(values) > 1 else values[0]
    return settings


def list_of(text: str | None, kind: Callable[[str], T], option: str) -> list[T] | None:
    """Comma-separated values; anything else is a wrong command line."""
    if text is None:
        return None
    try:
        return [kind(part) for part in text.split(",")]
    except ValueError:
        raise typer.BadParameter(
            f"{text!r} must be whole numbers with commas between them.", param_hint=option
        ) from None


_SINGLE_FILE = {"sample_rate": "--sample-rate", "unit": "--unit", "channels": "--channels", "names": "--names"}
_SINGLE_FILE |= {"calibration_factor": "--calibration-factor", "speed": "--speed"}
"""Options that say of a single file what keys of an index say of many."""


@contextmanager
def said_as_options() -> Iterator[None]:
    """Within it, errors that would have an index mended name the options of a single file instead."""
    try:
        yield
    except SwashTwinError as cause:
        text = re.sub(r"\b([a-z_]+) = (?=[\"'\[])", _as_option, str(cause))
        text = text.replace("the index says", "the option says").replace("correct the index", "correct the option")
        text = text.replace("remove unit,", "leave out --unit,").replace("--channels [...]", "--channels NAME")
        raise type(cause)(text) from cause


def _as_option(match: re.Match[str]) -> str:
    option = _SINGLE_FILE.get(match[1])
    return match[0] if option is None else f"{option} "


def given(**values: Any) -> dict[str, Any]:
    """The values that are not None."""
    return {name: value for name, value in values.items() if value is not None and value != []}
