"""The noise of measured windows, which a twin's windows are laid over."""

from dataclasses import dataclass
from typing import Literal, Protocol, runtime_checkable

import numpy as np
import scipy.signal
from jaxtyping import Bool, Float, Int

from swashtwin.foundation import InputError
from swashtwin.learning import WindowSet
from swashtwin.physics import Twin
from swashtwin.pump import is_healthy
from swashtwin.signals import inverse_transform, line_frequencies, transform
from swashtwin.synthesis.synchronous import MINIMUM_WINDOWS, remove_synchronous

Background = Literal["none", "spectrum", "residual", "healthy"]
"""What a twin's windows are laid over: nothing, noise of measured windows' spectrum, measured windows without their
synchronous part, or measured healthy windows, to which the fault's change is added."""


@runtime_checkable
class BackgroundNoise(Protocol):
    """Source of a window's noise."""

    def draw(self, rng: np.random.Generator) -> Float[np.ndarray, "channel time"]:
        """Noise of one window, in the unit of the measured ones."""
        ...


@dataclass(frozen=True, eq=False)
class _Spectrum:
    """Noise with the spectrum of a measured window between its piston-pass lines, in random phase."""

    like: WindowSet
    """Measured windows."""
    windows: Int[np.ndarray, " window"]
    """Indices of the windows that one is drawn from."""
    clear: Bool[np.ndarray, " frequency"]
    """Which lines of a window's spectrum are far from the piston-pass frequency's multiples."""

    def draw(self, rng: np.random.Generator) -> Float[np.ndarray, "channel time"]:
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


@dataclass(frozen=True, eq=False)
class _Residual:
    """Measured windows less what turns with the shaft, one of them at a time."""

    residual: Float[np.ndarray, "window channel time"]

    def draw(self, rng: np.random.Generator) -> Float[np.ndarray, "channel time"]:
        return self.residual[rng.integers(len(self.residual))]


def background_noise(like: WindowSet, twin: Twin, kind: Background, specimen: str | None = None) -> BackgroundNoise:
    """The noise of the measured windows of `like` nearest to the twin's pressure, normal ones where there are any.

    Parameters
    ----------
    kind : ``"spectrum"``: the amplitudes of a window between the piston-pass lines, in random phase; one window is
        enough. ``"residual"``: a window less the synchronous part of its recording, sample for sample as measured,
        shocks and what the channels have in common included; it takes four windows of a recording.
    specimen : machine whose windows alone are used, such as the one that the twin was calibrated on.

    Raises
    ------
    InputError
        `like` has no measured window of that specimen, or none of a recording with enough of them.
    """
    quiet = _quiet_windows(like, twin.condition.discharge_pressure, specimen)
    if kind == "residual":
        return _Residual(_residuals(like.subset(quiet), twin.condition.shaft_frequency))
    frequency = line_frequencies(like.length, like.sample_rate)
    pass_frequency = twin.pump.rotating_group.piston_count * twin.condition.shaft_frequency
    distance = np.abs(frequency / pass_frequency - np.round(frequency / pass_frequency)) * pass_frequency
    return _Spectrum(like, quiet, distance > 2.5 * frequency[1])


def _quiet_windows(like: WindowSet, pressure: float, specimen: str | None) -> np.ndarray:
    """Indices of measured normal windows (any class where there is none) at the pressure nearest to `pressure`."""
    candidates = ~like.synthetic
    if specimen is not None:
        candidates &= like.specimen == specimen
    is_normal = np.isin(like.label, [name for name in like.classes if is_healthy(name)])
    if np.any(candidates & is_normal):
        candidates &= is_normal
    if not candidates.any():
        of = "" if specimen is None else f" of {specimen}"
        raise InputError(f"no measured window{of} to take noise from; pass background='none'.")
    distance = np.abs(like.discharge_pressure - pressure)
    if np.isfinite(distance[candidates]).any():
        candidates &= distance <= np.nanmin(distance[candidates]) + 1e4
    return np.flatnonzero(candidates)


def _residuals(quiet: WindowSet, shaft_frequency: float) -> Float[np.ndarray, "window channel time"]:
    parts = []
    for name in np.unique(quiet.recording_id):
        windows = quiet.subset(quiet.recording_id == name)
        shaft = float(windows.speed[0]) / (2 * np.pi)
        period = quiet.sample_rate / (shaft if shaft > 0 else shaft_frequency)
        if len(windows) >= MINIMUM_WINDOWS and quiet.length >= 1.02 * period:
            parts.append(remove_synchronous(windows.signal.astype(float), period))
    if not parts:
        raise InputError(
            f"a residual takes {MINIMUM_WINDOWS} windows of one recording, each of more than a revolution; take longer "
            'windows or more of them, or background="spectrum".'
        )
    return np.concatenate(parts)
