"""The noise of measured windows, which a twin's windows are laid over."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from swashtwin.errors import InputError
from swashtwin.twin import Twin
from swashtwin.windows import WindowSet


@dataclass(frozen=True, eq=False)
class BackgroundNoise:
    """Noise with the spectrum of a measured window between its piston-pass lines, in random phase."""

    windows: Int[np.ndarray, " window"]
    """Among which of the measured windows one is drawn."""
    clear: Bool[np.ndarray, " frequency"]
    """Which lines of a window's spectrum are far from the piston-pass frequency's multiples."""

    def drawn(self, like: WindowSet, rng: np.random.Generator) -> Float[np.ndarray, "channel time"]:
        """Noise of one window, in the unit of `like`."""
        window = like.signal[rng.choice(self.windows)].astype(float)
        spectrum = np.abs(np.fft.rfft(window - window.mean(axis=1, keepdims=True), axis=-1))
        line, clear = np.arange(self.clear.size), self.clear
        for row in spectrum:
            row[~clear] = np.interp(line[~clear], line[clear], row[clear])
        phase = np.exp(2j * np.pi * rng.random(spectrum.shape))
        return np.fft.irfft(spectrum * phase, like.length, axis=-1)


def background_noise(like: WindowSet, twin: Twin) -> BackgroundNoise:
    """The noise of the measured windows of `like` nearest to the twin's pressure, normal ones where there are any.

    Raises
    ------
    InputError
        `like` has no measured window.
    """
    frequency = np.fft.rfftfreq(like.length, 1 / like.sample_rate)
    pass_frequency = twin.pump.rotating_group.piston_count * twin.condition.shaft_frequency
    distance = np.abs(frequency / pass_frequency - np.round(frequency / pass_frequency)) * pass_frequency
    return BackgroundNoise(_quiet_windows(like, twin.condition.discharge_pressure), distance > 2.5 * frequency[1])


def _quiet_windows(like: WindowSet, pressure: float) -> np.ndarray:
    """Indices of measured normal windows (any class where there is none) at the pressure nearest to `pressure`."""
    candidates = ~like.synthetic
    if "normal" in like.classes and np.any(candidates & (like.label == "normal")):
        candidates &= like.label == "normal"
    if not candidates.any():
        raise InputError("no measured window to take noise from; pass background=False.")
    distance = np.abs(like.discharge_pressure - pressure)
    if np.isfinite(distance[candidates]).any():
        candidates &= distance <= np.nanmin(distance[candidates]) + 1e4
    return np.flatnonzero(candidates)
