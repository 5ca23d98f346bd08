"""Measured windows shaken: noise, gain, speed, time and phase of the shaft a little other than measured."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline

from swashtwin.foundation import stream
from swashtwin.learning import WindowSet
from swashtwin.signals import add_noise
from swashtwin.synthesis.duplicates import drawn_sources
from swashtwin.synthesis.filler import filled_cell
from swashtwin.synthesis.periodic_extension import closed, read_ring, ring_length


@dataclass(frozen=True)
class Jitter:
    """Copies of measured windows, distorted as Um et al. 2017 (DOI 10.1145/3136755.3136817) distort sensor signals.

    Noise ("jittering"), gain ("scaling") and a smooth warp of time are theirs; speed and phase of the shaft are a
    machine's own. Zero switches one off. The widths are estimates of ours, no fault signature being stretched by more
    than speed itself stretches it.
    """

    snr_db: float = 40.0
    """Power of the window over that of the white noise, per channel [dB]; infinite for none."""
    gain: float = 0.1
    """Standard deviation of the logarithm of each channel's gain."""
    speed: float = 0.01
    """Half-width of the uniform spread of the speed, relative; the window's speed is changed with it."""
    warp: float = 0.002
    """Standard deviation of the local change of speed at each of four knots of a smooth course, relative."""
    phase: bool = True
    """Let each window begin at another angle of the shaft; it is read off the ring of a measured one (`closed`)."""

    def __call__(self, train: WindowSet, *, label: str, pressure: float, count: int, seed: int) -> WindowSet:
        """`count` windows of the cell, each a measured one distorted (`Filler`)."""
        drawn = drawn_sources(train, label, pressure, count, seed)
        rate = np.ones(count)
        signal = np.empty((count, train.n_channels, train.length))
        for i, source in enumerate(drawn.tolist()):
            rng = stream(seed, "jitter", label, i)
            rate[i] = 1 + self.speed * rng.uniform(-1, 1)
            course = self._course(rate[i], train.length, rng)
            ring = closed(train.signal[source], ring_length(train, source))
            window = read_ring(ring, course + (rng.uniform(0, ring.shape[-1]) if self.phase else 0.0))
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
