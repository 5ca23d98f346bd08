"""Recordings at another sample rate than their file has."""

from fractions import Fraction
from functools import partial
from math import ceil
from typing import NamedTuple

import numpy as np

from swashtwin.foundation import DataError, parse, require_memory
from swashtwin.recordings.entry import Entry
from swashtwin.recordings.formats.raw import RATES
from swashtwin.recordings.samples import Columns, Samples, hash_channels


class Resampling(NamedTuple):
    """From one sample rate to another."""

    old_rate: float
    """Sample rate of the file [Hz]."""
    rate: float
    """New sample rate [Hz]."""
    up: int
    down: int
    words: str
    """How it is done, for the recording's attributes."""


def resampling_of(entry: Entry, rate: float, where: str) -> Resampling | None:
    """How to reach the rate that an entry asks for; None where it asks for none or for the file's own."""
    if entry.resample is None:
        return None
    target = parse(entry.resample, "Hz", name=f"{where}: resample")
    if not RATES[0] <= target <= RATES[1]:
        raise DataError(f'{where}: resample = {entry.resample!r} is no rate of a measurement; write such as "12 kHz".')
    if target == rate:
        return None
    ratio = Fraction(target / rate).limit_denominator(1000) if target > 0 else Fraction(0)
    if ratio == 0 or abs(float(ratio) * rate / target - 1) > 1e-9:
        raise DataError(f"{where}: {rate:g} Hz cannot be resampled to {target:g} Hz; choose a ratio of whole numbers.")
    call = f"scipy.signal.resample_poly({ratio.numerator}, {ratio.denominator})"
    words = f"from {rate:.15g} Hz to {target:.15g} Hz by {call}"
    return Resampling(rate, target, ratio.numerator, ratio.denominator, words)


def resampled(samples: Samples, resampling: Resampling, name: str) -> Samples:
    """The samples at another rate; the whole file is read when they are first asked for."""
    count = ceil(samples.shape[1] * resampling.up / resampling.down)
    size = 8 * samples.shape[0] * (count + samples.shape[1])
    require_memory(name, size, reason=f"resampled to {resampling.rate:g} Hz takes")
    open_columns = partial(_resample_columns, samples.unopened(), resampling)
    return Samples(name, (samples.shape[0], count), np.dtype(np.float64), samples.has_speed, open_columns)


def _resample_columns(samples: Samples, resampling: Resampling) -> Columns:
    from scipy.signal import resample_poly

    count = samples.shape[1]
    signal, speed = samples.signal_part(0, count), samples.speed_part(0, count)
    hashes = hash_channels([signal])
    signal = resample_poly(signal, resampling.up, resampling.down, axis=1, padtype="line")
    if speed is not None:
        time, old_time = np.arange(signal.shape[1]) / resampling.rate, np.arange(count) / resampling.old_rate
        speed = np.interp(time, old_time, speed)
    return Columns(tuple(signal), (1.0,) * len(signal), speed, hashes)
