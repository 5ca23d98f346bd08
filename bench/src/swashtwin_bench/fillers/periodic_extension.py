"""Windows as periodic signals of whole revolutions, without a step."""

import math

import numpy as np
from jaxtyping import Float, Int
from scipy.signal import resample

from swashtwin.learning import WindowSet

_SEAM = 0.05
"""Least share of a window that is used for the seam of its extension."""
_LONGEST_SEAM = 0.2
"""Greatest share of an extension that the seam takes."""


def extension_length(windows: WindowSet, index: int) -> int:
    """Samples in a period of a window's extension: the whole revolutions that leave 5 % of the window for the seam.

    It is 90 % of the window where no speed is known or the window is shorter than a revolution: the seam then joins
    parts that do not follow each other, still without a step.
    """
    speed = float(windows.speed[index])
    period = 2 * math.pi / speed * windows.sample_rate if speed > 0 else math.inf
    turns = math.floor((1 - _SEAM) * windows.length / period)
    return round(turns * period) if turns else round(0.9 * windows.length)


def close_period(window: Float[np.ndarray, "channel time"], length: int) -> Float[np.ndarray, "channel angle"]:
    """The first `length` samples of a window, their beginning blended with the samples that follow their end.

    The samples beyond `length` belong to the same angles of the shaft as the first ones, which they fade into: the
    period repeats without a step.
    """
    extension = window[..., :length].astype(float)
    seam = min(window.shape[-1] - length, int(_LONGEST_SEAM * length))
    fading = (1 + np.cos(np.pi * np.arange(seam) / seam)) / 2
    extension[..., :seam] += fading * (window[..., length : length + seam] - extension[..., :seam])
    return extension


def periodic_extensions(
    windows: WindowSet, indices: Int[np.ndarray, " index"], length: int
) -> Float[np.ndarray, "index channel angle"]:
    """Periodic extensions of the windows at `indices`, each resampled to `length` samples."""
    extensions = [(close_period(windows.signal[i], extension_length(windows, int(i)))) for i in indices]
    return np.stack(
        [
            extension if extension.shape[-1] == length else resample(extension, length, axis=-1)
            for extension in extensions
        ]
    )


def cut_extensions(
    extensions: Float[np.ndarray, "window channel angle"],
    like: WindowSet,
    sources: Int[np.ndarray, " window"],
    rng: np.random.Generator,
) -> Float[np.ndarray, "window channel time"]:
    """One window of each periodic extension, from a random angle.

    Parameters
    ----------
    like : windows whose length is taken.
    sources : index of the window that each extension is of, whose speed it has.
    """
    signal = np.empty((len(extensions), like.n_channels, like.length))
    for i, source in enumerate(sources.tolist()):
        length = extension_length(like, source)
        extension = extensions[i] if extensions.shape[-1] == length else resample(extensions[i], length, axis=-1)
        signal[i] = extension[..., (rng.integers(length) + np.arange(like.length)) % length]
    return signal
