"""Options that several commands share, and what their texts mean."""

import inspect
import json
import re
from collections.abc import Callable, Sequence
from dataclasses import fields
from enum import StrEnum
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

if TYPE_CHECKING:
    from swashtwin.pump import Fault

T = TypeVar("T")


def as_index(path: Path | None) -> Path | None:
    """The same path, refused where it is a file that can be no index."""
    if path is not None and path.is_file() and path.suffix not in (".toml", ".h5", ".hdf5"):
        raise typer.BadParameter(
            f"{path} is no index of labeled recordings; swashtwin index FOLDER writes one."
        )
    return path


Json = Annotated[bool, typer.Option("--json", help="Print one JSON object on standard output.")]
Seed = Annotated[int, typer.Option(help="Seed of every random draw.")]
Jobs = Annotated[int, typer.Option(min=1, help="Number of parallel processes.")]
_INDEX = "Index file, the folder that holds recordings.toml, or a store."
Index = Annotated[Path, typer.Argument(metavar="INDEX", help=_INDEX, callback=as_index)]
Source = Annotated[
    Path, typer.Argument(metavar="FILE|INDEX", help="A file, an index, or a folder with one.")
]
Sources = Annotated[
    list[Path],
    typer.Argument(metavar="FILE|INDEX...", help="Files, indexes, or folders with one."),
]
GroupName = Annotated[
    str,
    typer.Option(
        "--group", help="What is never split: recording, specimen, condition, or an attribute."
    ),
]
_USUAL = "Samples per window; by default 8192 or as many as recordings allow."
UsualWindow = Annotated[int | None, typer.Option("--window", help=_USUAL)]
Window = Annotated[int, typer.Option(help="Samples per window; 2048 are 80 ms at 25.6 kHz.")]
Specimen = Annotated[str | None, typer.Option(help="Use the recordings of this machine only.")]
ModelFile = Annotated[
    Path, typer.Argument(metavar="MODEL", help="Model file that train or model adapt wrote.")
]
CalibrationFile = Annotated[
    Path, typer.Argument(metavar="CALIBRATION", help="Calibration file that calibrate wrote.")
]
PumpName = Annotated[
    str,
    typer.Option("--pump", help="Name of a pump, or its .toml file (swashtwin twin pump show)."),
]
Speed = Annotated[str, typer.Option(help='Shaft speed, such as "860 rpm".')]
Pressure = Annotated[str, typer.Option(help='Absolute discharge pressure, such as "15 MPa".')]
_FAULT = (
    'Fault with the dimensions that are not the usual ones: "swash_plate:depth=0.3mm,length=30mm".'
)
_KIND = "KIND[:NAME=QUANTITY,...]"
FaultText = Annotated[
    str, typer.Option("--fault", metavar=_KIND, help=f"{_FAULT} normal is a healthy pump.")
]
OptionalFault = Annotated[
    str | None,
    typer.Option("--fault", metavar=_KIND, help=f"{_FAULT} By default the calibration's."),
]
Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="NAME=VALUE", help="Any other setting, such as epochs=60; repeatable."
    ),
]


class Preset(StrEnum):
    """Recipes: what we recommend, and the paper's."""

    recommended = "recommended"
    paper = "paper"


PresetName = Annotated[Preset, typer.Option(help="What every option and setting defaults to.")]


def _sample_unit(text: str | None) -> str | None:
    """The same unit, refused before any work where no sensor has it."""
    if text is not None:
        from swashtwin.foundation import UnitError
        from swashtwin.recordings import require_sample_unit

        try:
            require_sample_unit(text)
        except UnitError as cause:
            raise typer.BadParameter(str(cause)) from cause
    return text


def _reading(help_text: str, kind: Any = str, **more: Any) -> Any:
    return Annotated[
        kind | None,
        typer.Option(help=help_text, rich_help_panel="What a file does not say", **more),
    ]


READING = {
    "sample_rate": _reading('Sample rate: "25.6 kHz".'),
    "unit": _reading(
        'Unit of the numbers in the file: "g", "m/s^2", "V", "1".', callback=_sample_unit
    ),
    "sensitivity": _reading(
        'What they stand for: "99.7 mV/g", "0.488 mg/count", "50 m/s^2" (full scale of WAV), NAME=...; repeatable.',
        list[str],
    ),
    "channels": _reading("Channel to read, by name, pattern or number; repeatable.", list[str]),
    "names": _reading("New name of each channel, in order; repeatable.", list[str]),
    "read": _reading(
        "How the file is laid out, by keys of an index: time_column=t (or 0), time_unit=us, header_lines=3, "
        "separator=tab, decimal=,; repeatable.",
        list[str],
        metavar="KEY=VALUE",
    ),
    "speed": _reading('Shaft speed: "860 rpm".'),
    "pressure": _reading('Absolute discharge pressure: "15 MPa".'),
    "resample": _reading('Rate to resample to: "12 kHz".'),
}
"""Options that state for single files what keys of an index state for many."""
LAYOUT = ("time_column", "time_unit", "header_lines", "separator", "decimal")
"""Keys of an index that ``--read`` states."""


def option_name(setting: str) -> str:
    """Return the option that sets a setting.

    Examples
    --------
    >>> option_name("sample_rate"), option_name("decimal")
    ('--sample-rate', '--read decimal=...')
    """
    if setting in LAYOUT:
        return f"--read {setting}=..."
    return f"--{setting.replace('_', '-')}"


def spell_as_option(setting: str, value: str) -> str:
    """Return a setting as it is typed in the shell, in quotes if the shell requires them.

    Examples
    --------
    >>> spell_as_option("sample_rate", "'25.6 kHz'"), spell_as_option("unit", "'g'")
    ('--sample-rate "25.6 kHz"', '--unit g')
    >>> spell_as_option("decimal", "','"), spell_as_option("force", "True")
    ('--read "decimal=,"', '--force')
    """
    if not value or value == "True":
        return option_name(setting)

    bare_value = value.strip("'\"")
    if setting in LAYOUT:
        pair = f"{setting}={bare_value}"
        return f"--read {pair}" if bare_value.isalnum() else f'--read "{pair}"'

    # The shell splits at blanks and reads the other characters in its own way.
    is_plain = re.fullmatch(r"[\w.,:/+-]+", bare_value) is not None
    shell_value = bare_value if is_plain else f'"{bare_value}"'
    return f"{option_name(setting)} {shell_value}"


Reading = dict[str, Any]
"""What the options of `reads_files` state, for ``load_recordings(path, **reading)``."""


def reads_files(command: Callable[..., None]) -> Callable[..., None]:
    """A command with the options that say how to read a file, which it gets together as
    ``reading``.

    An option of its own by the same name stays the command's.
    """
    signature = inspect.signature(command)
    added = [name for name in READING if name not in signature.parameters]

    @wraps(command)
    def with_reading(**values: Any) -> None:
        reading = present(**{name: values.pop(name, None) for name in added})
        layout = _layout(reading.pop("read", ()))
        command(**values, reading=reading | layout)

    keyword = inspect.Parameter.KEYWORD_ONLY
    parameters: list[inspect.Parameter] = []
    for name, parameter in signature.parameters.items():
        if name == "reading":
            parameters += [
                inspect.Parameter(key, keyword, default=None, annotation=READING[key])
                for key in added
            ]
        else:
            parameters.append(parameter.replace(kind=keyword))
    with_reading.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    return with_reading


def _layout(texts: Sequence[str]) -> dict[str, Any]:
    layout: dict[str, Any] = {}
    for text in texts:
        name, _, value = text.partition("=")
        key = name.strip().replace("-", "_")
        if key not in LAYOUT or not value:
            reason = f"{text!r} must be KEY=VALUE; the keys are {', '.join(LAYOUT)}."
            raise typer.BadParameter(reason, param_hint="--read")
        if key == "header_lines" and not value.isdecimal():
            raise typer.BadParameter(
                f"{text!r} must be a whole number of lines.", param_hint="--read"
            )
        is_number = key in ("header_lines", "time_column") and value.isdecimal()
        layout[key] = (
            int(value) if is_number else "\t" if (key, value) == ("separator", "tab") else value
        )
    return layout


def read_pairs(texts: Sequence[str] | None, option: str) -> dict[str, str]:
    """``name=value`` texts as a dictionary; anything else is a wrong command line."""
    pairs = {}
    for text in texts or ():
        name, equals, value = text.partition("=")
        if not (name.strip() and equals and value.strip()):
            raise typer.BadParameter(f"{text!r} must be NAME=VALUE.", param_hint=option)
        pairs[name.strip()] = value.strip()
    return pairs


def read_list(text: str | None, kind: Callable[[str], T], option: str) -> list[T] | None:
    """Comma-separated values; anything else is a wrong command line."""
    if text is None:
        return None
    try:
        return [kind(part.strip()) for part in text.split(",")]
    except ValueError:
        number = "whole numbers" if kind is int else "numbers"
        raise typer.BadParameter(
            f"{text!r} must be {number} with commas between them.", param_hint=option
        ) from None


def read_words(text: str | None) -> list[str]:
    """Comma-separated words; none where there is no text."""
    return [word.strip() for word in (text or "").split(",") if word.strip()]


def present(**values: Any) -> dict[str, Any]:
    """The values that are neither None nor an empty list."""
    return {name: value for name, value in values.items() if value is not None and value != []}


def fault_dimensions(text: str) -> tuple[str, dict[str, str]]:
    """Kind of a fault text, and its dimensions: ``("piston", {"clearance": "60um"})`` of
    ``piston:clearance=60um``.
    """
    kind, _, dimensions = text.partition(":")
    return kind.strip(), read_pairs(dimensions.split(",") if dimensions else None, "--fault")


def fault_from(text: str) -> "Fault | None":
    """Fault that the text of ``--fault`` describes; None is a healthy pump. A recess whose law of
    contact is not named gets the one that suits its depth.
    """
    from swashtwin.pump import SwashPlateDefect, read_fault

    kind, dimensions = fault_dimensions(text)
    fault = read_fault(kind, **dimensions)
    if isinstance(fault, SwashPlateDefect) and "contact" not in dimensions:
        return fault.with_fitting_contact()
    return fault


def band_from(text: str, option: str = "--band") -> tuple[float, float]:
    """Edges [Hz] of a band such as ``10-1000 Hz``; one in shaft orders is a wrong command line."""
    from swashtwin.signals import Band

    band = Band.parse(text)
    if band.in_orders:
        raise typer.BadParameter("is a band in Hz here: 2-5 kHz.", param_hint=option)
    return band.low, band.high


def read_settings(
    texts: Sequence[str] | None, defaults: dict[str, Any], owner: str
) -> dict[str, Any]:
    """Settings that ``--set NAME=VALUE`` names, each of the same kind as its default.

    Parameters
    ----------
    defaults : each setting that can be given, with its default.
    owner : whose settings these are, for messages.
    """
    from difflib import get_close_matches

    settings = {}
    for name, text in read_pairs(texts, "--set").items():
        if name not in defaults:
            near = get_close_matches(name, defaults, n=1)
            hint = (
                f" Did you mean {near[0]}?"
                if near
                else f" There are {', '.join(sorted(defaults))}."
            )
            raise typer.BadParameter(f"{owner} has no setting {name!r}.{hint}", param_hint="--set")
        settings[name] = _setting(name, text, defaults[name])
    return settings


def _setting(name: str, text: str, default: Any) -> Any:
    """Value of a setting: a word where the default is one, else a number, a truth value, or numbers
    with commas.
    """
    if isinstance(default, str):
        return text
    try:
        values = json.loads(f"[{text}]")
    except ValueError:
        values = []
    several, first = default is None or isinstance(default, tuple), default
    if isinstance(default, tuple) and default:
        first = default[0]
    types = {bool: ((bool,), "true or false"), int: ((int,), "a whole number")}
    kinds, words = types.get(type(first), ((int, float), "a number"))
    if (
        not values
        or not all(type(value) in kinds for value in values)
        or (len(values) > 1 and not several)
    ):
        reason = f"{name}={text} must be {words}{', or several with commas' if several else ''}."
        raise typer.BadParameter(reason, param_hint="--set")
    if isinstance(default, float):
        values = [float(value) for value in values]
    return tuple(values) if len(values) > 1 or isinstance(default, tuple) else values[0]


def defaults_of(settings: Any) -> dict[str, Any]:
    """Settings of a dataclass instance by name, but for what no text can say."""
    values = {item.name: getattr(settings, item.name) for item in fields(settings)}
    kinds = (int, float, str, tuple, type(None))
    return {name: value for name, value in values.items() if isinstance(value, kinds)}
