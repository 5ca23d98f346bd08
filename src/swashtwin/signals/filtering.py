"""Noise added to a signal, and the part of it within a band."""

import numpy as np
import scipy
from jaxtyping import Float

from swashtwin.foundation import InputError, stream


def add_noise(
    signal: Float[np.ndarray, "channel time"], snr_db: float, seed: int, *purpose: object
) -> Float[np.ndarray, "channel time"]:
    """Signal with white Gaussian noise of a stated signal-to-noise ratio [dB] added.

    The signal's power is its variance over the whole of `signal`, per channel (docs/protocol.md, "Noise").

    Parameters
    ----------
    purpose : names the random stream, usually the recording's id and the repeat.
    """
    power = signal.var(axis=-1, keepdims=True)
    scale = np.sqrt(power * 10 ** (-snr_db / 10))
    return signal + scale * stream(seed, "noise", float(snr_db), *purpose).standard_normal(signal.shape)


def band_limited(
    signal: Float[np.ndarray, "channel time"], sample_rate: float, low: float, high: float
) -> Float[np.ndarray, "channel time"]:
    """Signal between `low` and `high` [Hz], zero-phase Butterworth of order 4 in each direction.

    Raises
    ------
    InputError
        No band: `low` must be positive, below `high`, and below half the sample rate.
    """
    nyquist = sample_rate / 2
    if not 0 < low < min(high, nyquist):
        raise InputError(f"a band of {low:g}...{high:g} Hz is none at {sample_rate:g} Hz; it needs 0 < low < high.")
    if high >= 0.98 * nyquist:
        sos = scipy.signal.butter(4, low / nyquist, "highpass", output="sos")
    else:
        sos = scipy.signal.butter(4, [low / nyquist, high / nyquist], "bandpass", output="sos")
    return scipy.signal.sosfiltfilt(sos, signal, axis=-1)
