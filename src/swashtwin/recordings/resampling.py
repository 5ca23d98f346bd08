"""Samples at another rate, computed when they are read."""

from fractions import Fraction
from functools import partial
from math import ceil
from typing import NamedTuple

import numpy as np

from swashtwin.foundation import DataError, parse_quantity, require_memory
from swashtwin.recordings.content_hashes import hash_channels
from swashtwin.recordings.formats.raw_file import SAMPLE_RATE_RANGE_HZ
from swashtwin.recordings.samples import Columns, Samples

# Largest denominator of the ratio of rates: the filter of `resample_poly` grows with it.
_MAX_DENOMINATOR = 1000

# Relative error of the ratio: rounding of the rates.
_RATE_TOLERANCE = 1e-9


class Resampled(NamedTuple):
    """Samples of another rate."""

    samples: Samples
    sample_rate: float
    """Sample rate [Hz]."""
    description: str
    """How they are computed; empty if the rate is that of the file."""


def resample(samples: Samples, rate: float, requested_rate: str, source_name: str) -> Resampled:
    """Return samples at another rate; the file is read when they are.

    Parameters
    ----------
    rate : sample rate of `samples` [Hz].
    requested_rate : the new rate, such as ``"12 kHz"``.
    source_name : name of the file in messages.

    Raises
    ------
    DataError
        The rate is not that of a measurement, or not in a ratio of whole numbers to `rate`.
    """
    new_rate = parse_quantity(requested_rate, "Hz", name=f"{source_name}: resample")
    lowest, highest = SAMPLE_RATE_RANGE_HZ
    if not lowest <= new_rate <= highest:
        raise DataError(
            f"{source_name}: resample ({requested_rate}) is not a rate of a measurement.",
            field="resample",
            remedy="Use a rate such as {resample='12 kHz'}.",
        )
    if new_rate == rate:
        return Resampled(samples, rate, "")

    ratio = Fraction(new_rate / rate).limit_denominator(_MAX_DENOMINATOR)
    if ratio == 0 or abs(float(ratio) * rate / new_rate - 1) > _RATE_TOLERANCE:
        raise DataError(
            f"{source_name}: {rate:g} Hz cannot be resampled to {new_rate:g} Hz; "
            "choose a ratio of whole numbers.",
            field="resample",
        )

    n_channels, old_count = samples.shape
    count = ceil(old_count * ratio)
    require_memory(
        samples.name,
        8 * n_channels * (count + old_count),
        reason=f"resampled to {new_rate:g} Hz takes",
    )
    resampled = Samples(
        samples.name,
        (n_channels, count),
        np.dtype(np.float64),
        samples.has_speed,
        partial(_resample_columns, samples.unopened(), rate, new_rate, ratio),
        file=samples.file,
    )
    description = (
        f"from {rate:.15g} Hz to {new_rate:.15g} Hz by "
        f"scipy.signal.resample_poly({ratio.numerator}, {ratio.denominator})"
    )
    return Resampled(resampled, new_rate, description)


def _resample_columns(samples: Samples, rate: float, new_rate: float, ratio: Fraction) -> Columns:
    from scipy.signal import resample_poly

    count = samples.shape[1]
    original = samples.signal_part(0, count)
    speed = samples.speed_part(0, count)
    signal = resample_poly(original, ratio.numerator, ratio.denominator, axis=1, padtype="line")
    if speed is not None:
        new_time = np.arange(signal.shape[1]) / new_rate
        speed = np.interp(new_time, np.arange(count) / rate, speed)

    return Columns(
        channels=tuple(signal),
        factors=(1.0,) * len(signal),
        speed=speed,
        hashes=hash_channels([original]),
    )
