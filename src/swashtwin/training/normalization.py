"""Scaling of windows before a network sees them."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Float64

from swashtwin.windows import WindowSet


@dataclass(frozen=True, eq=False)
class Normalization:
    """Subtracts a mean from each channel and divides by a deviation, taken over what `kind` says.

    ``"window"``: over each window by itself. ``"recording"``: over all the windows given of its recording. ``"set"``:
    over the training windows, kept here. ``"none"``: not at all. A channel that does not move is not divided.
    """

    kind: str
    """``"window"``, ``"recording"``, ``"set"`` or ``"none"``."""
    mean: Float64[np.ndarray, " channel"]
    """Subtracted from each channel if `kind` is ``"set"``, in the windows' unit; else zeros."""
    deviation: Float64[np.ndarray, " channel"]
    """Each channel is divided by it if `kind` is ``"set"``, in the windows' unit; else ones."""

    @classmethod
    def fitted(cls, kind: str, windows: WindowSet) -> "Normalization":
        """Normalization with the statistics of the training windows."""
        if kind == "set":
            signal = windows.signal
            mean = signal.mean(axis=(0, 2), dtype=np.float64)
            return cls(kind, mean, _not_zero(signal.std(axis=(0, 2), dtype=np.float64)))
        return cls(kind, np.zeros(windows.n_channels), np.ones(windows.n_channels))

    def applied(self, windows: WindowSet) -> Float32[np.ndarray, "window channel time"]:
        """The readings of `windows`, scaled."""
        if self.kind == "window":
            mean = windows.signal.mean(axis=2, dtype=np.float64)
            deviation = windows.signal.std(axis=2, dtype=np.float64)
        elif self.kind == "recording":
            mean, deviation = _of_recordings(windows)
        elif self.kind == "set":
            mean, deviation = self.mean[None], self.deviation[None]
        else:
            return windows.signal
        scaled = (windows.signal - mean[:, :, None]) / _not_zero(deviation)[:, :, None]
        return scaled.astype(np.float32)


def _of_recordings(
    windows: WindowSet,
) -> tuple[Float64[np.ndarray, "window channel"], Float64[np.ndarray, "window channel"]]:
    mean = np.empty((len(windows), windows.n_channels))
    deviation = np.empty_like(mean)
    for name in np.unique(windows.recording_id):
        own = windows.recording_id == name
        mean[own] = windows.signal[own].mean(axis=(0, 2), dtype=np.float64)
        deviation[own] = windows.signal[own].std(axis=(0, 2), dtype=np.float64)
    return mean, deviation


def _not_zero(deviation: Float64[np.ndarray, "*axes"]) -> Float64[np.ndarray, "*axes"]:
    return np.where(deviation > 0, deviation, 1.0)
