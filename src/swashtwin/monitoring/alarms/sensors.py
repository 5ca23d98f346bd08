"""Sensors that fail: flat, spiky, saturated, loose and swapped channels. They say nothing about the pump."""

from dataclasses import asdict, dataclass
from typing import Literal

import numpy as np
import scipy.optimize
from jaxtyping import Float, Float64

from swashtwin.monitoring.alarms.baseline import PointBaseline
from swashtwin.recordings import Recording, clipped_samples, stated_speed

FLAT = 0.1
"""Share of the samples in stretches of one value that makes a channel flat."""
_FLAT_SAMPLES, _FLAT_TIME = 20, 2e-3
"""Samples, and time [s], of a stretch that counts as flat."""
SATURATED = 1e-3
"""Share of the samples that stand in a row at an extreme that makes a channel saturated."""
SPIKES = 1e4
"""Largest deviation from the median over the usual one that no vibration has: single samples are wrong."""
LOOSE = 0.5
"""Share of a channel's power in what is slower than the shaft that makes it loose: a plug or a cable that moves."""
_SLOW = 0.1
"""Time [s] of a turn where the speed is not stated."""
_LEAST_TURNS = 8
SWAPPED = 0.5
"""Distance of the channels from the baseline when exchanged, over that as they are, below which they are swapped."""


@dataclass(frozen=True)
class SensorFinding:
    """What is wrong with a sensor in one recording."""

    kind: Literal["flat", "spikes", "saturated", "loose", "swapped"]
    """What it does."""
    channel: str
    """Channel; of swapped ones all, with commas."""
    sentence: str
    """The finding in words, with the number that led to it."""

    def to_dict(self) -> dict[str, str]:
        """Words that JSON can hold."""
        return asdict(self)


def sensor_findings(recording: Recording) -> tuple[SensorFinding, ...]:
    """Flat, spiky, saturated and loose channels of a recording, which need no baseline; one finding by channel."""
    flat_length = round(max(_FLAT_SAMPLES, _FLAT_TIME * recording.sample_rate))
    turn = round(recording.sample_rate * (1 / (stated_speed(recording) or 1 / _SLOW)))
    findings = (
        _finding(name, row, flat_length, max(turn, 1))
        for name, row in zip(recording.channels, recording.signal, strict=True)
    )
    return tuple(finding for finding in findings if finding is not None)


def swapped_channels(baseline: PointBaseline, levels: Float64[np.ndarray, " level"]) -> SensorFinding | None:
    """Channels whose levels are those of each other in the baseline, or None.

    The channels are dealt to those of the baseline so that all are nearest. They are swapped where that halves the
    distance, and each was never as far from its own levels while the baseline was learned.
    """
    distance = baseline.channel_distances(levels)
    rows, columns = scipy.optimize.linear_sum_assignment(distance)
    moved = np.flatnonzero(rows != columns)
    if not moved.size:
        return None
    straight = np.diag(distance)[moved]
    ratio = distance[moved, columns[moved]].sum() / straight.sum()
    if ratio > SWAPPED or (straight <= baseline.furthest[moved]).any():
        return None
    names = ", ".join(baseline.layout.channels[index] for index in moved)
    sentence = f"channels {names} look like each other's baseline (distance {ratio:.2f} of that as they are): swapped?"
    return SensorFinding("swapped", names, sentence)


def _finding(name: str, row: Float[np.ndarray, " time"], flat_length: int, turn: int) -> SensorFinding | None:
    flat = _flat_share(row, flat_length)
    if flat >= FLAT:
        return SensorFinding("flat", name, f"channel {name} does not move in {flat:.0%} of the recording.")
    ratio = _largest_deviation(row)
    if ratio >= SPIKES:
        sentence = f"channel {name} has single samples {ratio:.1g} times as far from the middle as the others: spikes."
        return SensorFinding("spikes", name, sentence)
    clipped = clipped_samples(row) / row.size
    if clipped >= SATURATED:
        sentence = f"channel {name} stands at the end of its range in {clipped:.1%} of the samples."
        return SensorFinding("saturated", name, sentence)
    slow = _slow_share(row, turn)
    if slow >= LOOSE:
        sentence = f"channel {name} has {slow:.0%} of its power below the speed of the shaft: a loose plug or cable?"
        return SensorFinding("loose", name, sentence)
    return None


def _flat_share(row: Float[np.ndarray, " time"], length: int) -> float:
    """Share of the blocks of `length` samples that hold one value; 0 of less than a block."""
    count = row.size // length
    if not count:
        return 0.0
    blocks = row[: count * length].reshape(count, -1)
    return float(np.mean(blocks.min(axis=1) == blocks.max(axis=1)))


def _largest_deviation(row: Float[np.ndarray, " time"]) -> float:
    """Largest deviation from the median over the median deviation; 0 where half of the samples are equal."""
    deviation = np.abs(row.astype(np.float64) - float(np.median(row)))
    usual = float(np.median(deviation))
    return float(deviation.max()) / usual if usual > 0 else 0.0


def _slow_share(row: Float[np.ndarray, " time"], turn: int) -> float:
    """Variance of the means over `turn` samples over that of all samples; 0 of fewer than eight turns."""
    count = row.size // turn
    if count < _LEAST_TURNS:
        return 0.0
    means = row[: count * turn].reshape(count, turn).mean(axis=1)
    total = float(row.var())
    return float(means.var()) / total if total > 0 else 0.0
