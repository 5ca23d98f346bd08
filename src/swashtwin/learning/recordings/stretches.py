"""Recordings, or stretches of them, joined again from the windows that were cut from them."""

from collections.abc import Callable, Iterator

import numpy as np
from jaxtyping import Float, Float32, Int64

from swashtwin.learning.recordings.recording_bands import RecordingBandLayout
from swashtwin.learning.windows.window_set import WindowSet

Rows = Int64[np.ndarray, " _window"]
Stretch = Float32[np.ndarray, "channel time"]


def recording_rows(windows: WindowSet) -> list[Rows]:
    """Return the rows of each recording's windows in order of time, ordered by recording id."""
    order = np.lexsort((windows.start, windows.recording_id))
    names = windows.recording_id[order]
    first_rows = np.flatnonzero(names[1:] != names[:-1]) + 1
    return [rows for rows in np.split(order, first_rows) if rows.size]


def join_windows(windows: WindowSet, rows: Rows) -> Iterator[Stretch]:
    """Yield the stretches without a gap of one recording's windows, which may overlap."""
    parts = list[np.ndarray]()
    end = 0
    for row in rows.tolist():
        start = int(windows.start[row])
        overlap = end - start  # negative at a gap
        if parts and not 0 <= overlap <= windows.length:
            yield np.concatenate(parts, axis=1)
            parts = []
        parts.append(windows.signal[row][:, overlap if parts else 0 :])
        end = start + windows.length
    yield np.concatenate(parts, axis=1)


def shortest_stretch(windows: WindowSet) -> int:
    """Return the samples of the shortest recording, each counted by its longest stretch."""
    longest = []
    for rows in recording_rows(windows):
        longest.append(max(stretch.shape[1] for stretch in join_windows(windows, rows)))
    return min(longest)


def _unchanged(stretch: Stretch) -> Stretch:
    return stretch


def measure_recordings(
    layout: RecordingBandLayout,
    windows: WindowSet,
    rows: list[Rows],
    change: Callable[[Stretch], Stretch] = _unchanged,
) -> Float[np.ndarray, "recording channel band"]:
    """Return the band powers of recordings, averaged over their stretches by length.

    Parameters
    ----------
    rows : rows of each recording's windows.
    change : applied to each stretch before it is measured, for instance to add noise.
    """
    shape = (len(rows), windows.n_channels, layout.n_band_powers)
    band_powers = np.empty(shape, dtype=np.float32)
    for number, members in enumerate(rows):
        shaft = float(windows.speed[members[0]]) / (2 * np.pi)
        stretches = list(join_windows(windows, members))
        lengths = [stretch.shape[1] for stretch in stretches]
        measured = [layout.measure(change(stretch), shaft) for stretch in stretches]
        band_powers[number] = np.average(measured, axis=0, weights=lengths)
    return band_powers
