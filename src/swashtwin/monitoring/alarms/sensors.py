"""Findings of failed sensors and of pumps that do not run.

A recording with such a finding contains no evidence about the health of the pump.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy
from jaxtyping import Float, Float64

from swashtwin.foundation import plural
from swashtwin.monitoring.alarms.baseline import LARGE_CHANGE_SPREADS, OperatingPointBaseline
from swashtwin.recordings import (
    Recording,
    count_clipped_samples,
    find_doubled_channels,
    find_outliers,
    specified_shaft_frequency,
)

# All limits are chosen so that less than one healthy recording in 1,000 has a finding; the table in
# docs/explanation/alarms.md lists them, and the study `alarms` measured 0 of 5,200 healthy
# recordings.

FLAT_SHARE = 0.1
"""Share of the samples in stretches of one value from which on a channel is flat."""
MIN_FLAT_SAMPLES = 20
"""Minimum length of a stretch that counts as flat, in samples: steps of a converter are shorter."""
MIN_FLAT_TIME_S = 2e-3
"""Minimum duration of a stretch that counts as flat."""
SATURATED_SHARE = 1e-3
"""Share of the samples in a row at an extreme from which on a channel is saturated."""
LOOSE_SHARE = 0.5
"""Share of a channel's power below the frequency of the shaft from which on a plug or a cable is
loose.
"""
DEFAULT_TURN_S = 0.1
"""Duration of a turn if the speed is not specified."""
MIN_TURNS = 8
"""Minimum number of turns for the power below the shaft frequency, and of orders for lines."""
EQUAL_CORRELATION = 0.999
"""Correlation of two channels, in magnitude, that two separate sensors never reach.

It is a weaker rule than `find_doubled_channels`, which compares steps in the middle: one sensor at
two inputs with noise of their own is equal here, and not there. Without it, the alarms would learn
from such a recording and test it as two sensors, and their measured error rates hold with it.
"""
DEAD_RATIO = 1e-4
"""Standard deviation of a channel, over that of the loudest one, that is nothing but noise."""
SILENT_FALL_DB = 8.0
"""Median fall of a channel's bands from which on it is silent."""
MUFFLED_FALL_DB = 10.0
"""Median fall of the highest bands of a channel from which on it is muffled: a loose mounting
transmits no high frequencies.
"""
N_HIGHEST_BANDS = 4
"""Highest bands of a channel that are compared."""
MAX_MUFFLED_LOW_FALL_DB = 3.0
"""Maximum median fall of the lower half of the bands of a muffled channel."""
LINE_HEIGHT_DB = 6.0
"""Height of the strongest orders over the faint ones that makes them lines of the pump."""
LOST_HEIGHT_SHARE = 0.4
"""Remaining share of the height at which lines are lost."""
LOST_FALL_DB = 6.0
"""Mean fall of the strongest orders at which lines are lost."""
SWAPPED_RATIO = 0.5
"""Distance of the channels from the baseline when exchanged, over the distance in the recorded
order, below which they are swapped.
"""
MIN_AMPLITUDE_RATIO = 1e-20
"""Lower limit of an amplitude ratio, so that its logarithm exists."""


@dataclass(frozen=True)
class SensorFinding:
    """What is wrong with a sensor in one recording."""

    kind: Literal[
        "flat",
        "spikes",
        "saturated",
        "loose",
        "equal",
        "silent",
        "swapped",
        "stopped",
        "muffled",
        "fallen",
    ]
    """What the sensor does; ``stopped``: the pump does not run."""
    channel: str
    """Name of the channel; of several all names, with commas."""
    sentence: str
    """The finding in words, with the number that led to it."""


def check_sensors(recording: Recording) -> tuple[SensorFinding, ...]:
    """Return the findings that need no baseline, at most one for each channel.

    They are flat, spiky, saturated, loose, dead and doubled channels.
    """
    flat_length = round(max(MIN_FLAT_SAMPLES, MIN_FLAT_TIME_S * recording.sample_rate))
    turn_frequency = specified_shaft_frequency(recording) or 1 / DEFAULT_TURN_S
    turn_length = max(round(recording.sample_rate * (1 / turn_frequency)), 1)

    findings = []
    factors = recording.samples.factors
    for name, row, factor in zip(recording.channels, recording.signal, factors, strict=True):
        finding = _check_channel(name, row, factor, flat_length, turn_length)
        if finding is not None:
            findings.append(finding)
    if findings:
        return tuple(findings)

    # Sensors are compared only if each is sound: two flat channels are no doubled ones.
    signal = recording.signal
    centered = signal - signal.mean(axis=1, keepdims=True)
    return _compare_channels(centered, recording.channels) or _check_late_channels(recording)


def _check_channel(
    name: str, row: Float[np.ndarray, " time"], factor: float, flat_length: int, turn_length: int
) -> SensorFinding | None:
    """Return the first thing that is wrong with a channel.

    Parameters
    ----------
    factor : by which the numbers of the file were multiplied.
    flat_length, turn_length : samples that count as flat, and of a turn.
    """
    flat_share = _flat_share(row, flat_length)
    if flat_share >= FLAT_SHARE:
        return SensorFinding(
            "flat", name, f"channel {name} does not move in {flat_share:.0%} of the recording."
        )

    outliers = find_outliers(row)
    if outliers is not None:
        mark = outliers.mark(factor)
        kind = "spikes" if mark is None else f"{mark:.6g}, a mark of missing values"
        return SensorFinding(
            "spikes",
            name,
            f"channel {name} has {plural(outliers.numbers.size, 'sample')} up to {outliers.times} "
            f"times as far from the median as the others: {kind}.",
        )

    clipped_share = count_clipped_samples(row) / row.size
    if clipped_share >= SATURATED_SHARE:
        return SensorFinding(
            "saturated",
            name,
            f"channel {name} is at the end of its range in {clipped_share:.1%} of the samples.",
        )

    slow_share = _slow_share(row, turn_length)
    if slow_share >= LOOSE_SHARE:
        return SensorFinding(
            "loose",
            name,
            f"channel {name} has {slow_share:.0%} of its power below the speed of the shaft. "
            "Check its plug and cable.",
        )
    return None


def _flat_share(row: Float[np.ndarray, " time"], length: int) -> float:
    """Return the share of the recording in stretches of one value."""
    blocks = row[: row.size // length * length].reshape(-1, length)
    if not blocks.size:
        return 0.0
    return float(np.mean(blocks.min(axis=1) == blocks.max(axis=1)))


def _slow_share(row: Float[np.ndarray, " time"], turn_length: int) -> float:
    """Return the share of the power that is slower than the shaft."""
    turns = row[: row.size // turn_length * turn_length].reshape(-1, turn_length)
    variance = float(row.var())
    if len(turns) < MIN_TURNS or variance <= 0:
        return 0.0
    return float(turns.mean(axis=1).var()) / variance


def _compare_channels(
    signal: Float[np.ndarray, "channel time"], names: Sequence[str]
) -> tuple[SensorFinding, ...]:
    """Return channels without a signal, else pairs of channels with the same signal."""
    deviation = signal.std(axis=1)
    is_dead = deviation <= DEAD_RATIO * deviation.max()
    if is_dead.any():
        fall = 20 * np.log10(np.maximum(deviation / deviation.max(), MIN_AMPLITUDE_RATIO))
        return tuple(
            SensorFinding(
                "silent",
                names[index],
                f"channel {names[index]} is {-fall[index]:.0f} dB below the loudest channel.",
            )
            for index in np.flatnonzero(is_dead).tolist()
        )

    # In magnitude, since a doubled channel may be inverted.
    scaled = signal / deviation[:, None]
    correlation = np.triu(scaled @ scaled.T / signal.shape[1], 1)
    return tuple(
        SensorFinding(
            "equal",
            f"{names[first]}, {names[second]}",
            f"channels {names[first]} and {names[second]} contain the same signal.",
        )
        for first, second in np.argwhere(np.abs(correlation) >= EQUAL_CORRELATION).tolist()
    )


def _check_late_channels(recording: Recording) -> tuple[SensorFinding, ...]:
    """Return pairs of channels of which one contains the signal of the other, samples later."""
    return tuple(
        SensorFinding(
            "equal",
            f"{doubled.original}, {doubled.channel}",
            f"channel {doubled.channel} {doubled.description}.",
        )
        for doubled in find_doubled_channels(recording)
    )


def check_against_baseline(
    baseline: OperatingPointBaseline, band_powers: Float64[np.ndarray, " band"]
) -> tuple[SensorFinding, ...]:
    """Return findings against a complete baseline: band powers that fell, and swapped channels.

    The pump does not run if its lines at shaft orders are lost; if no lines are known, if all
    channels are silent. A channel that fell in all bands is silent, one that fell in the highest
    bands only is muffled. A recording is fallen if other bands changed as far as in a large
    recording although none rose.
    """
    names = baseline.layout.channels
    changes = _ChannelChanges(baseline, band_powers)

    # First the pump: if it does not run, its sensors seem to fail too.
    lost_lines = changes.lost_lines()
    is_silent = changes.is_silent()
    if lost_lines or (lost_lines is None and is_silent.all()):
        sentence = (
            f"{changes.fall.mean():+.0f} dB in the bands of all channels, without the lines of the "
            "pump. "
            "The pump does not run, or not at the specified speed; or its sensors have failed."
        )
        return (SensorFinding("stopped", ", ".join(names), sentence),)

    findings = []
    for index in np.flatnonzero(is_silent).tolist():
        sentence = (
            f"{changes.fall[index]:+.0f} dB in the bands of channel {names[index]}. "
            "Check its sensor and cable."
        )
        findings.append(SensorFinding("silent", names[index], sentence))
    for index in np.flatnonzero(changes.is_muffled()).tolist():
        sentence = (
            f"{changes.high_fall[index]:+.0f} dB in the highest bands of channel {names[index]}. "
            "Check its mounting."
        )
        findings.append(SensorFinding("muffled", names[index], sentence))
    if findings:
        return tuple(findings)

    # A silent or muffled channel would fit no baseline, and has fallen anyway.
    finding = _find_swapped_channels(baseline, band_powers)
    if finding is None and baseline.has_fallen(band_powers):
        finding = _describe_fall(baseline, band_powers)
    if finding is None:
        return ()
    return (finding,)


class _ChannelChanges:
    """Changes of the signals of all channels, without those of the envelopes [dB]."""

    def __init__(
        self, baseline: OperatingPointBaseline, band_powers: Float64[np.ndarray, " band"]
    ) -> None:
        n_channels = len(baseline.layout.channels)

        def signal_part(
            values: Float64[np.ndarray, " band"],
        ) -> Float64[np.ndarray, "channel signal_band"]:
            return values.reshape(n_channels, 2, -1)[:, 0]

        change = signal_part(band_powers - baseline.median)
        n_bands = change.shape[1] - baseline.layout.n_orders
        self._bands = change[:, :n_bands]
        self._band_spreads = self._bands / signal_part(baseline.spread)[:, :n_bands]
        self._baseline_orders = signal_part(baseline.median)[:, n_bands:]
        self._orders = signal_part(band_powers)[:, n_bands:]
        self.fall = np.median(self._bands, axis=1)
        """Median change of each channel's bands."""
        self.high_fall = np.median(self._bands[:, -N_HIGHEST_BANDS:], axis=1)
        """Median change of each channel's highest bands."""

    def is_silent(self) -> np.ndarray:
        """Return whether each channel fell in all bands."""
        spreads = np.median(self._band_spreads, axis=1)
        return np.asarray((self.fall <= -SILENT_FALL_DB) & (spreads <= -LARGE_CHANGE_SPREADS))

    def is_muffled(self) -> np.ndarray:
        """Return whether each channel fell in its highest bands only."""
        n_low_bands = self._bands.shape[1] // 2
        low_fall = np.median(self._bands[:, :n_low_bands], axis=1)
        high_spreads = np.median(self._band_spreads[:, -N_HIGHEST_BANDS:], axis=1)
        return np.asarray(
            (self.high_fall <= -MUFFLED_FALL_DB)
            & (high_spreads <= -LARGE_CHANGE_SPREADS)
            & (low_fall >= -MAX_MUFFLED_LOW_FALL_DB)
        )

    def lost_lines(self) -> bool | None:
        """Return whether all channels with lines lost them; None if no channel has lines.

        Lines are the strongest quarter of the orders, if they stand out from the faint half.
        """
        n_orders = self._orders.shape[1]
        if n_orders < MIN_TURNS:
            return None

        # The order is that of the baseline: the lines of today are what is in question.
        rank = np.argsort(self._baseline_orders, axis=1)
        strong = rank[:, -(n_orders // 4) :]
        faint = rank[:, : n_orders // 2]
        height = _selected_mean(self._baseline_orders, strong) - _selected_mean(
            self._baseline_orders, faint
        )
        remaining_height = _selected_mean(self._orders, strong) - _selected_mean(
            self._orders, faint
        )
        fall = _selected_mean(self._orders - self._baseline_orders, strong)

        is_lost = (remaining_height <= LOST_HEIGHT_SHARE * height) & (fall <= -LOST_FALL_DB)
        has_lines = height >= LINE_HEIGHT_DB
        if not has_lines.any():
            return None
        return bool(is_lost[has_lines].all())


def _selected_mean(
    values: Float64[np.ndarray, "channel order"], columns: np.ndarray
) -> Float64[np.ndarray, " channel"]:
    return np.asarray(np.take_along_axis(values, columns, axis=1).mean(axis=1))


def _describe_fall(
    baseline: OperatingPointBaseline, band_powers: Float64[np.ndarray, " band"]
) -> SensorFinding:
    change = band_powers - baseline.median
    index = int(np.argmin(change / baseline.spread))
    band = baseline.layout.band_powers[index]
    sentence = (
        f"band powers fell and none rose ({change[index]:+.1f} dB at {band.describe()}, channel "
        f"{band.channel}). Check gain and mounting, or whether the pump runs differently."
    )
    return SensorFinding("fallen", band.channel, sentence)


def _find_swapped_channels(
    baseline: OperatingPointBaseline, band_powers: Float64[np.ndarray, " band"]
) -> SensorFinding | None:
    """Return a finding if channels fit each other's baseline better than their own.

    The channels are assigned to those of the baseline so that the sum of distances is minimal. They
    are swapped if that halves the distance, and if each is further from its own baseline than in
    any recording that the baseline learned from.
    """
    distance = baseline.channel_distances(band_powers)
    rows = np.arange(len(distance))
    if (distance.argmin(axis=1) == rows).all():
        return None

    # `scipy.optimize` is loaded here: it takes 25 MB, which a healthy plant never needs.
    _, columns = scipy.optimize.linear_sum_assignment(distance)
    exchanged = np.flatnonzero(rows != columns)
    if not exchanged.size:
        return None

    own_distance = np.diag(distance)[exchanged]
    ratio = distance[exchanged, columns[exchanged]].sum() / own_distance.sum()
    is_within_baseline = (own_distance <= baseline.max_channel_distances[exchanged]).any()
    if ratio > SWAPPED_RATIO or is_within_baseline:
        return None

    names = ", ".join(baseline.layout.channels[index] for index in exchanged)
    sentence = (
        f"channels {names} fit each other's baseline (distance {ratio:.2f} of that to their own). "
        "Check whether their cables are swapped."
    )
    return SensorFinding("swapped", names, sentence)
