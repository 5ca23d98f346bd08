"""Measured windows shaken: noise, gain, speed, time and phase of the shaft a little other than measured."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline
from scipy.ndimage import map_coordinates

from swashtwin.augmentation.duplicates import drawn_sources
from swashtwin.augmentation.filler import filled_cell
from swashtwin.seeding import stream
from swashtwin.signals import add_noise
from swashtwin.windows import WindowSet


@dataclass(frozen=True)
class Jitter:
    """Copies of measured windows, distorted as Um et al. 2017 (DOI 10.1145/3136755.3136817) distort sensor signals.

    Noise ("jittering"), gain ("scaling") and a smooth warp of time are theirs; speed and phase of the shaft are a
    machine's own. Zero switches one off. The widths are estimates of ours, no fault signature being stretched by more
    than speed itself stretches it.
    """

    snr_db: float = 26.0
    """Power of the window over that of the white noise, per channel [dB]; infinite for none."""
    gain: float = 0.1
    """Standard deviation of the logarithm of each channel's gain."""
    speed: float = 0.01
    """Half-width of the uniform spread of the speed, relative; the window's speed is changed with it."""
    warp: float = 0.002
    """Standard deviation of the local change of speed at each of four knots of a smooth course, relative."""
    phase: bool = True
    """Let each window begin at another angle of the shaft (`rotated`)."""

    def __call__(self, train: WindowSet, *, label: str, pressure: float, count: int, seed: int) -> WindowSet:
        """`count` windows of the cell, each a measured one distorted (`Filler`)."""
        drawn = drawn_sources(train, label, pressure, count, seed)
        rate = np.ones(count)
        signal = np.empty((count, train.n_channels, train.length))
        for i, source in enumerate(drawn.tolist()):
            rng = stream(seed, "jitter", label, i)
            rate[i] = 1 + self.speed * rng.uniform(-1, 1)
            window, period = train.signal[source].astype(float), _period(train, source)
            start = rng.uniform(0, period) if self.phase else 0.0
            window = _read_at(window, _wrapped(start + self._course(rate[i], train.length, rng), train.length, period))
            window = window * np.exp(rng.normal(0, self.gain, (train.n_channels, 1)))
            signal[i] = window if math.isinf(self.snr_db) else add_noise(window, self.snr_db, seed, "jitter", label, i)
        return filled_cell(
            signal,
            drawn,
            train=train,
            name="jitter",
            label=label,
            pressure=pressure,
            seed=seed,
            speed=train.speed[drawn] * rate,
        )

    def _course(self, rate: float, length: int, rng: np.random.Generator) -> Float[np.ndarray, " time"]:
        """Which reading [1] of the measured window each reading of the new one is."""
        time = np.arange(length, dtype=float)
        local = CubicSpline(np.linspace(0, length, 4), rng.normal(0, self.warp, 4))
        return rate * time + (local.antiderivative()(time) if self.warp else 0.0)


def rotated(
    window: Float[np.ndarray, "channel time"], start: float, period: float
) -> Float[np.ndarray, "channel time"]:
    """The window as if it had begun `start` readings later.

    What runs out at the end is taken whole revolutions earlier, where a machine that turns steadily did the same; where
    the window is shorter than a revolution it is closed to a ring, which leaves a step.

    Parameters
    ----------
    start : [reading].
    period : of the shaft [reading].
    """
    length = window.shape[-1]
    return _read_at(window, _wrapped(start + np.arange(length, dtype=float), length, period))


def _period(windows: WindowSet, index: int) -> float:
    """Readings per revolution; the window's length where no speed is known or it does not hold a revolution."""
    speed = float(windows.speed[index])
    period = 2 * math.pi / speed * windows.sample_rate if speed > 0 else math.inf
    return min(period, float(windows.length))


def _wrapped(place: np.ndarray, length: int, period: float) -> np.ndarray:
    beyond = np.maximum(np.ceil((place - (length - 1)) / period), 0)
    return place - beyond * period


def _read_at(window: np.ndarray, place: np.ndarray) -> np.ndarray:
    return np.stack([map_coordinates(row, place[None], order=5, mode="nearest") for row in window])
