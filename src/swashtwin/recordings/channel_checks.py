"""Checks of each channel: missing and impossible samples, dead sensors, clipping, offsets."""

from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Float, Int

from swashtwin.foundation import DataError, plural
from swashtwin.recordings.channel_statistics import (
    PART_SAMPLES,
    ChannelStatistics,
    compute_channel_statistics,
    find_runs,
)
from swashtwin.recordings.doubled_channels import find_doubled_channels
from swashtwin.recordings.findings import Finding
from swashtwin.recordings.recording import Recording
from swashtwin.recordings.recording_facts import specified_shaft_frequency

# Windows are in single precision.
_MAX_VALUE = float(np.finfo(np.float32).max)

# Distance from an extreme, relative to the range, up to which a sample is near it.
#
# A sensor that clips has few samples there: its signal passes quickly on the way to the stop.
_NEAR_EXTREME = 0.01

# Distance from an extreme, relative to the range, up to which a sample is at it: rounding.
_AT_EXTREME = 1e-6

# Consecutive samples at the extreme that count as clipped: a smooth peak has two at most.
_MIN_CLIPPED_RUN = 3

# Share of the samples in runs at both extremes from which on a signal has two levels only.
_MIN_TWO_LEVEL_SHARE = 0.98

# Samples in runs at an extreme below which they may be there by chance.
_MIN_CROWD = 2 * _MIN_CLIPPED_RUN

# Mean over standard deviation from which an offset is reported.
_MIN_OFFSET_RATIO = 5.0


def require_usable(recording: Recording) -> None:
    """Refuse a recording from which nothing can be learned.

    Raises
    ------
    DataError
        Missing samples or marks of them, a sample beyond single precision, negative numbers stored
        without their sign, a constant channel, gaps in time, or less than one revolution if the
        speed is known.
    """
    for finding in find_unusable(recording, compute_channel_statistics(recording)):
        source_name = recording.recording_id
        if finding.channel is not None:
            source_name = f"{source_name}, {finding.channel}"
        raise DataError(f"{source_name}: {finding.message}", remedy=finding.remedy)


def find_unusable(
    recording: Recording, statistics: Sequence[ChannelStatistics]
) -> Iterator[Finding]:
    """Yield the reasons why nothing can be learned from a recording."""
    factors = recording.samples.factors
    for name, channel, factor in zip(recording.channels, statistics, factors, strict=True):
        finding = _find_unusable_channel(recording, name, channel, factor)
        if finding is not None:
            yield finding

    if gaps := recording.attributes.get("time_gaps"):
        message = f"the time column has gaps: {gaps}; split the file there."
        yield Finding("gaps", "error", None, message)

    shaft = specified_shaft_frequency(recording)
    if shaft and recording.duration * shaft < 1:
        message = (
            f"{recording.duration:.4g} s is shorter than one revolution at "
            f"{shaft * 60:.5g} rev/min ({1 / shaft:.4g} s); record longer, or correct the "
            "sample rate."
        )
        yield Finding("short", "error", None, message)


def _find_unusable_channel(
    recording: Recording, name: str, channel: ChannelStatistics, factor: float
) -> Finding | None:
    """Return the first reason why nothing can be learned from a channel.

    Parameters
    ----------
    factor : by which the numbers of the file were multiplied.
    """
    peak = max(channel.maximum, -channel.minimum)
    marks = [outliers for outliers in channel.outliers if outliers.mark(factor) is not None]

    if channel.invalid_count:
        message = (
            f"{channel.invalid_count} of {recording.n_samples} samples are missing or "
            f"infinite, the first at {channel.first_invalid / recording.sample_rate:.6g} s; "
            "cut them out or repair the file."
        )
        return Finding("nan", "error", name, message)

    if peak > _MAX_VALUE:
        message = (
            f"a sample of {peak:.3g} {recording.unit} is larger than a window can hold "
            f"({_MAX_VALUE:.2g}); cut it out, or repair the file."
        )
        return Finding("too_large", "error", name, message)

    if channel.is_constant:
        message = f"every sample is {channel.minimum:g}: a dead or unplugged sensor?"
        return Finding("constant", "error", name, message)

    if marks:
        mark = marks[0].farthest
        count = sum(outliers.numbers.size for outliers in marks)
        verb = "is" if count == 1 else "are"
        in_file = "" if factor == 1 else f" ({mark / factor:.6g} in the file)"
        message = (
            f"{count} of {recording.n_samples} samples {verb} exactly {mark:.6g} {recording.unit}"
            f"{in_file}, {marks[0].times} times as far from the median as usual, the first at "
            f"{int(marks[0].numbers[0]) / recording.sample_rate:.6g} s: a mark of missing values? "
            "Cut them out or repair the file."
        )
        return Finding("missing", "error", name, message)

    if channel.wrap_count:
        message = (
            f"the samples jump {channel.wrap_count} times from one end of their range to the "
            f"other ({channel.minimum:.4g} to {channel.maximum:.4g} {recording.unit}), and are "
            "continuous otherwise: negative numbers that were stored without their sign? Store "
            "them as signed numbers."
        )
        return Finding("wrapped", "error", name, message)
    return None


def describe_sensor_doubts(recording: Recording) -> tuple[str, ...]:
    """Return sentences on channels whose samples look changed or doubled.

    Every model notes them with its verdict. An offset is left out, since no model regards it.
    """
    findings = check_channels(recording, compute_channel_statistics(recording))
    return tuple(
        f"Channel {finding.channel}: {finding.message}"
        for finding in findings
        if finding.kind != "offset"
    )


def check_channels(
    recording: Recording, statistics: Sequence[ChannelStatistics]
) -> Iterator[Finding]:
    """Yield clipping, dropouts and offsets of each channel that is not constant, and channels with
    one signal.
    """
    counts = _count_at_extremes(recording, statistics)
    factors = recording.samples.factors
    for name, channel, factor, channel_counts in zip(
        recording.channels, statistics, factors, counts, strict=True
    ):
        if channel.is_constant:
            continue

        crowds = [_crowd_size(*extreme) for extreme in channel_counts.tolist()]
        findings = (
            _check_extremes(recording, name, channel, crowds)
            or _check_spikes(recording, name, channel, factor),
            _check_made(name, channel),
            _check_dropouts(recording, name, channel, is_clipped=any(crowds)),
            _check_offset(recording, name, channel),
        )
        for finding in findings:
            if finding is not None:
                yield finding

    for doubled in find_doubled_channels(recording):
        message = (
            f"it {doubled.description}: one sensor recorded twice? Check the cables, and which "
            "inputs the logger stores."
        )
        yield Finding("doubled", "warning", doubled.channel, message)


def _check_extremes(
    recording: Recording, name: str, channel: ChannelStatistics, crowds: Sequence[int]
) -> Finding | None:
    count = recording.n_samples
    if min(crowds) > 0 and sum(crowds) >= _MIN_TWO_LEVEL_SHARE * count:
        message = (
            f"the samples have two levels only, {channel.minimum:.4g} and {channel.maximum:.4g} "
            f"{recording.unit}: the pulses of a tachometer or a switch, or a signal far beyond the "
            "range?"
        )
        return Finding("two_levels", "warning", name, message)
    if max(crowds) > count / 2:
        message = (
            f"{max(crowds)} samples ({max(crowds) / count:.2%}) are nearly equal compared with "
            f"the others, of {channel.minimum:.4g} to {channel.maximum:.4g} {recording.unit}: "
            "spikes, or the pulses of a tachometer?"
        )
        return Finding("spikes", "warning", name, message)

    clipped = sum(crowds)
    if not clipped:
        return None
    message = (
        f"{clipped} samples ({clipped / count:.2%}) stand in a row at the extreme: "
        "the range was exceeded."
    )
    return Finding("clipping", "warning", name, message)


def _check_spikes(
    recording: Recording, name: str, channel: ChannelStatistics, factor: float
) -> Finding | None:
    spikes = [outliers for outliers in channel.outliers if outliers.mark(factor) is None]
    if not spikes:
        return None
    count = sum(outliers.numbers.size for outliers in spikes)
    farthest = max(spikes, key=lambda outliers: outliers.ratio)
    message = (
        f"{plural(count, 'sample')} of {recording.n_samples} up to {farthest.times} times as far "
        "from the median as usual, with none between, the first at "
        f"{int(spikes[0].numbers[0]) / recording.sample_rate:.6g} s: spikes, or the pulses of a "
        "tachometer?"
    )
    return Finding("spikes", "warning", name, message)


def _check_made(name: str, channel: ChannelStatistics) -> Finding | None:
    if not channel.made:
        return None
    message = (
        f"{channel.made}: samples were made of fewer measured ones, and frequencies above half of "
        "their rate are not measured."
    )
    return Finding("made", "warning", name, message)


def _check_dropouts(
    recording: Recording, name: str, channel: ChannelStatistics, *, is_clipped: bool
) -> Finding | None:
    stretches = [] if channel.made else channel.stretches
    if is_clipped:  # flat stretches at the extremes are the clipping
        extremes = (channel.minimum, channel.maximum)
        stretches = [
            stretch for stretch in stretches if not np.isclose(stretch.value, extremes).any()
        ]
    if not stretches:
        return None

    longest = max(stretches, key=lambda stretch: stretch.length)
    message = (
        f"{len(stretches)} flat stretches; the longest is "
        f"{longest.length / recording.sample_rate:.4g} s at "
        f"{longest.start / recording.sample_rate:.4g} s: dropouts?"
    )
    return Finding("flat", "warning", name, message)


def _check_offset(recording: Recording, name: str, channel: ChannelStatistics) -> Finding | None:
    if not abs(channel.mean) > _MIN_OFFSET_RATIO * channel.std > 0:
        return None
    message = (
        f"the offset {channel.mean:.4g} {recording.unit} is "
        f"{abs(channel.mean) / channel.std:.1f} times the vibration's std {channel.std:.4g}."
    )
    return Finding("offset", "warning", name, message)


def count_clipped_samples(row: Float[np.ndarray, " time"]) -> int:
    """Return the number of samples in runs at an extreme, if it is crowded as by clipping."""
    minimum = float(np.nanmin(row))
    maximum = float(np.nanmax(row))
    if not (np.isfinite(minimum) and np.isfinite(maximum)):
        return 0
    return sum(_crowd_size(*counts) for counts in _row_at_extremes(row, minimum, maximum).tolist())


def _count_at_extremes(
    recording: Recording, statistics: Sequence[ChannelStatistics]
) -> Int[np.ndarray, "channel extreme 2"]:
    counts = np.zeros((len(statistics), 2, 2), int)
    for start in range(0, recording.n_samples, PART_SAMPLES):
        signal = recording.samples.signal_part(start, start + PART_SAMPLES)
        for channel_counts, row, channel in zip(counts, signal, statistics, strict=True):
            if not channel.is_constant:
                channel_counts += _row_at_extremes(row, channel.minimum, channel.maximum)
    return counts


def _row_at_extremes(
    row: Float[np.ndarray, " time"], minimum: float, maximum: float
) -> Int[np.ndarray, "extreme 2"]:
    """Return the samples in runs at the lower and the upper extreme, and those only near it."""
    counts = np.zeros((2, 2), int)
    span = maximum - minimum
    # The lower extreme is the upper one of the negative signal.
    for index, (values, extreme) in enumerate(((-row, -minimum), (row, maximum))):
        near_extreme = np.flatnonzero(values >= extreme - _NEAR_EXTREME * span)
        is_reached = extreme - values[near_extreme] <= _AT_EXTREME * span
        at_extreme = near_extreme[is_reached]
        _, lengths = find_runs(at_extreme)
        counts[index, 0] = lengths[lengths >= _MIN_CLIPPED_RUN].sum()
        counts[index, 1] = near_extreme.size - at_extreme.size
    return counts


def _crowd_size(n_in_runs: int, n_near: int) -> int:
    """Return the samples in runs at an extreme, or 0 if these are not more than those near it."""
    is_crowded = n_in_runs >= _MIN_CROWD and n_in_runs > n_near
    return n_in_runs if is_crowded else 0
