"""Levels of a recording in bands of shaft orders."""

import math

import numpy as np
from jaxtyping import Float64

from swashtwin.foundation import DataError
from swashtwin.recordings import Recording, refuse_unfit, stated_speed
from swashtwin.signals import OrderBands, power_density

_TURNS = 8
"""Revolutions in each segment of a spectrum, so that eight spectral lines lie from order to order."""
_STRETCH = 1 << 18
"""Samples of a channel that are transformed together."""


def order_levels(recording: Recording, bands: OrderBands) -> Float64[np.ndarray, "channel band"]:
    """log10 of the power of each channel in each band, from power densities (Welch, Hann taper) of eight turns each.

    Raises
    ------
    DataError
        The recording is unfit, shorter than eight turns, states no speed, or its rate is too low for the bands.
    """
    refuse_unfit(recording)
    shaft, rate = shaft_frequency(recording), float(recording.sample_rate)
    if bands.highest * shaft > rate / 2:
        raise DataError(
            f"{recording.recording_id} is sampled at {rate:g} Hz; the prior's bands end at shaft order "
            f"{bands.highest:g}, which takes {2 * bands.highest * shaft:.0f} Hz at least."
        )
    import scipy.fft

    length = scipy.fft.next_fast_len(math.ceil(_TURNS * rate / shaft), real=True)
    if recording.n_samples < length:
        raise DataError(
            f"{recording.recording_id} lasts {recording.duration:.3g} s; a prior compares spectra of {_TURNS} "
            f"revolutions, which are {_TURNS / shaft:.3g} s: record longer."
        )
    step, parts, weights = max(length, _STRETCH), [], []
    for start in range(0, recording.n_samples - length + 1, step):
        signal = recording.slice(start, min(start + step, recording.n_samples)).signal
        frequency, density = power_density(signal, rate, length)
        parts.append(density)
        weights.append(signal.shape[1])
    power = np.average(parts, axis=0, weights=weights) * frequency[1]
    sums = bands.sums(power[:, 1:], frequency[1:] / shaft, frequency[1] / shaft / 2)
    return np.asarray(np.log10(np.maximum(sums, 1e-30)))


def shaft_frequency(recording: Recording) -> float:
    """Shaft frequency [Hz] that a recording states."""
    shaft = stated_speed(recording)
    if not shaft:
        raise DataError(
            f"{recording.recording_id} states no speed, and a prior compares shaft orders; state it in the index, or "
            "with --speed."
        )
    return shaft
