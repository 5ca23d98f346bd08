"""Options that several commands share, and the conversion of their texts to values."""

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

# A name of a dimension does not begin with a digit, so such a comma does not separate dimensions.
_DECIMAL_COMMA = re.compile(r"(?<=\d),(?=\d)")

INDEX_SUFFIXES = (".toml", ".h5", ".hdf5")
"""Suffixes of an index file or a store of recordings."""


def require_index(path: Path | None) -> Path | None:
    """Return the path unless it is a file of another kind than an index."""
    if path is not None and path.is_file() and path.suffix not in INDEX_SUFFIXES:
        raise typer.BadParameter(
            f"{path} is not an index of labeled recordings. Write one with: swashtwin index FOLDER"
        )
    return path


Json = Annotated[bool, typer.Option("--json", help="Print one JSON object on standard output.")]
Seed = Annotated[int, typer.Option(help="Seed of all random numbers.")]
Jobs = Annotated[int, typer.Option(min=1, help="Number of parallel processes.")]
Cluster = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS",
        help="Dask scheduler whose workers do the work, such as tcp://10.0.0.5:8786. Default: this "
        "computer.",
    ),
]
Index = Annotated[
    Path,
    typer.Argument(
        metavar="INDEX",
        help="Index file, folder that holds recordings.toml, or store.",
        callback=require_index,
    ),
]
Source = Annotated[
    Path, typer.Argument(metavar="FILE|INDEX", help="Recording, index, or folder with an index.")
]
Sources = Annotated[
    list[Path],
    typer.Argument(metavar="FILE|INDEX...", help="Recordings, indexes, or folders with an index."),
]
GroupName = Annotated[
    str,
    typer.Option(
        "--group",
        help="Unit that is never split between training and test: recording, specimen, "
        "condition, or an attribute.",
    ),
]
OptionalWindow = Annotated[
    int | None,
    typer.Option(
        "--window",
        help="Samples per window. Default: 8192, or fewer if the recordings are too short.",
    ),
]
Window = Annotated[int, typer.Option(help="Samples per window (2048 are 80 ms at 25.6 kHz).")]
Specimen = Annotated[str | None, typer.Option(help="Use only recordings of this machine.")]
ModelFile = Annotated[
    Path, typer.Argument(metavar="MODEL", help="Model file written by train or model adapt.")
]
CalibrationFile = Annotated[
    Path, typer.Argument(metavar="CALIBRATION", help="Calibration file written by calibrate.")
]
PumpName = Annotated[
    str,
    typer.Option("--pump", help="Name of a pump, or its .toml file (swashtwin twin pump show)."),
]
Speed = Annotated[str, typer.Option(help='Shaft speed, such as "860 rpm".')]
Pressure = Annotated[str, typer.Option(help='Absolute discharge pressure, such as "15 MPa".')]

_FAULT_HELP = (
    'Fault, with each dimension that differs from its default: "swash_plate:depth=0.3mm,'
    'length=30mm".'
)
_FAULT_METAVAR = "KIND[:NAME=QUANTITY,...]"
FaultText = Annotated[
    str,
    typer.Option(
        "--fault", metavar=_FAULT_METAVAR, help=f"{_FAULT_HELP} normal is a healthy pump."
    ),
]
OptionalFault = Annotated[
    str | None,
    typer.Option(
        "--fault", metavar=_FAULT_METAVAR, help=f"{_FAULT_HELP} Default: the calibration's fault."
    ),
]
Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="NAME=VALUE", help="Other setting, such as epochs=60. Repeatable."
    ),
]


class Preset(StrEnum):
    """Recipes: what we recommend, and the paper's."""

    recommended = "recommended"
    paper = "paper"


PresetName = Annotated[
    Preset, typer.Option(help="Recipe that sets the defaults of all options and settings.")
]


def _require_sample_unit(text: str | None) -> str | None:
    """Return the unit, or reject it at once if it is not the unit of a sensor."""
    if text is not None:
        from swashtwin.foundation import UnitError
        from swashtwin.recordings import require_sample_unit

        try:
            require_sample_unit(text)
        except UnitError as cause:
            raise typer.BadParameter(str(cause)) from cause
    return text


def _reading_option(help_text: str, kind: Any = str, **details: Any) -> Any:
    return Annotated[
        kind | None,
        typer.Option(
            help=help_text, rich_help_panel="Facts that the file does not contain", **details
        ),
    ]


READING_OPTIONS = {
    "sample_rate": _reading_option('Sample rate: "25.6 kHz".'),
    "unit": _reading_option(
        'Unit of the numbers in the file: "g", "m/s^2", "V", "1".', callback=_require_sample_unit
    ),
    "sensitivity": _reading_option(
        'Scale of the numbers in the file: "99.7 mV/g", "0.488 mg/count", "50 m/s^2" (full scale '
        "of WAV), or NAME=SCALE for one channel. Repeatable.",
        list[str],
    ),
    "channels": _reading_option(
        "Channel to read, by name, pattern or number. Repeatable.", list[str]
    ),
    "names": _reading_option("New name of each channel, in order. Repeatable.", list[str]),
    "read": _reading_option(
        "Layout of the file, by keys of an index: time_column=t (or 0), time_unit=us, "
        "header_lines=3, separator=tab, decimal=,. Repeatable.",
        list[str],
        metavar="KEY=VALUE",
    ),
    "speed": _reading_option('Shaft speed: "860 rpm".'),
    "pressure": _reading_option('Absolute discharge pressure: "15 MPa".'),
    "resample": _reading_option('Sample rate to resample to: "12 kHz".'),
}
"""Options that specify, for single files, what an index specifies for many."""

LAYOUT = ("time_column", "time_unit", "header_lines", "separator", "decimal")
"""Keys of an index that ``--read`` sets."""


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

    # The shell splits at blanks, and gives some other characters a meaning.
    is_plain = re.fullmatch(r"[\w.,:/+-]+", bare_value) is not None
    shell_value = bare_value if is_plain else f'"{bare_value}"'
    return f"{option_name(setting)} {shell_value}"


ReadingOptions = dict[str, Any]
"""What the options of `reads_files` specify, for ``load_recordings(path, **reading_options)``."""


def reads_files(command: Callable[..., None]) -> Callable[..., None]:
    """Add the options that specify how to read a file.

    The command gets them as ``reading_options``.

    If the command already has an option of the same name, that option stays.
    """
    signature = inspect.signature(command)
    added_names = [name for name in READING_OPTIONS if name not in signature.parameters]

    @wraps(command)
    def with_reading(**values: Any) -> None:
        reading_options = without_none(**{name: values.pop(name, None) for name in added_names})
        layout = _read_layout(reading_options.pop("read", ()))
        command(**values, reading_options=reading_options | layout)

    # typer reads the options from the signature, so that it lists each one.
    keyword = inspect.Parameter.KEYWORD_ONLY
    parameters: list[inspect.Parameter] = []
    for name, parameter in signature.parameters.items():
        if name != "reading_options":
            parameters.append(parameter.replace(kind=keyword))
            continue
        for added_name in added_names:
            parameters.append(
                inspect.Parameter(
                    added_name, keyword, default=None, annotation=READING_OPTIONS[added_name]
                )
            )
    with_reading.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    return with_reading


def _read_layout(texts: Sequence[str]) -> dict[str, Any]:
    """Return the layout keys that ``--read KEY=VALUE`` options specify."""
    layout: dict[str, Any] = {}
    for text in texts:
        name, _, value = text.partition("=")
        key = name.strip().replace("-", "_")
        if key not in LAYOUT or not value:
            raise typer.BadParameter(
                f"{text!r} must be KEY=VALUE, with one of the keys {', '.join(LAYOUT)}.",
                param_hint="--read",
            )
        if key == "header_lines" and not value.isdecimal():
            raise typer.BadParameter(
                f"{text!r} must be a whole number of lines.", param_hint="--read"
            )

        if key in ("header_lines", "time_column") and value.isdecimal():
            layout[key] = int(value)
        elif key == "separator" and value == "tab":
            layout[key] = "\t"
        else:
            layout[key] = value
    return layout


def read_pairs(texts: Sequence[str] | None, option: str) -> dict[str, str]:
    """Return ``NAME=VALUE`` texts as a dictionary.

    Raises
    ------
    typer.BadParameter
        A text is not of this form.
    """
    pairs = {}
    for text in texts or ():
        name, equals, value = text.partition("=")
        if not (name.strip() and equals and value.strip()):
            raise typer.BadParameter(f"{text!r} must be NAME=VALUE.", param_hint=option)
        pairs[name.strip()] = value.strip()
    return pairs


def read_list(text: str | None, kind: Callable[[str], T], option: str) -> list[T] | None:
    """Return comma-separated values of one kind, or None without a text.

    Raises
    ------
    typer.BadParameter
        A value is not of this kind.
    """
    if text is None:
        return None
    try:
        return [kind(part.strip()) for part in text.split(",")]
    except ValueError:
        numbers = "whole numbers" if kind is int else "numbers"
        raise typer.BadParameter(
            f"{text!r} must be {numbers} separated by commas.", param_hint=option
        ) from None


def split_names(text: str | None) -> list[str]:
    """Return comma-separated names; an empty list without a text."""
    return [name.strip() for name in (text or "").split(",") if name.strip()]


def without_none(**values: Any) -> dict[str, Any]:
    """Return the values that are neither None nor an empty list."""
    return {name: value for name, value in values.items() if value is not None and value != []}


def fault_dimensions(text: str) -> tuple[str, dict[str, str]]:
    """Return the kind of a fault and its dimensions from the text of ``--fault``.

    Examples
    --------
    >>> fault_dimensions("piston:clearance=60um")
    ('piston', {'clearance': '60um'})
    """
    kind, _, dimensions = text.partition(":")
    if _DECIMAL_COMMA.search(dimensions):
        corrected = _DECIMAL_COMMA.sub(".", dimensions)
        raise typer.BadParameter(
            f"{text!r} has a decimal comma. Write a decimal point: '{kind}:{corrected}'."
        )
    return kind.strip(), read_pairs(dimensions.split(",") if dimensions else None, "--fault")


def fault_from(text: str) -> "Fault | None":
    """Return the fault that the text of ``--fault`` describes; None for a healthy pump.

    A recess without a contact law gets the law that suits its depth.
    """
    from swashtwin.pump import SwashPlateDefect, read_fault

    kind, dimensions = fault_dimensions(text)
    fault = read_fault(kind, **dimensions)
    if isinstance(fault, SwashPlateDefect) and "contact" not in dimensions:
        return fault.with_fitting_contact()
    return fault


def band_from(text: str) -> tuple[float, float]:
    """Return the edges [Hz] of a frequency band such as ``10-1000 Hz``.

    Raises
    ------
    typer.BadParameter
        The band is in shaft orders.
    """
    from swashtwin.signals import Band

    band = Band.parse(text)
    if band.in_orders:
        raise typer.BadParameter("must be a band in Hz, such as 2-5 kHz.", param_hint="--band")
    return band.low, band.high


def read_settings(
    texts: Sequence[str] | None, defaults: dict[str, Any], owner: str
) -> dict[str, Any]:
    """Return the settings that ``--set NAME=VALUE`` options specify, of the types of the defaults.

    Parameters
    ----------
    defaults : allowed settings and their defaults.
    owner : what the settings belong to, for messages.

    Raises
    ------
    typer.BadParameter
        A setting does not exist, or its value is of another type.
    """
    from swashtwin.foundation import closest_name

    settings = {}
    for name, text in read_pairs(texts, "--set").items():
        if name not in defaults:
            suggestion = closest_name(name, defaults)
            if suggestion:
                hint = f"Did you mean {suggestion}?"
            else:
                hint = f"The settings are {', '.join(sorted(defaults))}."
            raise typer.BadParameter(f"{owner} has no setting {name!r}. {hint}", param_hint="--set")
        settings[name] = _read_setting(name, text, defaults[name])
    return settings


def _read_setting(name: str, text: str, default: Any) -> Any:
    """Return the value of a setting, of the type of its default.

    A default of None stands for a number or several numbers.
    """
    if isinstance(default, str):
        return text

    try:
        values = json.loads(f"[{text}]")
    except ValueError:
        values = []

    may_be_several = default is None or isinstance(default, tuple)
    example = default[0] if isinstance(default, tuple) and default else default
    if isinstance(example, bool):
        types: tuple[type, ...] = (bool,)
        description = "true or false"
    elif isinstance(example, int):
        types = (int,)
        description = "a whole number"
    else:
        types = (int, float)
        description = "a number"

    has_right_types = bool(values) and all(type(value) in types for value in values)
    if not has_right_types or (len(values) > 1 and not may_be_several):
        alternative = ", or several separated by commas" if may_be_several else ""
        raise typer.BadParameter(
            f"{name}={text} must be {description}{alternative}.", param_hint="--set"
        )

    if isinstance(default, float):
        values = [float(value) for value in values]
    if len(values) > 1 or isinstance(default, tuple):
        return tuple(values)
    return values[0]


def defaults_of(settings: Any) -> dict[str, Any]:
    """Return the fields of a dataclass instance whose values can be typed as text."""
    types = (int, float, str, tuple, type(None))
    values = {field.name: getattr(settings, field.name) for field in fields(settings)}
    return {name: value for name, value in values.items() if isinstance(value, types)}
