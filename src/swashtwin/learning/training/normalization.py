"""Scaling of windows before a network sees them."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Float64

from swashtwin.foundation import InputError
from swashtwin.learning.training.settings import NORMALIZATIONS
from swashtwin.learning.windows.window_set import WindowSet


@dataclass(frozen=True, eq=False)
class Normalization:
    """Subtracts a mean from each channel and divides by a deviation, taken over what `kind` says.

    ``"window"``: over each window by itself. ``"set"``: over the training windows, kept here. ``"none"``: not at all. A
    channel that does not move is not divided.
    """

    kind: str
    """``"window"``, ``"set"`` or ``"none"``."""
    mean: Float64[np.ndarray, " channel"]
    """Subtracted from each channel if `kind` is ``"set"``, in the windows' unit; else zeros."""
    deviation: Float64[np.ndarray, " channel"]
    """Each channel is divided by it if `kind` is ``"set"``, in the windows' unit; else ones."""

    def __post_init__(self) -> None:
        if self.kind not in NORMALIZATIONS:
            raise InputError(f"normalization {self.kind[:60]!r} is none of {', '.join(NORMALIZATIONS)}.")
        if not (self.deviation > 0).all():
            raise InputError("the deviation of a normalization must be positive.")

    @classmethod
    def fit(cls, kind: str, windows: WindowSet) -> "Normalization":
        """Normalization with the statistics of the training windows."""
        if kind == "set":
            signal = windows.signal
            mean = signal.mean(axis=(0, 2), dtype=np.float64)
            return cls(kind, mean, _not_zero(signal.std(axis=(0, 2), dtype=np.float64)))
        return cls(kind, np.zeros(windows.n_channels), np.ones(windows.n_channels))

    def apply(self, windows: WindowSet) -> Float32[np.ndarray, "window channel time"]:
        """The samples of `windows`, scaled."""
        if self.kind == "window":
            mean = windows.signal.mean(axis=2, dtype=np.float64)
            deviation = windows.signal.std(axis=2, dtype=np.float64)
        elif self.kind == "set":
            mean, deviation = self.mean[None], self.deviation[None]
        else:
            return windows.signal
        scaled = (windows.signal - mean[:, :, None]) / _not_zero(deviation)[:, :, None]
        return scaled.astype(np.float32)


def _not_zero(deviation: Float64[np.ndarray, "*axes"]) -> Float64[np.ndarray, "*axes"]:
    return np.where(deviation > 0, deviation, 1.0)
