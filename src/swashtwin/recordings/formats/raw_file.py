"""The content of one file before an index adds the rest, and the options that say how to read
it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

from msgspec import Meta

from swashtwin.foundation import DataError, FileStamp, file_stamp, memory_limit
from swashtwin.pump import OperatingCondition
from swashtwin.recordings.columns import Column

STORE_KIND = "swashtwin store "
"""Format name, before its version, of an HDF5 file of many recordings."""
UNCLOSED = "never_closed"
"""Attribute of a file that its recorder never closed, with what follows from it."""
SAMPLE_RATE_RANGE_HZ = (1e-3, 1e9)
"""Lowest and highest sample rate that any instrument measures at."""

# Maximum ratio of unpacked to packed size of a file of measurements.
#
# Noise packs to a half of its size, a dead channel to less; a bomb of zeros packs to a thousandth.
_MAX_COMPRESSION = 100

# Rates that converters divide by whole numbers: a third of 51.2 kHz has no short decimal form.
_CONVERTER_RATES_HZ = (51200.0, 65536.0, 48000.0, 44100.0, 100000.0)


def require_unchanged(path: Path, stamp: FileStamp) -> None:
    """Refuse a file that was removed or changed since it had this `file_stamp`."""
    if not path.is_file():
        raise DataError(
            f"{path}: the file is gone since it was loaded; put it back, and load it again."
        )
    if file_stamp(path) != stamp:
        raise DataError(f"{path}: the file has changed since it was loaded; load it again.")


Text = Annotated[str, Meta(min_length=1)]
_Count = Annotated[int, Meta(ge=0, lt=1 << 31)]
_Texts = Annotated[tuple[Text, ...], Meta(min_length=1)]


@dataclass(frozen=True, kw_only=True)
class ReadOptions:
    """Facts that a file does not state itself, as text with units.

    They are keys of an index, and options of every command that reads a file.
    """

    sample_rate: str | None = None
    """Samples per second, such as ``"25.6 kHz"``."""
    unit: Text | None = None
    """Unit of the numbers in the file; ``"1"`` if the scale is unknown."""
    sensitivity: Text | _Texts | None = None
    """Physical value of the numbers in the file.

    ``"99.7 mV/g"`` for channels in volts, ``"0.488 mg/count"`` or ``"256 LSB/g"`` for those of a
    converter, ``"0.1 g"`` for one unit of the file (full scale of an integer WAV). One for all
    channels, one for each, or ``"NAME=99.7 mV/g"`` for named channels.
    """
    channels: Annotated[tuple[Text | _Count, ...], Meta(min_length=1)] | None = None
    """Columns or variables to read: names, patterns such as ``"*_DE_time"``, or numbers from 0.

    None reads all.
    """
    names: _Texts | None = None
    """Names of the channels; None keeps those of the file."""
    time_column: Text | _Count | None = None
    """Name or number (from 0) of the column with the time.

    None finds it by its name, or because it rises evenly.
    """
    time_unit: Text | None = None
    """Unit of that column, such as ``"us"``; None takes it from its heading or its size."""
    header_lines: _Count | None = None
    """Lines before the first sample of a text file; None detects them."""
    separator: Annotated[str, Meta(min_length=1, max_length=1)] | None = None
    """Character between two columns of a text file; None detects it."""
    decimal: Literal[".", ","] | None = None
    """Decimal mark of a text file, ``"."`` or ``","``; None detects it."""
    speed: str | None = None
    """Speed of the shaft, such as ``"860 rpm"``; without `pressure` it is kept as an attribute."""
    pressure: str | None = None
    """Absolute pressure at the outlet, such as ``"15 MPa"``."""


@dataclass(frozen=True)
class RawFile:
    """Content of one file: the result of a format's `read`."""

    columns: Mapping[str, Column]
    """Signals by name, in the file's order: arrays, or objects that read when they are sliced."""
    sample_rate: float | None = None
    """Rate that the file states or its time column shows [Hz]."""
    units: Mapping[str, str] = field(default_factory=dict)
    """Unit of each column for which the file names one."""
    attributes: Mapping[str, str] = field(default_factory=dict)
    """Further facts in the file."""
    facts: Mapping[str, Any] = field(default_factory=dict)
    """Fields of `Recording` that the file states.

    ``recording_id``, ``label``, ``specimen``, ``synthetic``, and ``condition``, the keys of an
    `OperatingCondition` in SI units.
    """
    speeds: Column | None = None
    """Angular speed of the shaft at each sample [rad/s], if the file has it."""
    full_scale: bool = False
    """Whether samples are shares of an unknown full scale (integer WAV)."""
    rates: Mapping[str, float] = field(default_factory=dict)
    """Rate of each column [Hz], if the file has several."""
    sensitivities: Mapping[str, str] = field(default_factory=dict)
    """Sensitivity of each column's sensor, such as ``"99.7 mV/g"``, for columns in volts."""
    starts: Mapping[str, str] = field(default_factory=dict)
    """Start of each column as text, if the file states it.

    Columns with different starts do not belong to one recording.
    """
    breaks: tuple[int, ...] = ()
    """Samples at which another recording begins."""
    foreign_units: Mapping[str, str] = field(default_factory=dict)
    """Text of each column's unit that is not in `units`, because nobody here knows it."""

    @property
    def condition(self) -> OperatingCondition | None:
        """Operating point that the file states, or None."""
        values = self.facts.get("condition")
        return None if values is None else OperatingCondition(**values)


def require_plausible_size(path: Path, size: float, content: str) -> None:
    """Refuse a file whose content is larger than measurements can be unpacked to.

    Parameters
    ----------
    size : bytes of the unpacked content, which is read in parts.
    content : what has this size, for the message.
    """
    packed_size = path.stat().st_size
    limit = memory_limit()
    if size > limit and size > _MAX_COMPRESSION * packed_size:
        raise DataError(
            f"{path} of {packed_size / 1e6:.3g} MB unpacks to {size / 1e9:.3g} GB ({content}), "
            f"more than {_MAX_COMPRESSION} times its size and more than the limit of "
            f"{limit / 1e9:.3g} GB; it is damaged, or not a measurement."
        )


def require_plausible_rates(path: Path, raw: RawFile) -> None:
    """Refuse a file that states a sample rate outside `SAMPLE_RATE_RANGE_HZ`."""
    lowest, highest = SAMPLE_RATE_RANGE_HZ
    for rate in (raw.sample_rate, *raw.rates.values()):
        if rate is not None and not lowest <= rate <= highest:
            raise DataError(
                f"{path} states a sample rate of {rate:g} Hz; the file is damaged, "
                "or its time column does not hold times."
            )


def snap_rate(step: float, tolerance: float) -> float:
    """Return a common sample rate [Hz] that a rounded time step can stand for.

    Rates of few digits are tried first, then whole fractions of converters' rates. If none agrees
    with the step, its inverse is returned.

    Parameters
    ----------
    step : time between two samples [s].
    tolerance : relative error of `step`, such as 5e-6 for six digits.
    """
    rate = 1 / step
    candidates = [float(f"{rate:.{digits}e}") for digits in range(5)]
    for converter_rate in _CONVERTER_RATES_HZ:
        candidates.append(converter_rate / max(1, round(converter_rate / rate)))

    for candidate in candidates:
        if abs(candidate * step - 1) <= tolerance * (1 + 1e-6):
            return candidate
    return rate
