"""Checks that compare the recordings of a data set: layout, duplicates, levels, classes."""

import math
import statistics
from collections import defaultdict
from collections.abc import Hashable, Iterable, Iterator, Sequence
from typing import TypeVar

from swashtwin.foundation import plural
from swashtwin.pump import is_healthy
from swashtwin.recordings.channel_statistics import ChannelStatistics
from swashtwin.recordings.findings import Finding, join_names
from swashtwin.recordings.recording import Recording

# Level over the median of its class above which gain or unit must differ: faults change it less.
_MAX_LEVEL_RATIO = 30.0

# Longest over shortest recording above which long ones would outweigh the others.
_MAX_LENGTH_RATIO = 3.0

_Key = TypeVar("_Key", bound=Hashable)


def layout_findings(recordings: Sequence[Recording]) -> Iterator[Finding]:
    """Yield an error for each of rate, channels and unit that differs between recordings."""
    rates = [(f"{recording.sample_rate:g} Hz", recording) for recording in recordings]
    channels = [(", ".join(recording.channels), recording) for recording in recordings]
    units = [(recording.unit, recording) for recording in recordings]
    checks = (
        ("rate", "sample rates", rates, 'resample them with resample = "..." in the index'),
        (
            "channels",
            "channels",
            channels,
            'select the same in each with channels = ["..."], and give them the same '
            'names = ["..."] in the index',
        ),
        ("unit", "units", units, 'specify sensitivity = "..." for each in the index'),
    )
    for kind, noun, pairs, advice in checks:
        groups = _group_by(pairs)
        if len(groups) < 2:
            continue
        parts = []
        for value, group in groups.items():
            names = join_names([recording.recording_id for recording in group])
            parts.append(f"{value}: {names} ({_join_labels(group)})")
        message = f"{noun} differ ({'; '.join(parts)}): {advice}."
        yield Finding(kind, "error", None, message)


def length_findings(recordings: Sequence[Recording]) -> Iterator[Finding]:
    """Yield a warning if lengths differ by more than a factor of three."""
    lengths = [recording.duration for recording in recordings]
    if lengths and max(lengths) > _MAX_LENGTH_RATIO * min(lengths):
        message = (
            f"lengths differ from {min(lengths):.4g} s to {max(lengths):.4g} s; "
            "long recordings will outweigh the others."
        )
        yield Finding("length", "warning", None, message)


def duplicate_findings(
    recordings: Sequence[Recording], hashes: Sequence[Sequence[str]]
) -> Iterator[Finding]:
    """Yield an error for each group of recordings that hold the same samples.

    Parameters
    ----------
    hashes : `Recording.content_hashes` of each recording.
    """
    pairs: list[tuple[str, Recording]] = []
    for recording, digests in zip(recordings, hashes, strict=True):
        pairs.extend((digest, recording) for digest in digests)

    # Copies share a hash for each channel: one finding for each group, not for each channel.
    groups = {}
    for group in _group_by(pairs).values():
        groups[tuple(recording.recording_id for recording in group)] = group
    for ids, group in groups.items():
        if len(ids) > 1:
            message = (
                f"{', '.join(ids)} hold the same samples ({_join_labels(group)}); keep one of "
                "them, or training and test could share a measurement."
            )
            yield Finding("duplicate", "error", None, message)


def level_findings(
    recordings: Sequence[Recording], channel_statistics: Sequence[Sequence[ChannelStatistics]]
) -> Iterator[Finding]:
    """Yield a warning for levels that another unit or sensitivity would explain.

    They lie a factor of thirty from the median of their class.
    """
    levels: dict[tuple[str | None, str, str], list[tuple[float, Recording]]] = defaultdict(list)
    for recording, channels in zip(recordings, channel_statistics, strict=True):
        for name, channel in zip(recording.channels, channels, strict=True):
            if channel.std > 0 and math.isfinite(channel.std):
                levels[recording.label, recording.unit, name].append((channel.std, recording))

    descriptions: dict[tuple[str, str], list[str]] = defaultdict(list)
    for (label, unit, name), members in levels.items():
        median = statistics.median_low([level for level, _ in members])
        outliers = []
        for level, recording in members:
            if abs(math.log(level / median)) > math.log(_MAX_LEVEL_RATIO):
                outliers.append((level, recording))
        if not outliers:
            continue
        level = outliers[0][0]
        names = join_names([recording.recording_id for _, recording in outliers])
        descriptions[names, label or "no class"].append(
            f"{level:.3g} {unit} in {name} ({level / median:.3g} times the median {median:.3g})"
        )

    for (names, label), parts in descriptions.items():
        message = (
            f"the level of {names} is not that of {label}: {', '.join(parts)}; "
            "another unit or sensitivity?"
        )
        yield Finding("level", "warning", None, message)


def healthy_class_findings(labels: Iterable[str | None]) -> Iterator[Finding]:
    """Yield a note if classes of several names are all healthy."""
    names = sorted({label for label in labels if label and is_healthy(label)})
    if len(names) > 1:
        surplus = "one" if len(names) == 2 else "all but one"
        message = (
            f"{len(names)} classes are healthy by name: {', '.join(names)}; relabel {surplus}."
        )
        yield Finding("several_healthy", "note", None, message)


def class_size_findings(recordings: Sequence[Recording]) -> Iterator[Finding]:
    """Yield classes of one recording or one specimen, and recordings without a class."""
    groups = _group_by((recording.label or "", recording) for recording in recordings)
    for label, group in groups.items():
        if not label:
            message = f"{plural(len(group), 'recording')} without a class."
            yield Finding("unlabeled", "note", None, message)
            continue

        specimens = {recording.specimen for recording in group if recording.specimen}
        if len(group) == 1:
            message = f"{label} has only one recording: it cannot be both in training and in test."
            yield Finding("one_recording", "warning", None, message)
        elif len(specimens) == 1:
            message = (
                f"{label} was measured on only one specimen ({specimens.pop()}): "
                "no test can show transfer to another."
            )
            yield Finding("one_specimen", "note", None, message)


def _group_by(pairs: Iterable[tuple[_Key, Recording]]) -> dict[_Key, list[Recording]]:
    groups: dict[_Key, list[Recording]] = {}
    for key, recording in pairs:
        groups.setdefault(key, []).append(recording)
    return groups


def _join_labels(recordings: Iterable[Recording]) -> str:
    return ", ".join(sorted({recording.label or "no class" for recording in recordings}))
