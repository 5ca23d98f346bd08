"""Whether the stated speed and sample rate can be true."""

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from jaxtyping import Float

from swashtwin.recordings.checks.channels import ChannelStatistics
from swashtwin.recordings.checks.findings import Finding
from swashtwin.recordings.grouping import stated_speed
from swashtwin.recordings.recording import Recording

_HARMONICS = 10
_LINE_RATIO = 6.0
"""Amplitude of a line over the median around it (16 dB)."""
_SPEED_SEARCH, _SPEED_TOLERANCE = 0.09, 0.02
"""How far from the stated speed another is looked for (no further: the neighbors of a nine-piston line lie 1/9 away),
and how far off it may be."""
_USUAL_RATES = (200.0, 250e3)
"""Sample rates of accelerometers [Hz]; they lie less than a factor of 1250 apart, so that kHz taken for Hz shows."""
_LEAST_TURNS = 50
"""Revolutions from which lines are looked for."""
_LONGEST = 1 << 20
"""Samples in which they are looked for, where they hold so many revolutions."""
_LEAST_PER_TURN = 4.0
"""Samples in a turn below which not even the shaft's own line can be in a signal with room to spare."""


def contradicted_speed(recording: Recording, statistics: Sequence[ChannelStatistics]) -> list[Finding]:
    """A warning where a clear family of shaft lines stands beside the stated speed and none at it.

    A long recording is judged by its first 2^20 samples, or by more where these hold less than 60 turns.
    """
    shaft, rate = stated_speed(recording), recording.sample_rate
    if not shaft or recording.duration * shaft < _LEAST_TURNS or rate < 4 * _HARMONICS * shaft:
        return []
    count = max(_LONGEST, math.ceil(1.2 * _LEAST_TURNS * rate / shaft))
    signal = recording.signal if count >= recording.n_samples else recording.slice(0, count).signal
    for name, channel, row in zip(recording.channels, statistics, signal, strict=True):
        if channel.bad or np.ptp(row) == 0:
            continue
        spacing = _line_family(row, recording.sample_rate, shaft)
        if spacing is not None:
            message = (
                f"lines at multiples of {spacing:.3f} Hz ({spacing * 60:.0f} rev/min) and none at the stated "
                f"{shaft * 60:.0f} rev/min ({shaft:.3f} Hz): is the speed or the sample rate wrong?"
            )
            return [Finding("speed", "warning", name, message)]
    return []


def implausible_rate(recording: Recording) -> list[Finding]:
    """A warning where the sample rate is one that vibration is not measured with, as where kHz were taken for Hz."""
    rate, shaft = recording.sample_rate, stated_speed(recording)
    least, most = _USUAL_RATES
    if recording.attributes.get("domain") == "angle":
        return []
    if rate > most and recording.unit in ("m/s^2", "1"):
        reason = f"accelerometers are read at up to {most:g} Hz: was {rate / 1000:g} Hz meant?"
    elif rate < least and recording.unit == "m/s^2":
        reason = f"accelerometers are read at {least:g} Hz and more: were {rate:g} kHz meant?"
    elif shaft and rate < _LEAST_PER_TURN * shaft:
        reason = f"that is {rate / shaft:.2g} samples in a turn at {shaft * 60:.5g} rev/min: were {rate:g} kHz meant?"
    else:
        return []
    return [Finding("rate", "warning", None, f"the sample rate is {rate:g} Hz, and {reason}")]


def _line_family(row: Float[np.ndarray, " time"], rate: float, shaft: float) -> float | None:
    """Spacing [Hz] of the lines that contradict `shaft`, or None."""
    lines = _lines(row, rate, (1 + _SPEED_SEARCH) * shaft * (_HARMONICS + 1))
    resolution = rate / len(row)
    width = math.ceil(2 * _SPEED_SEARCH * shaft * _HARMONICS / resolution) + 1
    candidates = shaft * np.linspace(1 - _SPEED_SEARCH, 1 + _SPEED_SEARCH, width)
    orders = np.arange(1, _HARMONICS + 1)
    distance = np.abs(candidates[:, None, None] * orders[None, :, None] - lines[None, None, :])
    hit = (distance <= 1.5 * resolution).any(axis=2) if len(lines) else np.zeros((width, _HARMONICS), bool)
    hits = hit.sum(axis=1)
    near = np.abs(candidates / shaft - 1) <= _SPEED_TOLERANCE
    best = int(np.argmax(hits))
    clear = hits[best] >= _HARMONICS // 2 and hit[best, :3].sum() >= 2 and len(lines) <= 4 * _HARMONICS
    if not clear or hits[near].max() > 2:
        return None
    matched = orders[hit[best]]
    nearest = lines[np.argmin(distance[best][hit[best]], axis=1)]
    return float(matched @ nearest / (matched @ matched))


def _lines(row: Float[np.ndarray, " time"], rate: float, top: float) -> Float[np.ndarray, " line"]:
    """Frequencies [Hz] below `top` that stand clear of the spectrum around them."""
    from scipy.ndimage import maximum_filter1d, median_filter

    # `signals` stands on a higher floor than recordings, so that its `power_density` cannot be called here.
    time = np.arange(len(row)) - (len(row) - 1) / 2
    trend = (time @ row) / (time @ time) * time + row.mean()
    frequency = np.arange(len(row) // 2 + 1) * (rate / len(row))
    low = frequency <= top
    amplitude = np.abs(np.fft.rfft((row - trend) * _hann_taper(len(row)))[low])
    amplitude[1:] *= math.sqrt(2)
    around = median_filter(amplitude, size=min(101, len(amplitude)))
    peak = (amplitude == maximum_filter1d(amplitude, 7)) & (amplitude > _LINE_RATIO * around)
    peak &= amplitude > 0.02 * amplitude.max()
    return frequency[low][peak]


@lru_cache(maxsize=2)
def _hann_taper(count: int) -> Float[np.ndarray, " time"]:
    return np.hanning(count + 1)[:-1]
