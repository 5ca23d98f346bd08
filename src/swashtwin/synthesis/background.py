"""The noise of measured windows, which a twin's windows are laid over."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy.signal
from jaxtyping import Bool, Float, Int

from swashtwin.foundation import InputError
from swashtwin.learning import WindowSet
from swashtwin.physics import Twin
from swashtwin.pump import is_healthy
from swashtwin.signals import inverse_transform, line_frequencies, transform

Background = Literal["none", "spectrum"]
"""What a twin's windows are laid over: nothing, or noise of measured windows' spectrum."""


@dataclass(frozen=True, eq=False)
class BackgroundNoise:
    """Noise with the spectrum of a measured window between its piston-pass lines, in random phase."""

    like: WindowSet
    """Measured windows."""
    windows: Int[np.ndarray, " window"]
    """Indices of the windows that one is drawn from."""
    clear: Bool[np.ndarray, " frequency"]
    """Which lines of a window's spectrum are far from the piston-pass frequency's multiples."""

    def draw(self, rng: np.random.Generator) -> Float[np.ndarray, "channel time"]:
        """Noise of one window, in the unit of the measured ones."""
        window = self.like.signal[rng.choice(self.windows)].astype(float)
        # Untapered, strong lines leak over all others. `hann_taper` differs in the last bit, and the noise with it.
        taper = scipy.signal.get_window("hann", self.like.length)
        tapered = (window - window.mean(axis=1, keepdims=True)) * taper / np.sqrt(np.mean(taper**2))
        spectrum = np.abs(transform(tapered))
        line, clear = np.arange(self.clear.size), self.clear
        for row in spectrum:
            row[~clear] = np.interp(line[~clear], line[clear], row[clear])
        phase = np.exp(2j * np.pi * rng.random(spectrum.shape))
        return inverse_transform(spectrum * phase, self.like.length)


def background_noise(like: WindowSet, twin: Twin) -> BackgroundNoise:
    """The noise of the measured windows of `like` nearest to the twin's pressure, normal ones where there are any.

    Raises
    ------
    InputError
        `like` has no measured window.
    """
    candidates = ~like.synthetic
    is_normal = np.isin(like.label, [name for name in like.classes if is_healthy(name)])
    if np.any(candidates & is_normal):
        candidates &= is_normal
    if not candidates.any():
        raise InputError("no measured window to take noise from; the background can be 'none'.", field="background")
    distance = np.abs(like.discharge_pressure - twin.condition.discharge_pressure)
    if np.isfinite(distance[candidates]).any():
        candidates &= distance <= np.nanmin(distance[candidates]) + 1e4
    frequency = line_frequencies(like.length, like.sample_rate)
    pass_frequency = twin.pump.rotating_group.piston_count * twin.condition.shaft_frequency
    away = np.abs(frequency / pass_frequency - np.round(frequency / pass_frequency)) * pass_frequency
    return BackgroundNoise(like, np.flatnonzero(candidates), away > 2.5 * frequency[1])
