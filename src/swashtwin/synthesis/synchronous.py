"""Measured windows without the part that turns with the shaft, found without a tachometer."""

import numpy as np
from jaxtyping import Float
from scipy.ndimage import map_coordinates

from swashtwin.signals import inverse_transform, transform

MINIMUM_WINDOWS = 4
"""Windows of one recording below which their average says little of their common part."""
_PASSES = 4
"""Number of times that the windows are aligned with their average."""
_RATES = 1 + np.linspace(-0.01, 0.01, 41)
"""Speeds of a window over the recording's that are tried; 41 over 1 % leave order 200 within a third of a radian."""


def remove_synchronous(
    windows: Float[np.ndarray, "window channel time"], period: float
) -> Float[np.ndarray, "window channel time"]:
    """The windows of one recording less the part that repeats with each revolution.

    Each window is aligned with the average over one revolution, at the shift and the speed at which it fits best (Woody
    1967, DOI 10.1007/BF02474247), then the average is computed again, several times. The residual is scaled by
    sqrt(n / (n - 1)), because the average of n windows holds a share of each window's noise.

    Parameters
    ----------
    period : samples per revolution at the stated speed; the windows are a little longer.
    """
    grid = int(period)
    turns = np.stack([_one_turn(windows, period, rate, grid) for rate in _RATES], axis=1)
    average = turns[0, len(_RATES) // 2]
    for _ in range(_PASSES):
        alignments = [_fit(turn, average) for turn in turns]
        average = np.mean(
            [np.roll(turn[i], shift, axis=-1) for turn, (i, shift) in zip(turns, alignments, strict=True)], axis=0
        )
    residual = np.empty_like(windows)
    for index, (i, shift) in enumerate(alignments):
        angle = (np.arange(windows.shape[-1]) * _RATES[i] / period * grid + shift) % grid
        periodic = np.concatenate([average, average[:, :1]], axis=-1)
        turning = np.stack([map_coordinates(row, angle[None], order=3, mode="nearest") for row in periodic])
        residual[index] = windows[index] - turning
    return residual * np.sqrt(len(windows) / (len(windows) - 1))


def _one_turn(windows: np.ndarray, period: float, rate: float, grid: int) -> np.ndarray:
    """The first revolution of each window on `grid` angles, if the shaft turns `rate` times as fast as stated."""
    position = np.arange(grid) / grid * period / rate
    flat = windows.reshape(-1, windows.shape[-1])
    turn = np.stack([map_coordinates(row, position[None], order=3, mode="nearest") for row in flat])
    return turn.reshape(*windows.shape[:-1], grid)


def _fit(
    turns: Float[np.ndarray, "rate channel angle"], average: Float[np.ndarray, "channel angle"]
) -> tuple[int, int]:
    """(number of the rate, shift [angle]) at which a window's revolution is most like the average."""
    spectrum = transform(turns).conj() * transform(average)
    correlation = inverse_transform(spectrum.sum(axis=1), average.shape[-1])
    rate, shift = np.unravel_index(int(correlation.argmax()), correlation.shape)
    return int(rate), int(shift)
