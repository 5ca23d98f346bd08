"""The content of one file, before an index adds the rest: columns, which read when they are sliced,
and their units.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal, Protocol, runtime_checkable

import numpy as np
from msgspec import Meta

from swashtwin.foundation import (
    DataError,
    MissingFileError,
    UnitError,
    is_unit,
    memory_limit,
    parse_quantity,
)
from swashtwin.pump import OperatingCondition

BLOCK = 1 << 18
"""Samples of each channel that are in memory together: 2 MB in double precision."""


def file_stamp(path: Path) -> tuple[int, int, int]:
    """Size [byte], time of the last change [ns] and inode of a file: another file, or a changed
    one, has others.
    """
    if not path.is_file():
        raise MissingFileError(f"{path} does not exist, or is no file.")
    stat = path.stat()
    return stat.st_size, stat.st_mtime_ns, stat.st_ino


def require_unchanged(path: Path, stamp: tuple[int, int, int]) -> None:
    """Refuse a file that is gone, or whose `file_stamp` differs from the one that it had when it
    was loaded.
    """
    is_there = path.is_file()
    if not is_there or file_stamp(path) != stamp:
        change = (
            "has changed since it was loaded;"
            if is_there
            else "is gone since it was loaded; put it back, and"
        )
        raise DataError(f"{path}: the file {change} load it again.")


@runtime_checkable
class Column(Protocol):
    """Samples of one channel in the number type of the file; an array is one, and so is what reads
    when sliced.
    """

    def __len__(self) -> int:
        """Number of samples."""

    def __getitem__(self, span: slice, /) -> np.ndarray:
        """The samples of a slice."""


def number_type(column: Column) -> np.dtype:
    """Number type of a column's samples; the first is read where the column does not say it."""
    stated = getattr(column, "dtype", None)
    return (
        stated
        if isinstance(stated, np.dtype)
        else np.asarray(column[0 : min(1, len(column))]).dtype
    )


class LazyColumn:
    """Samples of a column that `read` gives, from a first one to before another, when they are
    sliced.
    """

    def __init__(
        self, read: Callable[[int, int], np.ndarray], length: int, dtype: np.dtype | None = None
    ) -> None:
        self._read = read
        self._length = length
        self.dtype = dtype

    def __len__(self) -> int:
        return self._length

    def __getitem__(self, span: slice, /) -> np.ndarray:
        start, stop, step = span.indices(self._length)
        return np.asarray(self._read(start, max(start, stop)))[::step]


def part_of(column: Column, first: int, last: int) -> LazyColumn:
    """Samples of a column from `first` to before `last`."""
    return LazyColumn(lambda start, stop: column[first + start : first + stop], last - first)


def side_by_side(
    read: Callable[[int, int], np.ndarray], shape: tuple[int, int], dtype: np.dtype | None = None
) -> list[LazyColumn]:
    """Columns (number, samples of each) that a file holds beside each other, of which `read` gives
    a slice of all.

    The slice is kept for the other columns.
    """
    kept: dict[tuple[int, int], np.ndarray] = {}

    def row(number: int, start: int, stop: int) -> np.ndarray:
        if (start, stop) not in kept:
            kept.clear()  # its memory is needed for the next
            kept[start, stop] = read(start, stop)
        samples: np.ndarray = kept[start, stop][number]
        return samples

    kind = np.dtype(np.float64) if dtype is None else dtype
    return [LazyColumn(partial(row, number), shape[1], kind) for number in range(shape[0])]


STORE_KIND = "swashtwin store "
"""What every version of an HDF5 file of many recordings calls itself, before the number."""
_CLOCKS = (51200.0, 65536.0, 48000.0, 44100.0, 100000.0)
"""Rates that converters divide down [Hz]: a third of 51.2 kHz has no short decimal form."""
RATES = (1e-3, 1e9)
"""Sample rates that anything measures at [Hz]."""
_PACKING = 100
"""How many times its size a file of measurements unpacks to at most: noise packs to a half, a dead
channel to more.
"""


Text = Annotated[str, Meta(min_length=1)]
_Count = Annotated[int, Meta(ge=0, lt=1 << 31)]
_Texts = Annotated[tuple[Text, ...], Meta(min_length=1)]


@dataclass(frozen=True, kw_only=True)
class Options:
    """What a file does not say of itself: the keys of an index, and the options of every command
    that reads a file.

    Quantities are text with their unit.
    """

    sample_rate: str | None = None
    """Samples per second, such as ``"25.6 kHz"``."""
    unit: Text | None = None
    """Unit of the numbers in the file; ``"1"`` where the scale is unknown."""
    sensitivity: Text | _Texts | None = None
    """What the numbers in the file stand for: ``"99.7 mV/g"`` for channels in volts, ``"0.488
    mg/count"`` or ``"256 LSB/g"`` for those of a converter, ``"0.1 g"`` for one unit of the file
    (full scale of an integer WAV). One for all channels, one for each, or ``"NAME=99.7 mV/g"`` for
    those that are named.
    """
    channels: Annotated[tuple[Text | _Count, ...], Meta(min_length=1)] | None = None
    """Columns or variables to read: names, patterns such as ``"*_DE_time"``, or numbers from 0; all
    where None.
    """
    names: _Texts | None = None
    """What to call the channels; as in the file where None."""
    time_column: Text | _Count | None = None
    """Name or number (from 0) of the column with the time; found by its name, or as it rises
    evenly, where None.
    """
    time_unit: Text | None = None
    """Unit of that column, such as ``"us"``; its heading or its size say it where None."""
    header_lines: _Count | None = None
    """Lines before the first sample of a text file; detected where None."""
    separator: Annotated[str, Meta(min_length=1, max_length=1)] | None = None
    """Character between two columns of a text file; detected where None."""
    decimal: Literal[".", ","] | None = None
    """Decimal mark of a text file, ``"."`` or ``","``; detected where None."""
    speed: str | None = None
    """Speed of the shaft, such as ``"860 rpm"``; without `pressure` it is kept as an attribute."""
    pressure: str | None = None
    """Absolute pressure at the outlet, such as ``"15 MPa"``."""


@dataclass(frozen=True)
class RawFile:
    """Content of one file: what a format's `read` returns."""

    columns: Mapping[str, Column]
    """Each signal by its name, in the file's order: a one-dimensional array, or an object that
    reads when sliced.
    """
    sample_rate: float | None = None
    """Rate the file states or its time column shows [Hz]."""
    units: Mapping[str, str] = field(default_factory=dict)
    """Unit of each column for which the file names one."""
    attributes: Mapping[str, str] = field(default_factory=dict)
    """Further facts in the file."""
    facts: Mapping[str, Any] = field(default_factory=dict)
    """What the file states of the fields of `Recording`: ``recording_id``, ``label``, ``specimen``,
    ``synthetic``, and ``condition``, the keys of an `OperatingCondition` in SI units.
    """
    speeds: Column | None = None
    """Angular speed of the shaft at each sample [rad/s], where the file has it."""
    full_scale: bool = False
    """Whether samples are shares of an unknown full scale (integer WAV)."""
    rates: Mapping[str, float] = field(default_factory=dict)
    """Rate of each column [Hz], where the file holds several."""
    sensitivities: Mapping[str, str] = field(default_factory=dict)
    """What the sensor of each column gives, such as ``"99.7 mV/g"``; it holds where the column is
    in volts.
    """
    starts: Mapping[str, str] = field(default_factory=dict)
    """When each column starts, in words, where the file says it; columns that start apart are no
    one recording.
    """
    breaks: tuple[int, ...] = ()
    """Samples at which another recording begins."""

    @property
    def condition(self) -> OperatingCondition | None:
        """Operating condition that the file states, or None."""
        stated = self.facts.get("condition")
        return None if stated is None else OperatingCondition(**stated)


_USUAL_FACTORS = {"m/s^2": 1.0, "g": 9.80665}
"""m/s^2 per usual unit, so that most files are read without loading the registry of units (0.3
s).
"""


def acceleration_factor(unit: str) -> float | None:
    """m/s^2 per `unit`, or None where it is a unit of something else.

    ``g`` is the acceleration of gravity here, not the gram.

    Raises
    ------
    UnitError
        The unit is unknown.

    Examples
    --------
    >>> acceleration_factor("g"), acceleration_factor("mm/s^2"), acceleration_factor("Pa")
    (9.80665, 0.001, None)
    """
    unit = plain_unit(unit)
    if unit in _USUAL_FACTORS:
        return _USUAL_FACTORS[unit]
    if unit.strip() == "1":
        return None
    try:
        return parse_quantity(f"1 {unit}", "m/s^2")
    except UnitError as cause:
        if not is_unit(unit.strip()):
            raise UnitError(
                f'unit = "{unit}" is not known; write such as "g", "m/s^2", "Pa", or "1" for no scale.'
            ) from cause
        return None


# fmt: off
_SPELLINGS = {
    "g's": "g", "gs": "g", "g_n": "g", "gn": "g", "volts": "V", "volt": "V", "amps": "A", "amp": "A", "ms-2": "m/s^2",
    "m/s2": "m/s^2", "m/s/s": "m/s^2", "m/sec^2": "m/s^2", "m/sec2": "m/s^2", "m*s^-2": "m/s^2", "m s-2": "m/s^2",
    "m.s-2": "m/s^2", "m/(s^2)": "m/s^2", "ms^-2": "m/s^2", "m/s**2": "m/s^2", "mm/s2": "mm/s^2",
    "deg c": "degC", "°c": "degC", "celsius": "degC",
    "1/min": "rpm", "u/min": "rpm", "min-1": "rpm", "r/min": "rpm", "rev/min": "rpm", "upm": "rpm",
    "sec": "s", "second": "s", "seconds": "s", "sek": "s", "msec": "ms", "millis": "ms", "milliseconds": "ms",
    "usec": "us", "micros": "us", "microseconds": "us", "nsec": "ns", "nanos": "ns", "nanoseconds": "ns", "hours": "h",
    "minutes": "min", "days": "d", "s/s": "Hz", "sa/s": "Hz", "sps": "Hz", "samples/s": "Hz", "samples/second": "Hz",
    "1/s": "Hz", "hertz": "Hz", "ks/s": "kHz", "ksa/s": "kHz", "ksps": "kHz", "ms/s": "MHz", "msa/s": "MHz",
} | {
    unit.lower(): unit for unit in ("g", "s", "ms", "us", "ns", "m/s^2", "mm/s^2", "V", "mV", "bar", "Hz", "kHz", "rpm")
}
"""Units as people write them, in small letters, and as they are known here."""
# fmt: on


def plain_unit(text: str) -> str:
    """A unit in the spelling that is known here; what follows the word "since" is left out.

    Examples
    --------
    >>> plain_unit("g's"), plain_unit("ms-2"), plain_unit("\u03bcs"), plain_unit("M/S²"), plain_unit("ms since 1970")
    ('g', 'm/s^2', 'us', 'm/s^2', 'ms')
    """
    unit = text.partition(" since ")[0].strip().replace("\u03bc", "u").replace("\u00b5", "u")
    unit = unit.replace("²", "^2").replace("⁻", "-")
    return _SPELLINGS.get(unit.lower(), unit)


SAMPLE_UNITS = (
    "m/s^2", "g", "mg", "mm/s^2", "m/s", "mm/s", "um/s", "mm", "um", "Pa", "hPa", "kPa", "MPa", "mbar", "bar", "psi",
    "V", "mV", "A", "mA", "N", "kN", "N*m", "rpm", "Hz", "degC", "1",
)  # fmt: skip
"""Units that an option may name for samples; 1 is a plain number."""


def require_sample_unit(text: str) -> None:
    """Refuse a unit that no sensor of a machine has, such as a furlong, before anything is read.

    Raises
    ------
    UnitError
        It is none of `SAMPLE_UNITS`, in any spelling of them.
    """
    plain = plain_unit(text).casefold()
    if plain not in [name.casefold() for name in SAMPLE_UNITS]:
        raise UnitError(f"unit = {text!r} is none of {', '.join(SAMPLE_UNITS)} (a plain number).")


def known_unit(text: object) -> str | None:
    """The unit that a file names, or None where the text is no unit."""
    unit = plain_unit(str(text))
    if not unit or unit.upper() in ("NONE", "N/A", "UNKNOWN"):
        return None
    try:
        acceleration_factor(unit)
    except UnitError:
        return None
    return unit


def require_plausible_size(path: Path, size: float, name: str) -> None:
    """Refuse content that is read in parts, where its `size` [byte] is beyond what measurements can
    be packed to.
    """
    packed, limit = path.stat().st_size, memory_limit()
    if size > limit and size > _PACKING * packed:
        raise DataError(
            f"{path} of {packed / 1e6:.3g} MB unpacks to {size / 1e9:.3g} GB ({name}), more than {_PACKING} times its "
            f"size and than the limit of {limit / 1e9:.3g} GB; it is damaged, or holds no measurement."
        )


def require_plausible_rates(path: Path, raw: RawFile) -> None:
    """Refuse a file that states a sample rate that nothing measures at."""
    for rate in (raw.sample_rate, *raw.rates.values()):
        if rate is not None and not RATES[0] <= rate <= RATES[1]:
            raise DataError(
                f"{path} states a sample rate of {rate:g} Hz; the file is damaged, or its time no time."
            )


def snapped_rate(step: float, tolerance: float) -> float:
    """Sensible sample rate [Hz] nearest to one over `step` that the step's rounding allows.

    Parameters
    ----------
    step : time between two samples [s].
    tolerance : relative error of `step`, such as 5e-6 for six digits.
    """
    rate = 1 / step
    candidates = [float(f"{rate:.{digits}e}") for digits in range(5)]
    for clock in _CLOCKS:
        candidates.append(clock / max(1, round(clock / rate)))
    for candidate in candidates:
        if abs(candidate * step - 1) <= tolerance * (1 + 1e-6):
            return candidate
    return rate
