"""Windows put together again to the recordings that they were cut from."""

from collections.abc import Callable, Iterator

import numpy as np
from jaxtyping import Float, Float32, Int64

from swashtwin.learning.recordings.recording_levels import RecordingLevels
from swashtwin.learning.windows.window_set import WindowSet

Rows = Int64[np.ndarray, " window"]
Change = Callable[[Float32[np.ndarray, "channel time"]], Float32[np.ndarray, "channel time"]]


def recording_rows(windows: WindowSet) -> list[Rows]:
    """Rows of each recording's windows in order of time, in the order of the ids."""
    order = np.lexsort((windows.start, windows.recording_id))
    names = windows.recording_id[order]
    return [part for part in np.split(order, np.flatnonzero(names[1:] != names[:-1]) + 1) if part.size]


def joined(windows: WindowSet, rows: Rows) -> Iterator[Float32[np.ndarray, "channel time"]]:
    """Stretches without a gap that a recording's windows, which may overlap, make up."""
    parts, end = list[np.ndarray](), 0
    for row in rows.tolist():
        start = int(windows.start[row])
        if parts and not 0 <= end - start <= windows.length:
            yield np.concatenate(parts, axis=1)
            parts = []
        parts.append(windows.signal[row][:, end - start if parts else 0 :])
        end = start + windows.length
    yield np.concatenate(parts, axis=1)


def shortest_stretch(windows: WindowSet) -> int:
    """Samples of the longest stretch of the recording whose longest stretch is the shortest."""
    return min(max(part.shape[1] for part in joined(windows, rows)) for rows in recording_rows(windows))


def levels_of(
    layout: RecordingLevels, windows: WindowSet, rows: list[Rows], change: Change = lambda stretch: stretch
) -> Float[np.ndarray, "recording channel level"]:
    """Levels of recordings by their windows: of their stretches the mean by length.

    Parameters
    ----------
    rows : rows of each recording's windows, as of `recording_rows`.
    change : what is done to each stretch before.
    """
    levels = np.empty((len(rows), windows.n_channels, layout.n_levels), dtype=np.float32)
    for number, members in enumerate(rows):
        shaft = float(windows.speed[members[0]]) / (2 * np.pi)
        parts = list(joined(windows, members))
        weights = [part.shape[1] for part in parts]
        levels[number] = np.average([layout.measure(change(part), shaft) for part in parts], axis=0, weights=weights)
    return levels
