"""Samples of a recording: an array in memory, or columns of a file that are read in parts."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Shaped

from swashtwin.foundation import DataError, InputError, SwashTwinError, require_memory
from swashtwin.recordings.columns import BLOCK_SAMPLES, Column, number_type
from swashtwin.recordings.content_hashes import hash_channels

# Characters of a library's error that a message repeats.
_MAX_REASON_LENGTH = 160


@dataclass(frozen=True)
class Columns:
    """Channels of one recording, as its file holds them."""

    channels: tuple[Column, ...]
    """Samples of each channel."""
    factors: tuple[float, ...]
    """Value of one unit of each channel's column, in the recording's unit."""
    speed: Column | None = None
    """Angular speed of the shaft at each sample [rad/s], or None if it was not measured."""
    hashes: tuple[str, ...] = ()
    """`Samples.content_hashes` of the original, if the columns were computed from it."""

    @property
    def shape(self) -> tuple[int, int]:
        """Number of channels, and of samples of each."""
        return len(self.channels), len(self.channels[0])

    def select(self, rows: Sequence[int]) -> "Columns":
        """Return the columns of some channels."""
        return Columns(
            channels=tuple(self.channels[row] for row in rows),
            factors=tuple(self.factors[row] for row in rows),
            speed=self.speed,
            hashes=tuple(self.hashes[row] for row in rows) if self.hashes else (),
        )


class Samples:
    """Samples of one recording; a file must not change while they are read from it.

    Parameters
    ----------
    name : name of the recording in messages.
    shape : number of channels and of samples of each.
    dtype : number type of `raw`.
    has_speed : whether the speed of the shaft was measured at each sample.
    open_columns : opens the file; None for samples in memory.
    columns : the opened file.
    origin : samples from which these were made, such as those they are a slice of.
    file : absolute path of the file that `open_columns` reads.
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
        file: Path | None = None,
    ) -> None:
        self.name = name
        self.shape = shape
        self.dtype = dtype
        self.has_speed = has_speed
        self.open_columns = open_columns
        """Opens the file; None for samples in memory."""
        self.file = file
        """Absolute path of the file, which another process must see too; None without one."""
        self._columns = columns
        self._arrays: tuple[np.ndarray, np.ndarray | None] | None = None
        self._origin = origin
        self._hashes: dict[str, tuple[str, ...]] = {} if origin is None else origin._hashes

    @classmethod
    def from_columns(
        cls,
        name: str,
        columns: Columns,
        open_columns: Callable[[], Columns],
        file: Path | None = None,
    ) -> "Samples":
        """Return the samples of a file that is open; `open_columns` opens it again."""
        shape = columns.shape
        has_speed = columns.speed is not None
        if columns.speed is not None and len(columns.speed) != shape[1]:
            raise DataError(
                f"{name}: the file is damaged: it has {len(columns.speed)} speeds "
                f"for {shape[1]} samples."
            )

        samples = cls(
            name, shape, np.dtype(np.float64), has_speed, open_columns, columns, file=file
        )
        with samples._translate_damage("the first sample cannot be read"):
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
        """Return the samples of an array (channel, time).

        Parameters
        ----------
        speed : speed of the shaft at each sample [rad/s], if it was measured.
        origin : samples from which they were made.
        """
        if signal.ndim != 2 or signal.size == 0:
            raise DataError(f"{name}: signal has shape {signal.shape}; it must be (channel, time).")

        shape = (signal.shape[0], signal.shape[1])
        samples = cls(name, shape, signal.dtype, speed is not None, None, origin=origin)
        if speed is not None:
            require_speed(name, speed, shape[1])
        samples._hold(signal, speed)
        return samples

    def _hold(
        self, signal: np.ndarray, speed: np.ndarray | None
    ) -> tuple[np.ndarray, np.ndarray | None]:
        """Keep samples in memory, as arrays that cannot be written to.

        Slices share them, and hashes that were computed of them are kept: a changed sample would
        leave both wrong.
        """
        signal = signal.view()
        signal.flags.writeable = False
        if speed is not None:
            speed = speed.view()
            speed.flags.writeable = False
        self._arrays = (signal, speed)
        return self._arrays

    @property
    def signal(self) -> Float[np.ndarray, "channel time"]:
        """All samples, which are read on first use and stay in memory."""
        arrays = self._arrays
        if arrays is None:
            n_channels, count = self.shape
            require_memory(
                self.name, 8 * n_channels * count, reason="takes, with all its samples in memory,"
            )
            speed = self.speed_part(0, count)
            if speed is not None:
                require_speed(self.name, speed, count)
            arrays = self._hold(self.signal_part(0, count), speed)
        return arrays[0]

    @property
    def speed(self) -> Float[np.ndarray, " time"] | None:
        """Speed of the shaft at each sample [rad/s], or None if it was not measured."""
        return self.speed_part(0, self.shape[1])

    @property
    def is_loaded(self) -> bool:
        """Whether all samples are in memory."""
        return self._arrays is not None

    @property
    def factors(self) -> tuple[float, ...]:
        """Value of one unit of each channel in `raw`."""
        return (1.0,) * self.shape[0] if self.open_columns is None else self._opened().factors

    def raw(self, start: int, stop: int) -> Shaped[np.ndarray, "channel time"]:
        """Return the samples from `start` to before `stop`, without the factors.

        They have the number type of the file.
        """
        start, stop = self._require_span(start, stop)
        if self.open_columns is None:
            return self.signal[:, start:stop]

        channels = self._opened().channels
        samples = np.empty((len(channels), stop - start), self.dtype)
        # Block by block through all channels: a file that interleaves them is unpacked once.
        for block_start in range(start, stop, BLOCK_SAMPLES):
            block_stop = min(block_start + BLOCK_SAMPLES, stop)
            target = slice(block_start - start, block_stop - start)
            with self._translate_damage(f"samples {block_start} to {block_stop} cannot be read"):
                for row, column in zip(samples, channels, strict=True):
                    values = _read_column(column, block_start, block_stop)
                    np.copyto(row[target], values, casting="same_kind")
        return samples

    def signal_part(self, start: int, stop: int) -> Float[np.ndarray, "channel time"]:
        """Return the samples from `start` to before `stop`, in the recording's unit."""
        start, stop = self._require_span(start, stop)
        arrays = self._arrays
        if arrays is not None:
            return arrays[0][:, start:stop]

        signal: Float[np.ndarray, "channel time"] = self.raw(start, stop).astype(np.float64)
        signal *= np.array(self.factors)[:, None]
        return signal

    def speed_part(self, start: int, stop: int) -> Float[np.ndarray, " time"] | None:
        """Return the speed at the samples from `start` to before `stop` [rad/s].

        None if it was not measured.
        """
        start, stop = self._require_span(start, stop)
        if not self.has_speed:
            return None

        arrays = self._arrays
        if arrays is not None:
            return None if arrays[1] is None else arrays[1][start:stop]

        column = self._opened().speed
        assert column is not None
        with self._translate_damage(f"samples {start} to {stop} cannot be read"):
            return _read_column(column, start, stop).astype(np.float64)

    def select(self, rows: Sequence[int]) -> "Samples":
        """Return the samples of some channels."""
        if self.open_columns is None:
            return Samples.in_memory(self.name, self.signal[list(rows)], self.speed, self._origin)

        open_selected = partial(_open_selected, self.open_columns, tuple(rows))
        shape = (len(rows), self.shape[1])
        samples = Samples(
            self.name, shape, self.dtype, self.has_speed, open_selected, file=self.file
        )
        if self._arrays is not None:
            samples._hold(self.signal[list(rows)], self.speed)
        return samples

    def unopened(self) -> "Samples":
        """Return the same samples, with nothing in memory that the file has."""
        if self.open_columns is None:
            return self

        samples = Samples(
            self.name,
            self.shape,
            self.dtype,
            self.has_speed,
            self.open_columns,
            self._columns,
            file=self.file,
        )
        samples._hashes = self._hashes
        samples.release()
        return samples

    def release(self) -> None:
        """Forget what can be read from the file again."""
        if self.open_columns is None:
            return

        self._arrays = None
        columns = self._columns
        # Columns that read when they are sliced hold no samples: they stay, for they cost nothing.
        if columns is not None and any(
            isinstance(column, np.ndarray) for column in columns.channels
        ):
            self._columns = None

    def content_hashes(self) -> tuple[str, ...]:
        """Return the SHA-256 of each channel's samples as recorded, 32 hexadecimal digits.

        The text is empty for a channel that does not identify a measurement: one that never
        changes, or rises by equal steps as a counter, an index or a time does. The samples count
        in single precision and in the recording's unit, before any resampling. Names, rates,
        formats and the order of channels do not count. A slice, and samples that replace others
        (`Recording.replace`), have the hashes of their origin.
        """
        if "content" not in self._hashes:
            hashes = self.original_hashes()
            if not hashes:
                starts = range(0, self.shape[1], BLOCK_SAMPLES)
                hashes = hash_channels(
                    self.signal_part(start, start + BLOCK_SAMPLES) for start in starts
                )
            self._hashes["content"] = hashes
        return self._hashes["content"]

    def original_hashes(self) -> tuple[str, ...]:
        """Return the `content_hashes` of the original of computed samples; else nothing."""
        if self._origin is not None:
            return self._origin.content_hashes()
        return () if self.open_columns is None else self._opened().hashes

    def __getstate__(self) -> dict[str, Any]:
        """Return what another process gets: the arrays, or how to open the file."""
        if self._origin is not None:
            self.content_hashes()  # while the origin is here: it does not go along
        return {**self.__dict__, "_columns": None, "_origin": None}

    def _opened(self) -> Columns:
        columns = self._columns
        if columns is not None:
            return columns

        assert self.open_columns is not None
        with self._translate_damage("cannot be opened again"):
            columns = self.open_columns()
        if columns.shape != self.shape or (columns.speed is not None) != self.has_speed:
            raise DataError(
                f"{self.name}: the file has changed from (channel, time) {self.shape} "
                f"to {columns.shape}."
            )
        self._columns = columns
        return columns

    @contextmanager
    def _translate_damage(self, failure: str) -> Iterator[None]:
        """Turn whatever a library raises for a damaged file into a `DataError`.

        A damaged file can make a library raise any exception.
        """
        try:
            yield
        except SwashTwinError:
            raise
        except Exception as cause:
            first_line = (str(cause).splitlines() or [""])[0][:_MAX_REASON_LENGTH]
            raise DataError(
                f"{self.name}: {failure} ({type(cause).__name__}: {first_line})."
            ) from cause

    def _require_span(self, start: int, stop: int) -> tuple[int, int]:
        """Return the span, cut at the last sample."""
        if not (isinstance(start, (int, np.integer)) and isinstance(stop, (int, np.integer))):
            raise InputError(
                f"{self.name}: sample numbers must be integers, not {start!r} to {stop!r}."
            )

        count = self.shape[1]
        if not 0 <= start < min(stop, count):
            raise InputError(f"{self.name} has no samples {start} to {stop}; it has {count}.")
        return start, min(stop, count)


def _read_column(column: Column, start: int, stop: int) -> np.ndarray:
    values = np.asarray(column[start:stop])
    if values.shape != (stop - start,):
        raise ValueError(f"their shape is {values.shape}; was the file changed?")
    return values


def _open_selected(open_columns: Callable[[], Columns], rows: tuple[int, ...]) -> Columns:
    return open_columns().select(rows)


def require_speed(name: str, speed: np.ndarray, count: int) -> None:
    """Require a speed [rad/s] that is positive or zero at each of `count` samples."""
    if speed.shape != (count,):
        raise DataError(f"{name}: speed has shape {speed.shape} for {count} samples; one for each.")

    invalid = np.flatnonzero(~(np.isfinite(speed) & (speed >= 0)))
    if invalid.size:
        raise DataError(
            f"{name}: speed ({speed[invalid[0]]:g} rad/s at sample {invalid[0]}) "
            "must be zero or a positive number."
        )
