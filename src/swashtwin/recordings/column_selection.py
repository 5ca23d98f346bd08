"""Columns of a file that make up a recording, and their sample rate."""

from collections.abc import Mapping, Sequence
from fnmatch import fnmatchcase

from swashtwin.foundation import DataError, parse_quantity
from swashtwin.recordings.column_roles import vibration_columns
from swashtwin.recordings.columns import Column
from swashtwin.recordings.entry import Entry
from swashtwin.recordings.formats.raw_file import RawFile

# Relative difference up to which a specified rate agrees with that of the file.
_RATE_TOLERANCE = 1e-3

# Seconds of the units that are mistaken for seconds in time columns.
_TIME_UNITS = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}


def select_columns(raw: RawFile, entry: Entry, source_name: str) -> dict[str, Column]:
    """Return the columns that an entry names, in its order; by default `vibration_columns`.

    Parameters
    ----------
    source_name : name of the file in messages.

    Raises
    ------
    DataError
        A channel does not exist, it cannot be decided which columns are channels, or these differ
        in rate, start or length.
    """
    channels: Sequence[str | int] | None = entry.channels
    if channels is None:
        channels = vibration_columns(raw, entry, source_name)

    columns: dict[str, Column] = {}
    for channel in channels:
        names = _matching_names(raw, channel)
        if not names:
            numbered = ", ".join(f"{number} {name!r}" for number, name in enumerate(raw.columns))
            raise DataError(
                f"{source_name} has no channel {channel!r}; it has {numbered}.", field="channels"
            )
        columns.update({name: raw.columns[name] for name in names})

    rate_in_file(raw, list(columns), source_name)
    starts = {name: raw.starts[name] for name in columns if name in raw.starts}
    _require_one_value(starts, source_name, "different start times", "that start together")
    lengths = {name: str(len(column)) for name, column in columns.items()}
    _require_one_value(lengths, source_name, "different lengths", "of one length")
    return columns


def _require_one_value(
    values: Mapping[str, str], source_name: str, difference: str, requirement: str
) -> None:
    if len(set(values.values())) > 1:
        listed = ", ".join(f"{name}: {value}" for name, value in values.items())
        raise DataError(
            f"{source_name} holds channels of {difference} ({listed}), which are not one "
            "recording.",
            field="channels",
            remedy=f"Select channels {requirement} with {{channels}}.",
        )


def _matching_names(raw: RawFile, channel: str | int) -> list[str]:
    """Return the names of the columns that a name, a pattern or a number selects."""
    names = list(raw.columns)
    if isinstance(channel, str) and channel.isdecimal() and channel not in names:
        channel = int(channel)

    if isinstance(channel, int):
        return [names[channel]] if 0 <= channel < len(names) else []
    if channel in names:  # first, for a name may contain the characters of a pattern
        return [channel]
    return [name for name in names if fnmatchcase(name, channel)]


def resolve_sample_rate(
    raw: RawFile, columns: Sequence[str], entry: Entry, source_name: str
) -> float:
    """Return the sample rate [Hz] of the entry or the file.

    Parameters
    ----------
    columns : names of the selected columns.
    source_name : name of the file in messages.

    Raises
    ------
    DataError
        Neither specifies it, they contradict each other, or it is not positive.
    """
    in_file = rate_in_file(raw, columns, source_name)
    if entry.sample_rate is None:
        if in_file is None:
            raise _missing_rate_error(raw, source_name)
        return in_file

    specified = parse_quantity(entry.sample_rate, "Hz", name=f"{source_name}: sample_rate")
    if in_file is None:
        if specified <= 0:
            raise DataError(
                f"{source_name}: sample_rate ({specified!r} Hz) must be positive.",
                field="sample_rate",
            )
        return specified

    if abs(specified / in_file - 1) > _RATE_TOLERANCE:
        raise DataError(
            f"{source_name} states a sample rate of {in_file:g} Hz, but {specified:g} Hz is "
            "specified.",
            field="sample_rate",
            remedy=_rate_remedy(specified / in_file),
        )
    return specified


def _missing_rate_error(raw: RawFile, source_name: str) -> DataError:
    gaps = raw.attributes.get("time_gaps")
    doubt = f" ({gaps})" if gaps else ""
    return DataError(
        f"{source_name} does not state its sample rate{doubt}.",
        field="sample_rate",
        remedy="Set {sample_rate='25.6 kHz'} (or whatever it was).",
    )


def _rate_remedy(ratio: float) -> str:
    """Return what to do about a specified rate that is `ratio` times that of the file."""
    for unit, seconds in _TIME_UNITS.items():
        if abs(ratio * seconds - 1) < _RATE_TOLERANCE:
            return (
                "Correct {sample_rate}, or, if the times are in "
                f"{unit}, set {{time_unit='{unit}'}} instead."
            )
    return "Correct {sample_rate}."


def rate_in_file(raw: RawFile, columns: Sequence[str], source_name: str) -> float | None:
    """Return the sample rate [Hz] that the file states for the selected columns, or None."""
    if not raw.rates:
        return raw.sample_rate

    names_by_rate: dict[float | None, str] = {}
    for name in columns:
        names_by_rate.setdefault(raw.rates.get(name, raw.sample_rate), name)
    if len(names_by_rate) > 1:
        texts = []
        for rate, name in names_by_rate.items():
            texts.append(f"{name}: {f'{rate:g} Hz' if rate else 'none'}")
        raise DataError(
            f"{source_name} holds channels of several rates ({', '.join(texts)}), and a recording "
            "has one.",
            field="channels",
            remedy="Select those of one rate with {channels}.",
        )
    return next(iter(names_by_rate))
