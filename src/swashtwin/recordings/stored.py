"""A recording that stays in its file and is read in slices, for recordings larger than memory."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Shaped

from swashtwin.foundation import DataError, SwashTwinError
from swashtwin.pump import OperatingCondition
from swashtwin.recordings.recording import Recording

BLOCK = 1 << 18
"""Readings of each channel that are in memory together: 2 MB in double precision."""


@runtime_checkable
class Column(Protocol):
    """Readings of one channel in the number type of the file; an array is one, and so is what reads when sliced."""

    def __len__(self) -> int:
        """Number of readings."""

    def __getitem__(self, where: slice, /) -> np.ndarray:
        """The readings of a slice."""


@dataclass(frozen=True, eq=False)
class StoredRecording:
    """A recording whose readings are read when asked for; the file must stay as it is meanwhile."""

    facts: Recording
    """What is known of it, with its first reading only."""
    columns: tuple[Column, ...]
    """The channels, as the file holds them."""
    factors: tuple[float, ...]
    """What one unit of each column stands for in the recording's unit."""
    speeds: Column | None = None
    """Angular speed of the shaft at each reading [rad/s], or None where nobody measured it."""

    @property
    def n_readings(self) -> int:
        """Readings of each channel."""
        return len(self.columns[0])

    @property
    def duration(self) -> float:
        """Length [s]."""
        return self.n_readings / self.facts.sample_rate

    @property
    def recording_id(self) -> str:
        """Unique name within a data set."""
        return self.facts.recording_id

    @property
    def sample_rate(self) -> float:
        """Readings per second and channel [Hz]."""
        return self.facts.sample_rate

    @property
    def channels(self) -> tuple[str, ...]:
        """Name of each channel."""
        return self.facts.channels

    @property
    def unit(self) -> str:
        """Unit of every channel."""
        return self.facts.unit

    @property
    def label(self) -> str | None:
        """Class, or None where nobody knows."""
        return self.facts.label

    @property
    def condition(self) -> OperatingCondition | None:
        """Operating condition, or None where nobody wrote it down."""
        return self.facts.condition

    @property
    def specimen(self) -> str | None:
        """Which physical machine was measured."""
        return self.facts.specimen

    @property
    def synthetic(self) -> bool:
        """Whether a model made it."""
        return self.facts.synthetic

    @property
    def attributes(self) -> Mapping[str, str]:
        """Whatever else is known."""
        return self.facts.attributes

    def relabeled(self, label: str | None) -> "StoredRecording":
        """The same measurement under another class."""
        return replace(self, facts=self.facts.relabeled(label))

    def raw(self, start: int, stop: int) -> Shaped[np.ndarray, "channel time"]:
        """Readings from `start` to before `stop`, in the number type of the file and without the factors.

        Raises
        ------
        DataError
            The file is damaged there, or was changed after it was opened.
        """
        return np.stack([self._read(column, start, stop) for column in self.columns])

    def slice(self, start: int, stop: int) -> Recording:
        """The recording from reading `start` to before reading `stop`.

        Raises
        ------
        DataError
            The file is damaged there, or was changed after it was opened.
        """
        signal: Float[np.ndarray, "channel time"] = self.raw(start, stop).astype(np.float64)
        signal *= np.array(self.factors)[:, None]
        speed = None if self.speeds is None else self._read(self.speeds, start, stop).astype(np.float64)
        return replace(self.facts, signal=signal, speed=speed)

    def blocks(self) -> Iterator[Recording]:
        """The recording in parts of `BLOCK` readings, which follow each other without a gap."""
        for start in range(0, self.n_readings, BLOCK):
            yield self.slice(start, start + BLOCK)

    def loaded(self) -> Recording:
        """The whole recording, in memory."""
        return self.slice(0, self.n_readings)

    def _read(self, column: Column, start: int, stop: int) -> np.ndarray:
        stop = min(stop, self.n_readings)
        try:
            readings = np.asarray(column[start:stop])
        except SwashTwinError:
            raise
        except Exception as cause:  # what a damaged file makes a library raise has no bounds
            reason = (str(cause).splitlines() or [""])[0][:160]
            raise DataError(
                f"{self.recording_id}: readings {start} to {stop} cannot be read ({type(cause).__name__}: {reason})."
            ) from cause
        if readings.shape != (stop - start,):
            raise DataError(f"{self.recording_id}: the file has no readings {start} to {stop}; was it changed?")
        return readings


class SideBySide:
    """Columns that a file holds beside each other, so that a slice of all is read at once and kept for the others."""

    def __init__(self, read: Callable[[int, int], np.ndarray], shape: tuple[int, int]) -> None:
        self._read = read
        self._shape = shape
        self._last: tuple[int, int, np.ndarray] | None = None

    def columns(self) -> "list[_OneOfMany]":
        """Each column by itself."""
        return [_OneOfMany(self, number) for number in range(self._shape[0])]

    def __len__(self) -> int:
        """Number of readings of each column."""
        return self._shape[1]

    def together(self, start: int, stop: int) -> np.ndarray:
        """Readings of every column from `start` to before `stop`."""
        if self._last is None or self._last[:2] != (start, stop):
            self._last = None  # its memory is needed for the next
            self._last = (start, stop, self._read(start, stop))
        return self._last[2]


class _OneOfMany:
    """One column of several that are read together."""

    def __init__(self, source: SideBySide, number: int) -> None:
        self._source = source
        self._number = number

    def __len__(self) -> int:
        return len(self._source)

    def __getitem__(self, where: slice, /) -> np.ndarray:
        start, stop, step = where.indices(len(self._source))
        readings: np.ndarray = self._source.together(start, max(start, stop))[self._number]
        return readings[::step]


def in_memory(recording: Recording) -> StoredRecording:
    """A recording that is in memory, to be read in slices like one that is not."""
    speed = None if recording.speed is None else recording.speed[:1]
    facts = replace(recording, signal=recording.signal[:, :1], speed=speed)
    return StoredRecording(facts, tuple(recording.signal), (1.0,) * recording.n_channels, recording.speed)


def opened(recording: Recording | StoredRecording) -> StoredRecording:
    """`recording`, to be read in slices wherever it is."""
    return recording if isinstance(recording, StoredRecording) else in_memory(recording)
