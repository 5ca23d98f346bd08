"""How far a simulated signal, or spectrum, is from a measured one."""

import numpy as np
import scipy
from jaxtyping import Float

from swashtwin.foundation import InputError


def aligned(
    measured: Float[np.ndarray, "channel time"], simulated: Float[np.ndarray, "channel longer"]
) -> Float[np.ndarray, "channel time"]:
    """Stretch of `simulated`, as long as `measured`, that correlates best with it over all channels together.

    With `simulated` one period longer than `measured`, every phase is tried.

    Raises
    ------
    InputError
        `simulated` is the shorter one.
    """
    length = measured.shape[-1]
    if simulated.shape[-1] < length:
        raise InputError(f"{simulated.shape[-1]} simulated samples are fewer than the {length} measured ones.")
    score = sum(scipy.signal.correlate(s, m, "valid") for s, m in zip(simulated, measured, strict=True))
    start = int(np.argmax(score))
    return simulated[:, start : start + length]


def waveform_rmse(measured: Float[np.ndarray, "channel time"], simulated: Float[np.ndarray, "channel time"]) -> float:
    """Root mean square of the difference, in the signals' unit (the paper's RMSE)."""
    return float(np.sqrt(np.mean((measured - simulated) ** 2)))


def peak_error(measured: Float[np.ndarray, "channel time"], simulated: Float[np.ndarray, "channel time"]) -> float:
    """Mean over channels of the difference of the largest magnitudes, relative to the measured (the paper's PE)."""
    peaks = np.abs(measured).max(axis=-1)
    return float(np.mean(np.abs(np.abs(simulated).max(axis=-1) - peaks) / peaks))


def spectrum_value_error(
    measured: Float[np.ndarray, "channel order"], simulated: Float[np.ndarray, "channel order"]
) -> float:
    """Sum of the amplitudes' differences over the sum of the measured amplitudes (the paper's SVE; our reading)."""
    return float(np.abs(measured - simulated).sum() / measured.sum())


LEVEL_RANGE = 60.0
"""Lines further [dB] below the strongest measured one count as if they were so far below it: there is only noise."""


def spectral_correlation(
    measured: Float[np.ndarray, "channel order"], simulated: Float[np.ndarray, "channel order"]
) -> float:
    """Pearson's correlation of the levels in dB, over all channels and orders; 1 is a spectrum of the same shape.

    A level is 20 log10 of the amplitude, no lower than 60 dB below the strongest measured line (`LEVEL_RANGE`), the
    same floor for both sides. A common gain does not change it. It is 0 where the levels of one side are all equal.

    Examples
    --------
    >>> measured = np.array([[1.0, 0.1, 0.5]])
    >>> round(spectral_correlation(measured, 2 * measured), 3)
    1.0
    """
    floor = max(float(measured.max()) * 10 ** (-LEVEL_RANGE / 20), 1e-300)
    first, second = (20 * np.log10(np.maximum(side, floor)).ravel() for side in (measured, simulated))
    first, second = first - first.mean(), second - second.mean()
    width = float(np.linalg.norm(first) * np.linalg.norm(second))
    return float(first @ second) / width if width > 0 else 0.0
