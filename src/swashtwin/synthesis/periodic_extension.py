"""Windows closed to a ring of whole revolutions, which has no beginning and no step."""

import math

import numpy as np
from jaxtyping import Float, Int
from scipy.ndimage import map_coordinates
from scipy.signal import resample

from swashtwin.learning import WindowSet

_SEAM = 0.05
"""Share of a window that is kept for the seam of its ring, at least."""
_LONGEST_SEAM = 0.2
"""Share of a ring that the seam takes at most."""


def ring_length(windows: WindowSet, index: int) -> int:
    """Readings of the ring of a window: as many whole revolutions as leave 5 % of the window for the seam.

    Where no speed is known, or the window does not hold a revolution, 90 % of the window: its seam joins what does not
    follow on each other, without a step.
    """
    speed = float(windows.speed[index])
    period = 2 * math.pi / speed * windows.sample_rate if speed > 0 else math.inf
    turns = math.floor((1 - _SEAM) * windows.length / period)
    return round(turns * period) if turns else round(0.9 * windows.length)


def closed(window: Float[np.ndarray, "channel time"], length: int) -> Float[np.ndarray, "channel angle"]:
    """The first `length` readings of a window, their beginning blended with what follows on their end.

    The readings beyond `length` stand for the same angles of the shaft as the first ones, which they fade into; read
    around and around, the ring has no step.
    """
    ring = window[..., :length].astype(float)
    seam = min(window.shape[-1] - length, int(_LONGEST_SEAM * length))
    fading = (1 + np.cos(np.pi * np.arange(seam) / seam)) / 2
    ring[..., :seam] += fading * (window[..., length : length + seam] - ring[..., :seam])
    return ring


def read_ring(
    ring: Float[np.ndarray, "channel angle"], place: Float[np.ndarray, " time"] | Int[np.ndarray, " time"]
) -> Float[np.ndarray, "channel time"]:
    """Readings of the ring at `place` [reading], around and around; between readings by splines of degree 5."""
    if np.issubdtype(place.dtype, np.integer):
        return ring[..., place % ring.shape[-1]]
    return np.stack([map_coordinates(row, place[None], order=5, mode="grid-wrap") for row in ring])


def rings_of(
    windows: WindowSet, chosen: Int[np.ndarray, " chosen"], length: int
) -> Float[np.ndarray, "chosen channel angle"]:
    """Rings of the windows `chosen`, each brought to `length` readings."""
    rings = [(closed(windows.signal[i], ring_length(windows, int(i)))) for i in chosen]
    return np.stack([one if one.shape[-1] == length else resample(one, length, axis=-1) for one in rings])


def windows_of(
    rings: Float[np.ndarray, "window channel angle"],
    like: WindowSet,
    sources: Int[np.ndarray, " window"],
    rng: np.random.Generator,
) -> Float[np.ndarray, "window channel time"]:
    """A window read off each ring from an angle drawn anew.

    Parameters
    ----------
    like : windows whose length is taken.
    sources : which of them each ring came from, and turns as fast as.
    """
    made = np.empty((len(rings), like.n_channels, like.length))
    for i, source in enumerate(sources.tolist()):
        own = ring_length(like, source)
        ring = rings[i] if rings.shape[-1] == own else resample(rings[i], own, axis=-1)
        made[i] = read_ring(ring, rng.integers(own) + np.arange(like.length))
    return made
