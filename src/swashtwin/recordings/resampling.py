"""Recordings at another sample rate than their file has."""

from fractions import Fraction
from functools import partial
from math import ceil

import numpy as np

from swashtwin.foundation import DataError, parse, require_memory
from swashtwin.recordings.formats.raw import RATES
from swashtwin.recordings.samples import Columns, Samples, hash_channels


def resampled(samples: Samples, rate: float, wanted: str, where: str) -> tuple[Samples, float, str]:
    """Samples of another rate, that rate [Hz], and how they are made; the file is read when they are asked for.

    At the rate that they have it is the same samples and no words.

    Parameters
    ----------
    rate : sample rate of `samples` [Hz].
    wanted : the new one, such as ``"12 kHz"``.
    where : how messages call the file.
    """
    new = parse(wanted, "Hz", name=f"{where}: resample")
    if not RATES[0] <= new <= RATES[1]:
        raise DataError(f'{where}: resample = {wanted!r} is no rate of a measurement; write such as "12 kHz".')
    if new == rate:
        return samples, rate, ""
    ratio = Fraction(new / rate).limit_denominator(1000)
    if ratio == 0 or abs(float(ratio) * rate / new - 1) > 1e-9:
        raise DataError(f"{where}: {rate:g} Hz cannot be resampled to {new:g} Hz; choose a ratio of whole numbers.")
    count = ceil(samples.shape[1] * ratio)
    require_memory(
        samples.name, 8 * samples.shape[0] * (count + samples.shape[1]), reason=f"resampled to {new:g} Hz takes"
    )
    words = f"scipy.signal.resample_poly({ratio.numerator}, {ratio.denominator})"
    words = f"from {rate:.15g} Hz to {new:.15g} Hz by {words}"
    open_columns = partial(_resample_columns, samples.unopened(), rate, new, ratio)
    shape = (samples.shape[0], count)
    return Samples(samples.name, shape, np.dtype(np.float64), samples.has_speed, open_columns), new, words


def _resample_columns(samples: Samples, rate: float, new: float, ratio: Fraction) -> Columns:
    from scipy.signal import resample_poly

    count = samples.shape[1]
    signal, speed = samples.signal_part(0, count), samples.speed_part(0, count)
    hashes = hash_channels([signal])
    signal = resample_poly(signal, ratio.numerator, ratio.denominator, axis=1, padtype="line")
    if speed is not None:
        speed = np.interp(np.arange(signal.shape[1]) / new, np.arange(count) / rate, speed)
    return Columns(tuple(signal), (1.0,) * len(signal), speed, hashes)
