"""Samples of a recording: an array in memory, or columns of a file that are read in parts."""

import hashlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Float, Shaped

from swashtwin.foundation import DataError, InputError, SwashTwinError, require_memory
from swashtwin.recordings.formats.columns import BLOCK_SAMPLES, Column, number_type

_UNEQUAL = 0.25
"""Share by which the steps of a ramp may differ: those of a time that was written with few digits
do.
"""


@dataclass(frozen=True)
class Columns:
    """Channels of one recording, as its file holds them."""

    channels: tuple[Column, ...]
    """The samples of each channel."""
    factors: tuple[float, ...]
    """What one unit of each channel's column stands for in the recording's unit."""
    speed: Column | None = None
    """Angular speed of the shaft at each sample [rad/s], or None where it was not measured."""
    hashes: tuple[str, ...] = ()
    """`Samples.content_hashes` of what was recorded, where the columns are another form of it; else
    empty.
    """


class Samples:
    """Samples of one recording; a file must stay as it is while they are read from it.

    Parameters
    ----------
    name : how messages call the recording.
    shape : number of channels and of samples of each.
    dtype : number type of `raw`.
    has_speed : whether the speed of the shaft was measured at each sample.
    open_columns : opens the file. None for samples in memory.
    columns : the opened file.
    origin : samples that these were made of, such as those that they are a slice of.
    """

    def __init__(
        self,
        name: str,
        shape: tuple[int, int],
        dtype: np.dtype,
        has_speed: bool,
        open_columns: Callable[[], Columns] | None,
        columns: Columns | None = None,
        origin: "Samples | None" = None,
    ) -> None:
        self.name = name
        self.shape = shape
        self.dtype = dtype
        self.has_speed = has_speed
        self.open_columns = open_columns
        """What opens the file; None for samples in memory."""
        self._columns = columns
        self._arrays: tuple[np.ndarray, np.ndarray | None] | None = None
        self._origin = origin
        self._hashes: dict[str, tuple[str, ...]] = {} if origin is None else origin._hashes

    @classmethod
    def from_columns(
        cls, name: str, columns: Columns, open_columns: Callable[[], Columns]
    ) -> "Samples":
        """Samples of a file that is open; `open_columns` opens it again."""
        shape = (len(columns.channels), len(columns.channels[0]))
        if columns.speed is not None and len(columns.speed) != shape[1]:
            raise DataError(
                f"{name}: the file is damaged: it has {len(columns.speed)} speeds for {shape[1]} samples."
            )
        samples = cls(
            name, shape, np.dtype(np.float64), columns.speed is not None, open_columns, columns
        )
        with samples._refuse_damage("the first sample cannot be read"):
            samples.dtype = np.result_type(*(number_type(column) for column in columns.channels))
        return samples

    @classmethod
    def in_memory(
        cls,
        name: str,
        signal: np.ndarray,
        speed: np.ndarray | None,
        origin: "Samples | None" = None,
    ) -> "Samples":
        """Samples of an array (channel, time) and, where it was measured, the speed at each sample
        [rad/s].

        Parameters
        ----------
        origin : samples that they were made of.
        """
        if signal.ndim != 2 or signal.size == 0:
            raise DataError(f"{name}: signal has shape {signal.shape}; it must be (channel, time).")
        samples = cls(
            name,
            (signal.shape[0], signal.shape[1]),
            signal.dtype,
            speed is not None,
            None,
            origin=origin,
        )
        if speed is not None:
            require_speed(name, speed, samples.shape[1])
        samples._arrays = (signal, speed)
        return samples

    @property
    def signal(self) -> Float[np.ndarray, "channel time"]:
        """All samples, which are read when first asked for and stay in memory."""
        if self._arrays is None:
            count = self.shape[1]
            require_memory(
                self.name,
                8 * self.shape[0] * count,
                reason="takes, with all its samples in memory,",
            )
            speed = self.speed_part(0, count)
            if speed is not None:
                require_speed(self.name, speed, count)
            self._arrays = (self.signal_part(0, count), speed)
        return self._arrays[0]

    @property
    def speed(self) -> Float[np.ndarray, " time"] | None:
        """Speed at each sample [rad/s], read like `signal`."""
        if not self.has_speed:
            return None
        return self.speed_part(0, self.shape[1]) if self._arrays is None else self._arrays[1]

    @property
    def factors(self) -> tuple[float, ...]:
        """What one unit of each channel in `raw` stands for."""
        return (1.0,) * self.shape[0] if self.open_columns is None else self._opened().factors

    def raw(self, start: int, stop: int) -> Shaped[np.ndarray, "channel time"]:
        """Samples from `start` to before `stop`, in the number type of the file and without the
        factors.
        """
        start, stop = self._span(start, stop)
        if self.open_columns is None:
            return self.signal[:, start:stop]
        channels = self._opened().channels
        samples = np.empty((len(channels), stop - start), self.dtype)
        for at in range(start, stop, BLOCK_SAMPLES):  # columns beside each other are read together
            end = min(at + BLOCK_SAMPLES, stop)
            with self._refuse_damage(f"samples {at} to {end} cannot be read"):
                for row, column in zip(samples, channels, strict=True):
                    np.copyto(
                        row[at - start : end - start], _part(column, at, end), casting="same_kind"
                    )
        return samples

    def signal_part(self, start: int, stop: int) -> Float[np.ndarray, "channel time"]:
        """Samples from `start` to before `stop`, in the recording's unit."""
        start, stop = self._span(start, stop)
        if self._arrays is not None:
            return self._arrays[0][:, start:stop]
        signal: Float[np.ndarray, "channel time"] = self.raw(start, stop).astype(np.float64)
        signal *= np.array(self.factors)[:, None]
        return signal

    def speed_part(self, start: int, stop: int) -> Float[np.ndarray, " time"] | None:
        """Speed at the samples from `start` to before `stop` [rad/s], or None where it was not
        measured.
        """
        start, stop = self._span(start, stop)
        if not self.has_speed:
            return None
        if self._arrays is not None:
            speed = self._arrays[1]
            return None if speed is None else speed[start:stop]
        column = self._opened().speed
        assert column is not None
        with self._refuse_damage(f"samples {start} to {stop} cannot be read"):
            return _part(column, start, stop).astype(np.float64)

    def pick(self, rows: Sequence[int]) -> "Samples":
        """The samples of some channels."""
        if self.open_columns is None:
            return Samples.in_memory(self.name, self.signal[list(rows)], self.speed, self._origin)
        open_picked = partial(_pick, self.open_columns, tuple(rows))
        samples = Samples(
            self.name, (len(rows), self.shape[1]), self.dtype, self.has_speed, open_picked
        )
        if self._arrays is not None:
            samples._arrays = (self.signal[list(rows)], self.speed)
        return samples

    def unopened(self) -> "Samples":
        """The same samples, with nothing in memory that the file has."""
        if self.open_columns is None:
            return self
        columns = self._columns
        if columns is not None and any(
            isinstance(column, np.ndarray) for column in columns.channels
        ):
            columns = None
        samples = Samples(
            self.name, self.shape, self.dtype, self.has_speed, self.open_columns, columns
        )
        samples._hashes = self._hashes
        return samples

    def content_hashes(self) -> tuple[str, ...]:
        """SHA-256 of each channel's samples as recorded, 32 hexadecimal digits; an empty text where
        they tell nothing.

        That is a channel that never changes, or rises by equal steps, as a counter, an index or a
        time does. The samples count in single precision and in the recording's unit, before any
        resampling. Names, rates, formats and the order of channels do not count. A slice, and
        samples put in the place of others (`Recording.replace`), have the hashes of what they were
        made of.
        """
        if "content" not in self._hashes:
            self._hashes["content"] = self.original_hashes() or hash_channels(
                self.signal_part(at, at + BLOCK_SAMPLES)
                for at in range(0, self.shape[1], BLOCK_SAMPLES)
            )
        return self._hashes["content"]

    def original_hashes(self) -> tuple[str, ...]:
        """`content_hashes` where the samples are another form of what was recorded; else empty."""
        if self._origin is not None:
            return self._origin.content_hashes()
        return () if self.open_columns is None else self._opened().hashes

    def __getstate__(self) -> dict[str, Any]:
        """What another process gets: the arrays, or how to open the file."""
        if self._origin is not None:
            self.content_hashes()  # so that the origin need not go along
        return {**self.__dict__, "_columns": None, "_origin": None}

    def _opened(self) -> Columns:
        if self._columns is None:
            assert self.open_columns is not None
            with self._refuse_damage("cannot be opened again"):
                columns = self.open_columns()
            shape = (len(columns.channels), len(columns.channels[0]))
            if shape != self.shape or (columns.speed is not None) != self.has_speed:
                raise DataError(
                    f"{self.name}: the file has changed from (channel, time) {self.shape} to {shape}."
                )
            self._columns = columns
        return self._columns

    @contextmanager
    def _refuse_damage(self, failure: str) -> Iterator[None]:
        """Turn whatever a library raises into a `DataError`: what a damaged file makes it raise has
        no bounds.
        """
        try:
            yield
        except SwashTwinError:
            raise
        except Exception as cause:
            reason = (str(cause).splitlines() or [""])[0][:160]
            raise DataError(
                f"{self.name}: {failure} ({type(cause).__name__}: {reason})."
            ) from cause

    def _span(self, start: int, stop: int) -> tuple[int, int]:
        if not (isinstance(start, (int, np.integer)) and isinstance(stop, (int, np.integer))):
            raise InputError(
                f"{self.name}: samples are counted by whole numbers, and not from {start!r} to {stop!r}."
            )
        if not 0 <= start < min(stop, self.shape[1]):
            raise InputError(
                f"{self.name} has no samples {start} to {stop}; it has {self.shape[1]}."
            )
        return start, min(stop, self.shape[1])


def _part(column: Column, start: int, stop: int) -> np.ndarray:
    values = np.asarray(column[start:stop])
    if values.shape != (stop - start,):
        raise ValueError(f"there are {values.shape} of them; was the file changed?")
    return values


def require_speed(name: str, speed: np.ndarray, count: int) -> None:
    """Refuse a speed [rad/s] that is not one positive number or zero for each of `count`
    samples.
    """
    if speed.shape != (count,):
        raise DataError(f"{name}: speed has shape {speed.shape} for {count} samples; one for each.")
    wrong = np.flatnonzero(~(np.isfinite(speed) & (speed >= 0)))
    if wrong.size:
        raise DataError(
            f"{name}: speed ({speed[wrong[0]]:g} rad/s at sample {wrong[0]}) must be zero or a positive number."
        )


def _pick(open_columns: Callable[[], Columns], rows: tuple[int, ...]) -> Columns:
    columns = open_columns()
    channels = tuple(columns.channels[row] for row in rows)
    hashes = tuple(columns.hashes[row] for row in rows) if columns.hashes else ()
    return Columns(channels, tuple(columns.factors[row] for row in rows), columns.speed, hashes)


def rises_evenly(samples: Shaped[np.ndarray, " time"], step: float) -> bool:
    """Whether samples rise or fall by `step` each time, as a counter or a time does, or are
    constant if that is 0.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        return all(
            bool((abs(np.diff(part) - step) <= _UNEQUAL * abs(step)).all())
            for part in (samples[:64], samples)
        )


def hash_channels(parts: Iterable[Float[np.ndarray, "channel time"]]) -> tuple[str, ...]:
    """`Samples.content_hashes` of samples that come in parts."""
    digests: list[Any] = []
    first = np.empty((0, 1), np.float32)
    last = step = np.empty((0, 1))
    is_constant = is_ramp = np.empty(0, bool)
    for part in parts:
        with np.errstate(over="ignore"):
            rows = part.astype(np.float32, order="C")
        rows += 0.0  # one zero, whatever its sign
        if not digests:
            digests, first = [hashlib.sha256() for _ in rows], rows[:, :1].copy()
            last, step = part[:, :0], np.diff(part[:, :2])
            is_constant, is_ramp = np.full(len(rows), True), np.full(len(rows), step.shape[1] == 1)
        for number, row in enumerate(rows):
            digests[number].update(row.data)
            is_constant[number] = is_constant[number] and (row == first[number]).all()
            if is_ramp[number]:
                is_ramp[number] = rises_evenly(
                    np.concatenate([last[number], part[number]]), float(step[number, 0])
                )
        last = part[:, -1:].copy()
    return tuple(
        "" if empty else digest.hexdigest()[:32]
        for digest, empty in zip(digests, is_constant | is_ramp, strict=True)
    )
