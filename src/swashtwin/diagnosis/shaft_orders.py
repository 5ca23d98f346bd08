"""Levels of a recording at shaft orders."""

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
_SPEED_REACH = 0.012
"""How far the speed may be from what a recording states, relative."""
_LEAST_PASSES = 12
"""Piston passes that a sample rate must allow."""


def order_levels(recording: Recording, bands: OrderBands) -> Float64[np.ndarray, "channel level"]:
    """Levels of each channel (`OrderBands.levels`), from power densities (Welch, Hann taper) of eight turns each.

    Lines of piston passes say the speed better than what was stated; orders are those of the speed that they say.
    Levels of bands beyond half the sample rate are NaN.

    Raises
    ------
    DataError
        The recording is unfit, shorter than eight turns, states no speed, or its rate is too low for the first bands.
    """
    refuse_unfit(recording)
    shaft, rate = shaft_frequency(recording), float(recording.sample_rate)
    lowest = _LEAST_PASSES * bands.piston_count * shaft
    if lowest > rate / 2:
        raise DataError(
            f"{recording.recording_id} is sampled at {rate:g} Hz; a prior looks at {_LEAST_PASSES} piston passes at "
            f"least, which take {2 * lowest:.0f} Hz."
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
    width = frequency[1] / shaft
    return bands.levels(power, width / _speed_ratio(power, width, bands))


def _speed_ratio(power: Float64[np.ndarray, "channel cell"], width: float, bands: OrderBands) -> float:
    """Speed over the stated one at which the piston passes stand out most."""
    ratios = 1 + np.linspace(-_SPEED_REACH, _SPEED_REACH, 97)
    passes = np.arange(1, bands.passes + 1) * bands.piston_count
    level = np.log10(np.maximum(power, 1e-30)).mean(axis=0)
    cells = ratios[:, None] * passes / width
    return float(ratios[np.interp(cells, np.arange(level.size), level).mean(axis=1).argmax()])


def shaft_frequency(recording: Recording) -> float:
    """Shaft frequency [Hz] that a recording states."""
    shaft = stated_speed(recording)
    if not shaft:
        raise DataError(
            f"{recording.recording_id} states no speed, and a prior compares shaft orders; state it in the index, or "
            "with --speed."
        )
    return shaft
