"""White noise in training, so that a network does not lean on what the first noise of a plant would fill."""

from dataclasses import replace

import numpy as np
from jaxtyping import Int

from swashtwin.windows import WindowSet

RANGE = 25.0
"""Width of the range of signal-to-noise ratios [dB], above the least one asked for."""


def disturbed(
    windows: WindowSet, noise_snr: float, rng: np.random.Generator
) -> tuple[Int[np.ndarray, " noisy"], WindowSet]:
    """(places of a random half of the windows, these with white Gaussian noise).

    Each has a ratio of its own, uniform in dB from `noise_snr` to 25 dB above it. The signal's power is the variance of
    the window per channel, not of the recording as in tests (docs/protocol.md, "Noise"): a synthetic window has no
    recording.

    Parameters
    ----------
    noise_snr : least signal-to-noise ratio [dB].
    rng : what choice, ratios and noise are drawn from.
    """
    which = np.flatnonzero(rng.random(len(windows)) < 0.5)
    chosen = windows.subset(which)
    ratio = noise_snr + RANGE * rng.random((len(which), 1, 1), dtype=np.float32)
    scale = np.sqrt(chosen.signal.var(axis=-1, keepdims=True) * 10 ** (-ratio / 10))
    noise = scale * rng.standard_normal(chosen.signal.shape, dtype=np.float32)
    return which, replace(chosen, signal=(chosen.signal + noise).astype(np.float32))
