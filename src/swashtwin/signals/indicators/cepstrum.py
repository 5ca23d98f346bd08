"""The real cepstrum: families of lines at one spacing, gathered into one peak."""

import numpy as np
import scipy
from jaxtyping import Float

from swashtwin.foundation import InputError
from swashtwin.signals.spectra import inverse_transform, power_density, tapered_transform

_PERIODS = 10
"""Periods of the spacing in each segment of the family index, at least: its lines then lie ten samples apart."""
_NEAR, _AROUND = 0.015, 0.05
"""How far from the expected quefrency a peak may lie, and how far about it nothing counts as background; relative."""


def real_cepstrum(
    signal: Float[np.ndarray, "channel time"], sample_rate: float
) -> tuple[Float[np.ndarray, " quefrency"], Float[np.ndarray, "channel quefrency"]]:
    """Quefrencies [s] and the inverse transform of the log magnitude of the spectrum, without unit.

    Mean removed, Hann taper; natural logarithm; as the inverse transform gives it, the half up to half the duration:
    an echo of strength a after τ reads a/2 at τ. Quefrency 0 (the level) is left at its place.
    """
    n_samples = signal.shape[-1]
    magnitude = np.abs(tapered_transform(signal))
    least = 1e-12 * np.maximum(magnitude.max(axis=-1, keepdims=True), 1e-300)
    cepstrum = inverse_transform(np.log(np.maximum(magnitude, least)), n_samples)
    half = n_samples // 2 + 1
    return np.arange(half) / sample_rate, cepstrum[:, :half]


def harmonic_family_index(
    signal: Float[np.ndarray, "channel time"], sample_rate: float, spacing: float
) -> Float[np.ndarray, " channel"]:
    """How far the cepstrum's peak at the quefrency 1 / `spacing` stands out, in deviations of what surrounds it.

    The cepstrum of the power averaged over half-overlapping segments of ten periods, or of the next longer length that
    is fast to transform, in which a family's lines fill the spectrum as far as they go; its highest value within 1.5 %
    of that quefrency, over 1.4826 times the median magnitude between half and one and a half times of it, the nearest
    5 % left out (our reading; the literature has no one definition). docs/how-to/indicators.md says what noise alone
    and families of lines reach.

    Parameters
    ----------
    spacing : distance of the family's lines [Hz], such as the shaft frequency.

    Raises
    ------
    InputError
        A spacing that is not positive, that fewer than three periods of fit into the signal, or above a twentieth of
        the sample rate.
    """
    duration = signal.shape[-1] / sample_rate
    if not 3 / duration < spacing < sample_rate / 20:
        raise InputError(
            f"lines {spacing:g} Hz apart are no family in {duration:.3g} s at {sample_rate:g} Hz; the spacing must lie "
            f"between {3 / duration:.3g} and {sample_rate / 20:g} Hz."
        )
    length = min(signal.shape[-1], scipy.fft.next_fast_len(round(_PERIODS / spacing * sample_rate), real=True))
    _, power = power_density(signal, sample_rate, length)
    least = 1e-24 * np.maximum(power.max(axis=-1, keepdims=True), 1e-300)
    cepstrum = inverse_transform(np.log(np.maximum(power, least)) / 2, length)[:, : length // 2 + 1]
    ratio = np.arange(cepstrum.shape[1]) / sample_rate * spacing
    near = np.abs(ratio - 1) <= max(_NEAR, 1.5 * spacing / sample_rate)
    around = (np.abs(ratio - 1) <= 0.5) & (np.abs(ratio - 1) > max(_AROUND, 3 * spacing / sample_rate))
    scale = 1.4826 * np.median(np.abs(cepstrum[:, around]), axis=-1)
    return cepstrum[:, near].max(axis=-1) / np.maximum(scale, 1e-300)
