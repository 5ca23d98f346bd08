"""Checks of the specified speed and sample rate against the lines in the spectrum."""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from swashtwin.recordings.channel_statistics import ChannelStatistics
from swashtwin.recordings.findings import Finding
from swashtwin.recordings.recording import Recording
from swashtwin.recordings.recording_facts import specified_shaft_frequency

_HARMONICS = 10

# Amplitude of a line over the median around it (16 dB).
_MIN_LINE_RATIO = 6.0

# Amplitude of a line over the highest one: weaker ones are leakage of it.
_MIN_RELATIVE_LINE = 0.02

# Bins around a line in which it must be the highest: a Hann window spreads it over four.
_LINE_DISTANCE_BINS = 7

# Bins over which the median around a line is taken.
_BACKGROUND_BINS = 101

# Bins between a line and a harmonic up to which they agree.
_MAX_LINE_ERROR_BINS = 1.5

# Relative distance from the specified speed up to which another one is searched for.
#
# Not more, because the neighbors of a nine-piston line lie 1/9 away.
_SPEED_SEARCH = 0.09

# Relative error that a specified speed may have.
_SPEED_TOLERANCE = 0.02

# Lowest sample rate of accelerometers.
_MIN_SAMPLE_RATE_HZ = 200.0

# Highest sample rate of accelerometers.
#
# The two lie less than a factor of 1250 apart, so that kHz mistaken for Hz are noticed.
_MAX_SAMPLE_RATE_HZ = 250e3

# Revolutions from which lines are searched for: fewer do not resolve the speed.
_MIN_TURNS = 50

# Samples in which lines are searched for, if they hold 1.2 times `_MIN_TURNS` revolutions.
_MAX_SEARCH_SAMPLES = 1 << 20

# Samples in a turn below which a signal hardly holds the shaft's own line.
_MIN_SAMPLES_PER_TURN = 4.0


def check_specified_speed(
    recording: Recording, statistics: Sequence[ChannelStatistics]
) -> list[Finding]:
    """Return a warning if shaft lines contradict the specified speed.

    It needs a clear family of lines at another speed and none at the specified one. A long
    recording is judged by its first 2^20 samples, or by more if these hold less than 60 turns.
    """
    shaft = specified_shaft_frequency(recording)
    rate = recording.sample_rate
    if not shaft or recording.duration * shaft < _MIN_TURNS or rate < 4 * _HARMONICS * shaft:
        return []

    count = max(_MAX_SEARCH_SAMPLES, math.ceil(1.2 * _MIN_TURNS * rate / shaft))
    signal = recording.samples.signal_part(0, count)
    for name, channel, row in zip(recording.channels, statistics, signal, strict=True):
        if channel.invalid_count or np.ptp(row) == 0:
            continue
        spacing = _find_other_spacing(row, rate, shaft)
        if spacing is not None:
            message = (
                f"lines at multiples of {spacing:.3f} Hz ({spacing * 60:.0f} rev/min) and none at "
                f"the specified {shaft * 60:.0f} rev/min ({shaft:.3f} Hz)."
            )
            remedy = (
                f"Set {{speed='{spacing * 60:.0f} rpm'}} or, if the speed is right, "
                f"{{sample_rate='{rate * shaft / spacing:.5g} Hz'}}."
            )
            return [Finding("speed", "warning", name, message, remedy)]
    return []


def check_sample_rate(recording: Recording) -> list[Finding]:
    """Return a warning if the sample rate does not suit vibration, as if kHz were taken for Hz."""
    if recording.attributes.get("domain") == "angle":
        return []

    rate = recording.sample_rate
    shaft = specified_shaft_frequency(recording)
    intended_rate = f"{rate:g} kHz"
    if rate > _MAX_SAMPLE_RATE_HZ and recording.unit in ("m/s^2", "1"):
        reason = f"accelerometers are read at up to {_MAX_SAMPLE_RATE_HZ:g} Hz"
        intended_rate = f"{rate / 1000:g} Hz"
    elif rate < _MIN_SAMPLE_RATE_HZ and recording.unit == "m/s^2":
        reason = f"accelerometers are read at {_MIN_SAMPLE_RATE_HZ:g} Hz and more"
    elif shaft and rate < _MIN_SAMPLES_PER_TURN * shaft:
        reason = f"that is {rate / shaft:.2g} samples in a turn at {shaft * 60:.5g} rev/min"
    else:
        return []

    message = f"the sample rate is {rate:g} Hz, but {reason}."
    remedy = f"If {intended_rate} was meant, set {{sample_rate='{intended_rate}'}}."
    return [Finding("rate", "warning", None, message, remedy)]


def _find_other_spacing(row: Float[np.ndarray, " time"], rate: float, shaft: float) -> float | None:
    """Return the spacing [Hz] of the lines that contradict the frequency `shaft`, or None."""
    lines = _find_lines(row, rate, (1 + _SPEED_SEARCH) * shaft * (_HARMONICS + 1))
    if not len(lines) or len(lines) > 4 * _HARMONICS:  # more are not those of one shaft
        return None

    resolution = rate / len(row)
    count = math.ceil(2 * _SPEED_SEARCH * shaft * _HARMONICS / resolution) + 1
    candidates = shaft * np.linspace(1 - _SPEED_SEARCH, 1 + _SPEED_SEARCH, count)
    orders = np.arange(1, _HARMONICS + 1)
    harmonics = candidates[:, None, None] * orders[None, :, None]
    distance = np.abs(harmonics - lines[None, None, :])
    is_matched = (distance <= _MAX_LINE_ERROR_BINS * resolution).any(axis=2)
    match_counts = is_matched.sum(axis=1)

    best = int(np.argmax(match_counts))
    has_low_orders = is_matched[best, :3].sum() >= 2
    is_family = match_counts[best] >= _HARMONICS // 2 and has_low_orders
    is_near_specified = np.abs(candidates / shaft - 1) <= _SPEED_TOLERANCE
    if not is_family or match_counts[is_near_specified].max() > 2:
        return None

    # Least squares of the spacing over the matched lines.
    matched_orders = orders[is_matched[best]]
    matched_lines = lines[np.argmin(distance[best][is_matched[best]], axis=1)]
    return float(matched_orders @ matched_lines / (matched_orders @ matched_orders))


def _find_lines(
    row: Float[np.ndarray, " time"], rate: float, max_frequency: float
) -> Float[np.ndarray, " line"]:
    """Return the frequencies [Hz] up to a maximum that exceed the spectrum around them."""
    from scipy.ndimage import maximum_filter1d, median_filter

    # `signals` is on a higher floor than recordings, so its `power_density` cannot be called here.
    time = np.arange(len(row)) - (len(row) - 1) / 2
    trend = (time @ row) / (time @ time) * time + row.mean()
    hann_window = np.hanning(len(row) + 1)[:-1]
    frequency = np.arange(len(row) // 2 + 1) * (rate / len(row))
    is_low = frequency <= max_frequency
    amplitude = np.abs(np.fft.rfft((row - trend) * hann_window)[is_low])
    amplitude[1:] *= math.sqrt(2)

    background = median_filter(amplitude, size=min(_BACKGROUND_BINS, len(amplitude)))
    is_line = amplitude == maximum_filter1d(amplitude, _LINE_DISTANCE_BINS)
    is_line &= amplitude > _MIN_LINE_RATIO * background
    is_line &= amplitude > _MIN_RELATIVE_LINE * amplitude.max()
    line_frequencies: np.ndarray = frequency[is_low][is_line]
    return line_frequencies
