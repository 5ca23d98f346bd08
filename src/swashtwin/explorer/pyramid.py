"""Extremes and root mean square along a recording, which is read in parts in the background."""

import threading

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int

from swashtwin.foundation import DataError, SwashTwinError
from swashtwin.recordings import BLOCK_SAMPLES, Recording

BIN = 64
"""Samples of the finest extremes that are kept of a whole recording: 1/32 of its values."""
RMS_PARTS = 120
"""Equal parts of a recording whose root mean square is known, or one for each sample if it has
fewer.
"""


class Pyramid:
    """Extremes of bins and root mean square of parts of one recording.

    Only one block of the recording is in memory at a time. Blocks are read in an order that is
    always spread over the whole recording, so that figures of a long one show all of it at once,
    and become finer while it is read.

    Parameters
    ----------
    recording : recording whose samples are in its file, or in memory.
    """

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
        n_bins = -(-recording.n_samples // BIN)
        self._extremes = np.full((recording.n_channels, n_bins, 2), np.nan, np.float32)

        n_parts = min(RMS_PARTS, recording.n_samples)
        self._edges = np.linspace(0, recording.n_samples, n_parts + 1).astype(int)
        self._counts = np.zeros((recording.n_channels, n_parts))
        self._sums = np.zeros((recording.n_channels, n_parts))
        self._squares = np.zeros((recording.n_channels, n_parts))
        self._offset: Float64[np.ndarray, "channel 1"] | None = None

        self._n_read = 0
        self._failure: Exception | None = None
        self._is_stopped = False
        self._has_ended = threading.Event()
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._lock = threading.Lock()

    def wait(self, timeout_s: float | None = None) -> float:
        """Return the share of the recording that was read, after at most `timeout_s`.

        The first call starts to read; without a timeout, it returns once all was read, or after
        `stop`.

        Raises
        ------
        DataError
            The file is damaged, was changed after it was opened, or cannot be read for another
            reason, such as too little memory.
        """
        with self._lock:
            if self._thread.ident is None:
                self._thread.start()
        self._has_ended.wait(timeout_s)
        if self._failure is not None:
            raise self._failure
        return self._n_read / self._recording.n_samples

    def stop(self) -> None:
        """Read no further block; what was read stays."""
        self._is_stopped = True

    def _read(self) -> None:
        try:
            for block in spread_order(-(-self._recording.n_samples // BLOCK_SAMPLES)).tolist():
                if self._is_stopped:
                    break
                self._read_block(block * BLOCK_SAMPLES)
        except (SwashTwinError, OSError) as cause:
            self._failure = cause
        except Exception as cause:
            # Whoever waits must hear of any error, since the thread has no other reader.
            name = self._recording.recording_id
            self._failure = DataError(f"{name}: the samples cannot be read ({cause!r}).")
        finally:
            self._has_ended.set()

    def _read_block(self, start: int) -> None:
        stop = min(start + BLOCK_SAMPLES, self._recording.n_samples)
        signal = self._recording.samples.signal_part(start, stop)

        # A block begins at a bin, since its length is a multiple of one.
        bins = slice(start // BIN, -(-stop // BIN))
        self._extremes[:, bins] = merge_bins(np.stack([signal, signal], axis=-1), BIN)

        # Missing and infinite samples count nowhere: one would hide the values of its whole part.
        is_present = np.isfinite(signal)
        if self._offset is None:
            self._offset = _mean_of_present(signal, is_present)

        # Squares of a small deviation from a large mean would cancel.
        deviation = np.where(is_present, signal - self._offset, 0.0)
        first_part = int(np.searchsorted(self._edges, start, side="right")) - 1
        end_part = int(np.searchsorted(self._edges, stop))
        parts = slice(first_part, end_part)
        starts = np.maximum(self._edges[parts], start) - start
        self._counts[:, parts] += np.add.reduceat(is_present, starts, axis=1, dtype=np.float64)
        self._sums[:, parts] += np.add.reduceat(deviation, starts, axis=1)
        self._squares[:, parts] += np.add.reduceat(deviation**2, starts, axis=1)
        self._n_read += stop - start

    def extremes(self, width: int, start: int, count: int) -> Float32[np.ndarray, "channel bin 2"]:
        """Return the smallest and largest sample of each of `count` bins, fewer at the end.

        They are NaN if nothing of a bin was read yet.

        Parameters
        ----------
        width : samples of a bin: fewer than `BIN`, which are read from the file, or a multiple.
        start : number of the first bin.
        """
        if width >= BIN:
            bins_per_bin = width // BIN
            part = self._extremes[:, start * bins_per_bin : (start + count) * bins_per_bin]
            return merge_bins(part, bins_per_bin)

        recording = self._recording
        stop = min((start + count) * width, recording.n_samples)
        if start * width >= stop:
            signal = np.zeros((recording.n_channels, 0))
        else:
            signal = recording.samples.signal_part(start * width, stop)
        return merge_bins(np.stack([signal, signal], axis=-1), width)

    def rms(self, count: int = RMS_PARTS) -> Float64[np.ndarray, "channel part"]:
        """Return the root mean square of each channel, without its mean, in equal parts.

        It is that of the samples that were read and are not missing, and NaN if a part has none.
        """
        n_parts = self._counts.shape[1]
        starts = np.linspace(0, n_parts, min(count, n_parts), endpoint=False).astype(int)
        counts = np.add.reduceat(self._counts, starts, axis=1)
        counts[counts == 0] = np.nan
        mean = np.add.reduceat(self._sums, starts, axis=1) / counts
        power = np.add.reduceat(self._squares, starts, axis=1) / counts - mean**2
        return np.asarray(np.sqrt(np.maximum(power, 0)))


def _mean_of_present(
    signal: Float64[np.ndarray, "channel time"], is_present: Bool[np.ndarray, "channel time"]
) -> Float64[np.ndarray, "channel 1"]:
    """Return the mean of the samples of each channel that are present, 0 if there are none."""
    total = np.sum(signal, axis=1, keepdims=True, where=is_present)
    count = np.count_nonzero(is_present, axis=1, keepdims=True)
    return np.asarray(total / np.maximum(count, 1))


def spread_order(count: int) -> Int[np.ndarray, " number"]:
    """Return the numbers 0 to `count` - 1 in an order whose beginnings are spread evenly.

    Their binary digits are read backwards (van der Corput).

    Examples
    --------
    >>> spread_order(8).tolist()
    [0, 4, 2, 6, 1, 5, 3, 7]
    """
    n_digits = max(1, (count - 1).bit_length())
    reversed_digits = [int(f"{number:0{n_digits}b}"[::-1], 2) for number in range(count)]
    return np.argsort(reversed_digits)


def merge_bins(extremes: np.ndarray, bins_per_bin: int) -> Float32[np.ndarray, "channel bin 2"]:
    """Merge groups of neighboring bins into one each; the last group may be smaller."""
    starts = np.arange(0, extremes.shape[1], bins_per_bin)
    if bins_per_bin == 1 or not starts.size:
        return extremes.astype(np.float32)

    # fmin and fmax skip NaN, so a gap hides no samples.
    minima = np.fmin.reduceat(extremes[..., 0], starts, axis=1)
    maxima = np.fmax.reduceat(extremes[..., 1], starts, axis=1)
    return np.stack([minima, maxima], axis=-1).astype(np.float32)
