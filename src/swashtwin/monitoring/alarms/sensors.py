"""Sensors that fail, and pumps that do not run: what such a recording shows says nothing of the
pump's health.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy
from jaxtyping import Float, Float64

from swashtwin.monitoring.alarms.baseline import SPREADS, OperatingPointBaseline
from swashtwin.recordings import Recording, count_clipped_samples, specified_shaft_frequency

FLAT = 0.1
"""Share of the samples in stretches of one value that makes a channel flat."""
_FLAT_SAMPLES, _FLAT_TIME = 20, 2e-3
"""Samples, and time [s], of a stretch that counts as flat."""
SATURATED = 1e-3
"""Share of the samples that stand in a row at an extreme that makes a channel saturated."""
SPIKES = 1e4
"""Largest deviation from the median over the usual one that no vibration has: single samples are
wrong.
"""
LOOSE = 0.5
"""Share of a channel's power in what is slower than the shaft that makes it loose: a plug or a
cable that moves.
"""
_SLOW = 0.1
"""Time [s] of a turn where the speed is not stated."""
_LEAST_TURNS = 8
EQUAL = 0.999
"""Correlation of two channels, in magnitude, that sensors of their own never have."""
DEAD = 1e-4
"""Standard deviation of a channel over that of the loudest one, below which nothing but noise is
left.
"""
SILENT = 8.0
"""Median fall [dB] of a channel's bands that makes it silent."""
MUFFLED, _TOP_BANDS, _KEPT = 10.0, 4, 3.0
"""Median fall [dB] of so many highest bands of a channel that makes it muffled, where its lower
bands fell less than the last number [dB].
"""
LINES, _LEFT, _LOST = 6.0, 0.4, 6.0
"""Height [dB] of a point's strongest orders over its faint ones that makes them lines; the share of
it, and the mean fall [dB], at which they are lost.
"""
SWAPPED = 0.5
"""Distance of the channels from the baseline when exchanged, over that as they are, below which
they are swapped.
"""


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
    """What it does; ``stopped``: the pump does not run."""
    channel: str
    """Channel; of several all, with commas."""
    sentence: str
    """The finding in words, with the number that led to it."""


def check_sensors(recording: Recording) -> tuple[SensorFinding, ...]:
    """Findings that need no baseline, one by channel: flat, spiky, saturated, loose, dead and
    doubled channels.
    """
    flat_length = round(max(_FLAT_SAMPLES, _FLAT_TIME * recording.sample_rate))
    turn = round(recording.sample_rate * (1 / (specified_shaft_frequency(recording) or 1 / _SLOW)))
    signal, names = recording.signal, recording.channels
    found = (
        _finding(name, row, flat_length, max(turn, 1))
        for name, row in zip(names, signal, strict=True)
    )
    findings = tuple(finding for finding in found if finding is not None)
    return findings or _compared_channels(signal - signal.mean(axis=1, keepdims=True), names)


def _compared_channels(
    signal: Float[np.ndarray, "channel time"], names: Sequence[str]
) -> tuple[SensorFinding, ...]:
    """Channels without a signal, and pairs of channels with the same one."""
    deviation = signal.std(axis=1)
    faint = deviation <= DEAD * deviation.max()
    if faint.any():
        fall = 20 * np.log10(np.maximum(deviation / deviation.max(), 1e-20))
        return tuple(
            SensorFinding(
                "silent",
                names[n],
                f"channel {names[n]} stands {-fall[n]:.0f} dB below the loudest channel.",
            )
            for n in np.flatnonzero(faint).tolist()
        )
    scaled = signal / deviation[:, None]
    alike = np.abs(np.triu(scaled @ scaled.T / signal.shape[1], 1)) >= EQUAL
    return tuple(
        SensorFinding(
            "equal",
            f"{names[n]}, {names[m]}",
            f"channels {names[n]} and {names[m]} hold the same signal.",
        )
        for n, m in np.argwhere(alike).tolist()
    )


def check_against_baseline(
    baseline: OperatingPointBaseline, band_powers: Float64[np.ndarray, " level"]
) -> tuple[SensorFinding, ...]:
    """Findings against a complete baseline: levels that fell, and channels that are swapped.

    The pump does not run where its lines at shaft orders are gone; where none are known, where all
    channels are silent. A channel that fell in all bands is silent, one that fell in the highest
    only is muffled. Other levels are fallen that changed as far as those of a large recording while
    none rose.
    """
    names = baseline.layout.channels
    change, spread, median, heights = (
        values.reshape(len(names), 2, -1)[:, 0]
        for values in (band_powers - baseline.median, baseline.spread, baseline.median, band_powers)
    )
    n_bands = change.shape[1] - baseline.layout.n_orders
    bands, far = change[:, :n_bands], change[:, :n_bands] / spread[:, :n_bands]
    fall = np.median(bands, axis=1)
    is_silent = (fall <= -SILENT) & (np.median(far, axis=1) <= -SPREADS)
    lost = _has_lost_lines(median[:, n_bands:], heights[:, n_bands:])
    if lost or (lost is None and is_silent.all()):
        sentence = f"{fall.mean():+.0f} dB in the bands of all channels, without the pump's lines: it does not run, or "
        sentence += "not at the stated speed; or its sensors have failed."
        return (SensorFinding("stopped", ", ".join(names), sentence),)
    findings = [
        SensorFinding(
            "silent",
            names[n],
            f"{fall[n]:+.0f} dB in the bands of channel {names[n]}: sensor or cable?",
        )
        for n in np.flatnonzero(is_silent).tolist()
    ]
    top, lower = (
        np.median(bands[:, -_TOP_BANDS:], axis=1),
        np.median(bands[:, : n_bands // 2], axis=1),
    )
    is_muffled = (
        (top <= -MUFFLED)
        & (np.median(far[:, -_TOP_BANDS:], axis=1) <= -SPREADS)
        & (lower >= -_KEPT)
    )
    findings += [
        SensorFinding(
            "muffled",
            names[n],
            f"{top[n]:+.0f} dB in the highest bands of channel {names[n]}: mounting?",
        )
        for n in np.flatnonzero(is_muffled).tolist()
    ]
    if not findings and (swapped := _swapped_channels(baseline, band_powers)) is not None:
        findings.append(swapped)
    if not findings and baseline.has_fallen(band_powers):
        index = int(np.argmin((band_powers - baseline.median) / baseline.spread))
        which, by = baseline.layout.band_powers[index], band_powers[index] - baseline.median[index]
        sentence = f"levels fell and none rose ({by:+.1f} dB at {which.words()}, channel {which.channel}): gain, "
        findings.append(
            SensorFinding(
                "fallen", which.channel, sentence + "mounting, or another state of the pump?"
            )
        )
    return tuple(findings)


def _has_lost_lines(
    before: Float64[np.ndarray, "channel order"], now: Float64[np.ndarray, "channel order"]
) -> bool | None:
    """Whether the strongest orders of each channel that has lines fell towards its faint ones; None
    without lines.
    """
    count = before.shape[1]
    if count < _LEAST_TURNS:
        return None
    rank = np.argsort(before, axis=1)
    strong, faint = rank[:, -(count // 4) :], rank[:, : count // 2]

    def mean(
        values: Float64[np.ndarray, "channel order"], which: np.ndarray
    ) -> Float64[np.ndarray, " channel"]:
        return np.asarray(np.take_along_axis(values, which, axis=1).mean(axis=1))

    height, left = mean(before, strong) - mean(before, faint), mean(now, strong) - mean(now, faint)
    is_lost = (left <= _LEFT * height) & (mean(now - before, strong) <= -_LOST)
    has_lines = height >= LINES
    return bool(is_lost[has_lines].all()) if has_lines.any() else None


def _swapped_channels(
    baseline: OperatingPointBaseline, band_powers: Float64[np.ndarray, " level"]
) -> SensorFinding | None:
    """Channels whose levels are those of each other in the baseline, or None.

    The channels are dealt to those of the baseline so that all are nearest. They are swapped where
    that halves the distance, and each was never as far from its own levels while the baseline was
    learned.
    """
    distance = baseline.channel_distances(band_powers)
    rows = np.arange(len(distance))
    if (distance.argmin(axis=1) == rows).all():
        return None
    columns = scipy.optimize.linear_sum_assignment(distance)[
        1
    ]  # imported where it is needed: it takes 25 MB
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


def _finding(
    name: str, row: Float[np.ndarray, " time"], flat_length: int, turn: int
) -> SensorFinding | None:
    blocks = row[: row.size // flat_length * flat_length].reshape(-1, flat_length)
    flat = float(np.mean(blocks.min(axis=1) == blocks.max(axis=1))) if blocks.size else 0.0
    if flat >= FLAT:
        return SensorFinding(
            "flat", name, f"channel {name} does not move in {flat:.0%} of the recording."
        )
    deviation = np.abs(row.astype(np.float64) - float(np.median(row)))
    usual = float(np.median(deviation))
    ratio = (
        float(deviation.max()) / usual if usual > 0 else 0.0
    )  # 0 where half of the samples are equal
    if ratio >= SPIKES:
        sentence = f"channel {name} has single samples {ratio:.1g} times as far from the middle as the others: spikes."
        return SensorFinding("spikes", name, sentence)
    clipped = count_clipped_samples(row) / row.size
    if clipped >= SATURATED:
        sentence = f"channel {name} stands at the end of its range in {clipped:.1%} of the samples."
        return SensorFinding("saturated", name, sentence)
    means = row[: row.size // turn * turn].reshape(-1, turn).mean(axis=1)
    total = float(row.var())
    slow = float(means.var()) / total if len(means) >= _LEAST_TURNS and total > 0 else 0.0
    if slow >= LOOSE:
        sentence = f"channel {name} has {slow:.0%} of its power below the speed of the shaft: a loose plug or cable?"
        return SensorFinding("loose", name, sentence)
    return None
