"""Checks that compare the recordings of a data set: layout, duplicates, levels, classes."""

import math
import re
import statistics
import unicodedata
from collections import defaultdict
from collections.abc import Hashable, Iterable, Iterator, Sequence
from typing import TypeVar

from swashtwin.foundation import plural
from swashtwin.pump import is_healthy
from swashtwin.recordings.channel_statistics import ChannelStatistics
from swashtwin.recordings.findings import Finding, join_names
from swashtwin.recordings.manifest import CONTENT_MARKS, find_altered_duplicates
from swashtwin.recordings.recording import Recording

# Level over the median of its class above which gain or unit must differ: faults change it less.
_MAX_LEVEL_RATIO = 30.0

# Longest over shortest recording above which long ones would outweigh the others.
_MAX_LENGTH_RATIO = 3.0

# Copies of one measurement that a message lists.
_MAX_LISTED_COPIES = 6

# A hyphen behind a word or number separates, others are signs.
_NUMBER_OR_WORD = re.compile(
    r"(?P<number>(?:(?<![^\W_])[+\-\N{MINUS SIGN}]|[<>≤≥])?\d+(?:[.,]\d+)?)|[^\W\d_]+"
)

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
    recordings: Sequence[Recording], contents: Sequence[Sequence[str]]
) -> Iterator[Finding]:
    """Yield an error for each group of recordings that hold samples of one measurement.

    Parameters
    ----------
    contents : `describe_content` of each recording.
    """
    pairs: list[tuple[str, Recording]] = []
    for recording, content in zip(recordings, contents, strict=True):
        pairs.extend((text, recording) for text in content if text[0] not in CONTENT_MARKS)

    # Copies share a hash for each channel: one finding for each group, not for each channel.
    groups = {}
    for group in _group_by(pairs).values():
        groups[tuple(recording.recording_id for recording in group)] = group
    for ids, group in groups.items():
        if len(ids) > 1:
            message = f"{', '.join(ids)} hold the same samples {_copy_advice(group)}"
            yield Finding("duplicate", "error", None, message)

    numbered = {str(number): tuple(content) for number, content in enumerate(contents)}
    altered_pairs = [
        (int(later), int(earlier))
        for later, earlier in find_altered_duplicates(numbered)
        if not _share_hash(contents[int(later)], contents[int(earlier)])
    ]
    for numbers in _connected_groups(altered_pairs):
        group = [recordings[number] for number in numbers]
        names = join_names([recording.recording_id for recording in group], _MAX_LISTED_COPIES)
        message = (
            f"{names} hold samples of one measurement, altered or overlapping {_copy_advice(group)}"
        )
        yield Finding("altered_copy", "error", None, message)


def _share_hash(first: Sequence[str], second: Sequence[str]) -> bool:
    hashes = {text for text in first if text[0] not in CONTENT_MARKS}
    return not hashes.isdisjoint(second)


def _copy_advice(copies: Sequence[Recording]) -> str:
    """Return the classes of copies and what to do, to end a sentence with."""
    advice = (
        f"({_join_labels(copies)}); keep one of them, or training and test could share a "
        "measurement."
    )
    n_classes = len({recording.label for recording in copies})
    if n_classes > 1:
        advice += f" It stands in {n_classes} classes, so a label is wrong."
    return advice


def _connected_groups(pairs: Iterable[tuple[int, int]]) -> list[list[int]]:
    """Return the groups of numbers that pairs connect, each in ascending order."""
    groups: list[set[int]] = []
    for pair in pairs:
        touched = [group for group in groups if not group.isdisjoint(pair)]
        merged = set(pair).union(*touched)
        groups = [group for group in groups if group.isdisjoint(pair)] + [merged]
    return [sorted(group) for group in groups]


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


def class_name_findings(labels: Iterable[str | None]) -> Iterator[Finding]:
    """Yield classes whose names differ in spelling only, and several that are healthy by name."""
    spellings: dict[tuple[str, ...], list[str]] = {}
    for label in sorted({label for label in labels if label}):
        spellings.setdefault(_plain_spelling(label), []).append(label)

    for names in spellings.values():
        if len(names) > 1:
            message = (
                f"the classes {' and '.join(map(repr, names))} differ in case, spaces or "
                "separators only; are they one class?"
            )
            remedy = (
                "If so, give their recordings one label in the index, and remove the other names "
                "from its classes."
            )
            yield Finding("similar_classes", "warning", None, message, remedy)

    healthy_names = [names[0] for names in spellings.values() if is_healthy(names[0])]
    if len(healthy_names) > 1:
        surplus = "one" if len(healthy_names) == 2 else "all but one"
        message = (
            f"{len(healthy_names)} classes are healthy by name: {', '.join(healthy_names)}; "
            f"relabel {surplus}."
        )
        yield Finding("several_healthy", "note", None, message)


def _plain_spelling(label: str) -> tuple[str, ...]:
    """Return the words and numbers of a label without case, separators and umlauts.

    Numbers keep their sign and decimals: 1.0 mm is not 10 mm, and -1 mm is not 1 mm.
    """
    text = unicodedata.normalize("NFKD", label.casefold()).replace("\N{COMBINING DIAERESIS}", "e")
    parts: list[str] = []
    for match in _NUMBER_OR_WORD.finditer(text):
        is_number = match["number"] is not None
        if not is_number and parts and parts[-1][-1].isalpha():
            parts[-1] += match[0]  # valve_plate is valveplate
        else:
            parts.append(match[0].replace(",", ".").replace("\N{MINUS SIGN}", "-"))
    return tuple(parts)


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
