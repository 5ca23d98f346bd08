"""What is suspicious about the samples of one channel: clipping, dropouts, offsets."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from swashtwin.recordings.checks.channel_statistics import (
    ChannelStatistics,
    Extreme,
    channel_extremes,
    converter_steps,
)
from swashtwin.recordings.checks.findings import Finding
from swashtwin.recordings.recording import Recording

_CLIP_RUN = 3
"""Samples in a row at the extreme that count as clipped."""
_FLAT_SAMPLES, _FLAT_TIME = 20, 2e-3
"""A stretch of one value is flat from this many samples and this long [s] on."""
_OFFSET_RATIO = 5.0
"""Mean over standard deviation from which an offset is called large."""
_FULL_SCALES = tuple(2**bits for bits in range(9, 24))
"""Steps from zero to the end of a converter."""


def least_flat(sample_rate: float) -> float:
    """Samples of one value in a row from which a stretch is flat."""
    return max(_FLAT_SAMPLES, _FLAT_TIME * sample_rate)


def channel_findings(recording: Recording, statistics: list[ChannelStatistics]) -> Iterator[Finding]:
    """Findings of each channel; `statistics` keep runs of `least_flat` samples."""
    pairs = channel_extremes(recording, statistics)
    crowds = [[extreme.crowded(_CLIP_RUN) for extreme in extremes] for extremes in pairs]
    suspects = [
        number
        for number, channel in enumerate(statistics)
        if not (channel.is_constant or any(crowds[number])) and _may_touch_full_scale(channel, pairs[number])
    ]
    steps = converter_steps(recording, suspects) if suspects else {}
    for number, (channel, extremes) in enumerate(zip(statistics, pairs, strict=True)):
        if not channel.is_constant:
            is_cut = number in steps and _touches_full_scale(channel, extremes, steps[number])
            yield from _findings(recording, number, channel, crowds[number], is_cut)


def _findings(
    recording: Recording, number: int, channel: ChannelStatistics, crowds: list[int], is_cut: bool
) -> Iterator[Finding]:
    name = recording.channels[number]
    clipped = sum(crowds)
    if max(crowds) > recording.n_samples / 2:
        message = (
            f"{max(crowds)} samples ({max(crowds) / recording.n_samples:.2%}) are as good as equal beside the others, "
            f"of {channel.least:.4g} to {channel.most:.4g} {recording.unit}: spikes, or the pulses of a tachometer?"
        )
        yield Finding("spikes", "warning", name, message)
    elif clipped:
        share = clipped / recording.n_samples
        message = f"{clipped} samples ({share:.2%}) stand in a row at the extreme: the range was exceeded."
        yield Finding("clipping", "warning", name, message)
    elif is_cut:
        message = (
            f"samples touch the converter's full scale ({channel.least:.4g} to {channel.most:.4g}): peaks may be cut "
            "off."
        )
        yield Finding("clipping", "warning", name, message)
    starts, pairs, values = channel.equal_pairs.result()
    interior = ~np.isclose(values[:, None], (channel.least, channel.most)).any(axis=1)
    flat = interior | (clipped == 0)
    if flat.any():
        longest = int(np.argmax(np.where(flat, pairs, 0)))
        message = (
            f"{int(flat.sum())} flat stretches; the longest is {(pairs[longest] + 1) / recording.sample_rate:.4g} s "
            f"at {starts[longest] / recording.sample_rate:.4g} s: dropouts?"
        )
        yield Finding("flat", "warning", name, message)
    if abs(channel.mean) > _OFFSET_RATIO * channel.std > 0:
        ratio = abs(channel.mean) / channel.std
        message = (
            f"the offset {channel.mean:.4g} {recording.unit} is {ratio:.1f} times the vibration's std "
            f"{channel.std:.4g}."
        )
        yield Finding("offset", "warning", name, message)


def clipped_samples(row: Float[np.ndarray, " time"]) -> int:
    """Samples in runs at an extreme, where the extreme is crowded as only a stop makes it."""
    low, high = float(np.nanmin(row)), float(np.nanmax(row))
    if not (np.isfinite(low) and np.isfinite(high)):
        return 0
    extremes = Extreme(low, high - low, -1), Extreme(high, high - low, 1)
    for extreme in extremes:
        extreme.add(row, 0)
    return sum(extreme.crowded(_CLIP_RUN) for extreme in extremes)


def _may_touch_full_scale(channel: ChannelStatistics, extremes: tuple[Extreme, Extreme]) -> bool:
    lower, upper = extremes
    is_single = lower.touching == upper.touching == 1
    return not channel.bad and (not is_single or _spans_a_converter(channel.least, channel.most))


def _touches_full_scale(channel: ChannelStatistics, extremes: tuple[Extreme, Extreme], step: float) -> bool:
    """Whether several samples are -2^k or 2^k - 1 converter steps, as far as a converter of k + 1 bits reaches."""
    lower, upper = extremes
    touching = lower.touching * (round(-channel.least / step) in _FULL_SCALES)
    touching += upper.touching * (round(channel.most / step) + 1 in _FULL_SCALES)
    return touching >= 2


def _spans_a_converter(least: float, most: float) -> bool:
    """Whether `least` and `most` can both be full scale, at some number of bits on either side."""
    if not least < 0 < most:
        return False
    steps = most / -least * np.array(_FULL_SCALES) + 1  # of `most`, where `least` is -2^k steps
    return bool((np.abs(steps[:, None] - np.array(_FULL_SCALES)) <= 2 + steps[:, None] / 1024).any())
