"""What shows only when recordings are compared: unequal rates, units and lengths, copies, thin classes."""

import math
import statistics as figures
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence

from swashtwin.foundation import plural
from swashtwin.pump import is_healthy
from swashtwin.recordings.checks.channel_statistics import ChannelStatistics
from swashtwin.recordings.checks.findings import Finding
from swashtwin.recordings.checks.layout import by_value, layout_findings, window_findings
from swashtwin.recordings.recording import Recording
from swashtwin.recordings.samples import hash_channels

_LEVEL_RATIO = 30.0
"""Level over the median of its class from which gain or unit must differ: faults change it less."""


class Comparison:
    """Recordings that are taken up one by one, and what shows only when they are compared.

    Parameters
    ----------
    window : samples of the windows that are to be cut.
    """

    def __init__(self, window: int) -> None:
        self._window = window
        self._recordings: list[Recording] = []
        self._statistics: list[list[ChannelStatistics]] = []

    def add(self, recording: Recording, statistics: list[ChannelStatistics]) -> None:
        """Take up a recording; its samples are not held."""
        self._recordings.append(recording)
        self._statistics.append(statistics)

    def findings(self) -> Iterator[Finding]:
        """Findings of all recordings together."""
        yield from layout_findings(self._recordings)
        yield from window_findings(self._recordings, self._window)
        yield from unequal_lengths(self._recordings)
        yield from self._duplicates()
        yield from self._odd_levels()
        yield from several_healthy(recording.label for recording in self._recordings)
        yield from thin_classes(self._recordings)

    def _duplicates(self) -> Iterator[Finding]:
        """Channels that hold the same samples; only those of equal figures are compared by their content."""
        rows = {}
        for number, channels in enumerate(self._statistics):
            for channel, figures_of in enumerate(channels):
                if not figures_of.is_constant:
                    rows[number, channel] = figures_of.key
        counts = Counter(rows.values())
        alike = [where for where, key in rows.items() if counts[key] > 1]
        groups = by_value((_hash(self._recordings[number], channel), self._recordings[number])
                           for number, channel in alike)  # fmt: skip
        groups.pop("", None)
        reported = set()
        for group in groups.values():
            ids = tuple(recording.recording_id for recording in group)
            if len(ids) > 1 and ids not in reported:
                reported.add(ids)
                message = (
                    f"{', '.join(ids)} hold the same samples ({_labels(group)}); keep one, or a test will know its "
                    "answer."
                )
                yield Finding("duplicate", "error", None, message)

    def _odd_levels(self) -> Iterator[Finding]:
        """Recordings whose level is far from that of their class, channel by channel."""
        levels: dict[tuple[str | None, str, str], list[tuple[float, Recording]]] = {}
        for recording, channels in zip(self._recordings, self._statistics, strict=True):
            for name, channel in zip(recording.channels, channels, strict=True):
                if channel.std > 0 and math.isfinite(channel.std):
                    key = recording.label, recording.unit, name
                    levels.setdefault(key, []).append((channel.std, recording))
        for (label, unit, name), members in levels.items():
            usual = figures.median_low([level for level, _ in members])
            odd = [(level, recording) for level, recording in members
                   if abs(math.log(level / usual)) > math.log(_LEVEL_RATIO)]  # fmt: skip
            if odd:
                level, recording = odd[0]
                names = _listed([recording.recording_id for _, recording in odd])
                message = (
                    f"the level of {names} is {level:.3g} {unit}, {level / usual:.3g} times the usual {usual:.3g} of "
                    f"{label or 'no class'}: another unit, range or calibration factor?"
                )
                yield Finding("level", "warning", name, message)


def _hash(recording: Recording, channel: int) -> str:
    """Hash of a channel's samples; empty where they are a ramp, such as a counter."""
    return hash_channels(block.signal[[channel]] for block in recording.unloaded().blocks())[0]


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")


def unequal_lengths(recordings: Sequence[Recording]) -> Iterator[Finding]:
    """A warning where the lengths differ much."""
    lengths = [recording.duration for recording in recordings]
    if lengths and max(lengths) > 3 * min(lengths):
        message = (
            f"lengths differ from {min(lengths):.4g} s to {max(lengths):.4g} s; long ones will outweigh the others."
        )
        yield Finding("length", "warning", None, message)


def several_healthy(labels: Iterable[str | None]) -> Iterator[Finding]:
    """A note where classes of several names are all healthy."""
    names = sorted({label for label in labels if label and is_healthy(label)})
    if len(names) > 1:
        others = "one" if len(names) == 2 else "all but one"
        message = f"{len(names)} classes are healthy by name: {', '.join(names)}; relabel {others}."
        yield Finding("several_healthy", "note", None, message)


def thin_classes(recordings: Sequence[Recording]) -> Iterator[Finding]:
    for label, group in by_value((recording.label or "", recording) for recording in recordings).items():
        if not label:
            yield Finding("unlabeled", "note", None, f"{plural(len(group), 'recording')} without a class.")
            continue
        specimens = {recording.specimen for recording in group if recording.specimen}
        if len(group) == 1:
            message = f"{label} has one recording only: it cannot stand in training and in a test."
            yield Finding("one_recording", "warning", None, message)
        elif len(specimens) == 1:
            message = (
                f"{label} was measured on one specimen only ({specimens.pop()}): no test can show transfer to another."
            )
            yield Finding("one_specimen", "note", None, message)


def _labels(recordings: Iterable[Recording]) -> str:
    return ", ".join(sorted({recording.label or "no class" for recording in recordings}))
