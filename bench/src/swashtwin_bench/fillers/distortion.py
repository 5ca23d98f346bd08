"""Measured windows distorted: noise, gain, speed, time and phase of the shaft a little different."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline

from swashtwin.foundation import stream
from swashtwin.learning import WindowSet
from swashtwin.signals import add_noise
from swashtwin_bench.fillers.duplicates import draw_sources
from swashtwin_bench.fillers.filler import fill_cell
from swashtwin_bench.fillers.periodic_extension import close_period, extension_length, read_extension


@dataclass(frozen=True)
class Jitter:
    """Copies of measured windows, distorted as Um et al. 2017 (DOI 10.1145/3136755.3136817) distort sensor signals.

    Noise ("jittering"), gain ("scaling") and a smooth warp of time are theirs; speed and phase of the shaft are
    ours. Zero switches one off. The widths are estimates of ours, no fault signature being stretched by more
    than speed itself stretches it.
    """

    snr_db: float = 40.0
    """Power of the window over that of the white noise, per channel [dB]; infinite for none."""
    gain: float = 0.1
    """Standard deviation of the logarithm of each channel's gain."""
    speed: float = 0.01
    """Half-width of the uniform spread of the speed, relative; the window's speed is changed with it."""
    warp: float = 0.002
    """Standard deviation of the local change of speed at each of four knots of a smooth curve, relative."""
    phase: bool = True
    """Let each window begin at another angle of the shaft; read from the periodic extension of a measured one."""

    def __call__(self, train: WindowSet, *, label: str, pressure: float, count: int, seed: int) -> WindowSet:
        """`count` windows of the cell, each a measured one distorted (`Filler`)."""
        sources = draw_sources(train, label, pressure, count, seed)
        rate = np.ones(count)
        signal = np.empty((count, train.n_channels, train.length))
        for i, source in enumerate(sources.tolist()):
            rng = stream(seed, "jitter", label, i)
            rate[i] = 1 + self.speed * rng.uniform(-1, 1)
            position = self._positions(rate[i], train.length, rng)
            extension = close_period(train.signal[source], extension_length(train, source))
            window = read_extension(extension, position + (rng.uniform(0, extension.shape[-1]) if self.phase else 0.0))
            window = window * np.exp(rng.normal(0, self.gain, (train.n_channels, 1)))
            signal[i] = window if math.isinf(self.snr_db) else add_noise(window, self.snr_db, seed, "jitter", label, i)
        return fill_cell(
            signal,
            sources,
            train=train,
            name="jitter",
            label=label,
            pressure=pressure,
            seed=seed,
            speed=train.speed[sources] * rate,
        )

    def _positions(self, rate: float, length: int, rng: np.random.Generator) -> Float[np.ndarray, " time"]:
        """Position in the measured window [sample] of each sample of the new one."""
        time = np.arange(length, dtype=float)
        local = CubicSpline(np.linspace(0, length, 4), rng.normal(0, self.warp, 4))
        return rate * time + (local.antiderivative()(time) if self.warp else 0.0)
