"""The shaft's angle from the pulses of a tachometer or an encoder."""

import math

import numpy as np
from jaxtyping import Float
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import median_filter

from swashtwin.foundation import DataError, InputError
from swashtwin.recordings import Recording
from swashtwin.signals.orders.shaft_angle import ShaftAngle

_RISE, _FALL = 0.6, 0.4
"""A pulse begins where the level rises through the first, once it has fallen through the second (of the range)."""
_ODD_INTERVAL = 1.5
"""An interval that many times its neighbors', or as small a part of them, is a pulse missed or counted twice."""


def tachometer_speed(recording: Recording, channel: str, pulses_per_turn: int = 1) -> ShaftAngle:
    """Angle of the shaft from the rising edges of a tachometer channel.

    Each edge is placed between two samples by a straight line; between edges the angle follows a monotone cubic
    (Fritsch and Carlson), before the first and after the last it goes on at the nearest interval's speed. With one
    pulse per turn angle 0 is the first pulse, the same mark in every recording. An encoder's marks are taken as evenly
    spaced.

    Parameters
    ----------
    channel : name of the tachometer channel.
    pulses_per_turn : pulses in one revolution of the shaft.

    Raises
    ------
    InputError
        No such channel, or a count below 1.
    DataError
        Fewer than three pulses, missing samples, or a pulse that was missed or counted twice.

    Examples
    --------
    >>> time = np.arange(10000) / 1000
    >>> pulses = (np.mod(12.5 * time, 1) < 0.1) * 5.0
    >>> angle = tachometer_speed(Recording(pulses[None], 1000.0, "a", ("tacho",)), "tacho")
    >>> print(f"{angle.mean_speed * 60 / (2 * np.pi):.1f} rev/min")
    750.0 rev/min
    """
    if pulses_per_turn < 1:
        raise InputError(f"pulses_per_turn ({pulses_per_turn}) must be 1 or more.")
    level = recording.picked([channel]).signal[0]
    if not np.isfinite(level).all():
        raise DataError(f"{recording.recording_id}, {channel}: samples are missing; no pulse can be counted there.")
    pulses = _rising_edges(level)
    if len(pulses) < 3:
        raise DataError(
            f"{recording.recording_id}, {channel}: {len(pulses)} pulses; a speed needs at least 3. Is it a tachometer?"
        )
    _require_even(pulses / recording.sample_rate, f"{recording.recording_id}, {channel}")
    marks = 2 * math.pi / pulses_per_turn * np.arange(len(pulses))
    angle = _between(pulses, marks, len(level))
    # The second difference of evenly noisy edges has six times their variance; a real acceleration only adds to it.
    scatter = float(np.std(np.diff(pulses, 2))) / math.sqrt(6)
    rate = float((marks[-1] - marks[0]) / (pulses[-1] - pulses[0]))
    covered = float((pulses[-1] - pulses[0]) / (len(level) - 1))
    once = pulses_per_turn == 1
    source = f"{channel}, {pulses_per_turn} pulse{'' if once else 's'} per turn"
    return ShaftAngle(angle, recording.sample_rate, scatter * rate, covered, absolute=once, source=source)


def _rising_edges(level: Float[np.ndarray, " time"]) -> Float[np.ndarray, " pulse"]:
    """Reading, with its fraction, at which each pulse rises through half the range."""
    low, high = float(level.min()), float(level.max())
    if high <= low:
        return np.empty(0)
    share = (level - low) / (high - low)
    state = np.where(share >= _RISE, 1, np.where(share <= _FALL, -1, 0))
    certain = np.flatnonzero(state)
    rises = np.flatnonzero((state[certain[1:]] == 1) & (state[certain[:-1]] == -1))
    edges = []
    for before, after in zip(certain[rises], certain[rises + 1], strict=True):
        part = share[before : after + 1]
        at = int(np.flatnonzero((part[:-1] < 0.5) & (part[1:] >= 0.5))[0])
        edges.append(before + at + (0.5 - part[at]) / (part[at + 1] - part[at]))
    return np.array(edges)


def _require_even(time: Float[np.ndarray, " pulse"], where: str) -> None:
    interval = np.diff(time)
    ratio = interval / median_filter(interval, size=min(5, len(interval)), mode="nearest")
    odd = np.flatnonzero((ratio > _ODD_INTERVAL) | (ratio < 1 / _ODD_INTERVAL))
    if len(odd):
        raise DataError(
            f"{where}: the pulses at {time[odd[0]]:.4f} s and {time[odd[0] + 1]:.4f} s lie {ratio[odd[0]]:.2f} times "
            "their neighbors' distance apart; a pulse was missed or counted twice, or the marks are uneven."
        )


def _between(
    pulses: Float[np.ndarray, " pulse"], marks: Float[np.ndarray, " pulse"], n_samples: int
) -> Float[np.ndarray, " time"]:
    sample = np.arange(n_samples, dtype=float)
    angle: np.ndarray = PchipInterpolator(pulses, marks)(np.clip(sample, pulses[0], pulses[-1]))
    first = (marks[1] - marks[0]) / (pulses[1] - pulses[0])
    last = (marks[-1] - marks[-2]) / (pulses[-1] - pulses[-2])
    return angle + np.minimum(sample - pulses[0], 0) * first + np.maximum(sample - pulses[-1], 0) * last
