"""Tables of recordings: each one, or many summed up by class and operating condition."""

import math
import statistics
from collections.abc import Callable, Hashable, Iterable, Sequence
from typing import TYPE_CHECKING, TypeVar

from swashtwin.cli.console import say, table
from swashtwin.foundation import plural

if TYPE_CHECKING:
    from swashtwin.learning import DataCheck, FittedClassifier
    from swashtwin.recordings import InspectionReport, Recording, RecordingReport
    from swashtwin.signals import Row, Trend

T = TypeVar("T")

MOST_ROWS = 12
"""Recordings that are shown one by one; more are summed up."""

_STATUS = ("within", "above", "below", "no baseline")
_FURTHEST = 3
_STATES = {"yes": "enough", "partly": "in part", "no": "not enough"}


def class_words(label: str | None) -> str:
    """Name of a class as a reader should see it."""
    return (label or "no class").replace("_", " ")


def _group(items: Iterable[T], key: Callable[[T], Hashable]) -> list[list[T]]:
    """Items with equal keys together, in the order of their first."""
    groups: dict[Hashable, list[T]] = {}
    for item in items:
        groups.setdefault(key(item), []).append(item)
    return list(groups.values())


def _range(values: Iterable[float], digits: int = 4) -> str:
    """Least and greatest of the values that are numbers, in so many digits, or the one they all are."""
    numbers = [value for value in values if math.isfinite(value)]
    if not numbers:
        return "-"
    least, most = f"{min(numbers):.{digits}g}", f"{max(numbers):.{digits}g}"
    return least if least == most else f"{least} to {most}"


def _median(values: Iterable[float]) -> float:
    numbers = [value for value in values if math.isfinite(value)]
    return statistics.median(numbers) if numbers else math.nan


def show_inspection(report: "InspectionReport", recordings: "Sequence[Recording]", words: Callable[[str], str]) -> None:
    """Print the recordings of an inspection, and what is wrong with them in the `words` of their source."""
    each = len(recordings) <= MOST_ROWS
    if each:
        rows = [
            (item.recording_id, class_words(item.label),
             int(item.sample_rate) if item.sample_rate.is_integer() else item.sample_rate, round(item.duration, 3),
             channel.name, channel.minimum, channel.maximum, channel.rms, item.unit)
            for item in report.recordings
            for channel in item.channels
        ]  # fmt: skip
        header = ("recording", "class", "rate [Hz]", "length [s]", "channel", "least", "greatest", "rms", "unit")
        table(plural(len(recordings), "recording"), header, rows)
    else:
        _show_recording_summary(report.recordings, recordings)
    sentences = report.merged(by_kind=not each)
    for severity, text in sentences:
        say(f"{severity}: {words(text)}")
    if not sentences:
        say("Nothing suspicious was found.")


def _show_recording_summary(reports: "Sequence[RecordingReport]", recordings: "Sequence[Recording]") -> None:
    from swashtwin.recordings import condition_words, stated_angular_speed, stated_pressure

    words = condition_words(
        [recording.recording_id for recording in recordings],
        [stated_angular_speed(recording) for recording in recordings],
        [stated_pressure(recording) for recording in recordings],
    )
    rows = []
    for group in _group(zip(reports, words, strict=True), lambda pair: (pair[0].label, pair[1])):
        members = [report for report, _ in group]
        channels = [channel for report in members for channel in report.channels]
        rows.append((
            class_words(members[0].label), group[0][1], len(members),
            _range((report.sample_rate for report in members), 6), _range(report.duration for report in members),
            min(channel.minimum for channel in channels), max(channel.maximum for channel in channels),
            _range(channel.rms for channel in channels), ", ".join(dict.fromkeys(report.unit for report in members)),
        ))  # fmt: skip
    header = ("class", "condition", "recordings", "rate [Hz]", "length [s]", "least", "greatest", "rms", "unit")
    table(f"{plural(len(reports), 'recording')} by class and condition (--json has each)", header, rows)


def show_check(check: "DataCheck") -> None:
    """Print whether recordings are sound and enough, and why."""
    say(check.answer)
    labels = list(dict.fromkeys(count.label for count in check.counts))
    conditions = list(dict.fromkeys(count.condition for count in check.counts))
    counts = {(count.label, count.condition): count for count in check.counts}
    rows = []
    for label in labels:
        cells = [counts.get((label, condition)) for condition in conditions]
        specimens = {name for cell in cells if cell for name in cell.specimens}
        rows.append((class_words(label), *(cell.recordings if cell else 0 for cell in cells), len(specimens)))
    if rows:
        names = (condition if condition != "-" else "condition not stated" for condition in conditions)
        table("Recordings by class and condition", ("class", *names, "specimens"), rows)
    for use in check.uses:
        say(f"{_STATES[use.state]}: {use.name}: {use.reason}")
    for severity, text in check.inspection.merged(by_kind=True):
        say(f"{severity}: {text}")
    for copy in check.copies:
        say(f"error: {copy.again.recording_id}, {copy.again.channel} is a copy of {copy.first.recording_id}; use one.")
    for label, condition in check.gaps:
        say(f"warning: {class_words(label)} was not measured at {condition}.")
    for text in check.notes:
        say(f"note: {text}")


def confidence_advice(fitted: "FittedClassifier") -> str:
    """How to calibrate the confidence of a training."""
    from swashtwin.learning import allowed_error_rate, validation_share

    if fitted.choice is not None:
        return f"that takes a trial: {fitted.choice.reason or 'no class has two recordings to compare'}"
    n_recordings = len(fitted.manifest)
    share, count = validation_share(n_recordings)
    if count < 2:
        return f"that takes more recordings than the {n_recordings} it was trained on"
    allowed = allowed_error_rate(count, 0.1)
    rate = "" if allowed == 0.1 else f" --error-rate {allowed:g}"
    return (
        "train without --network calibrates it on the recordings it trains on; "
        f"--validation-fraction {share:g}{rate} holds back about {count} of the "
        f"{plural(n_recordings, 'recording')} for it"
    )


def show_medians(rows: "Sequence[Row]", values: list[list[float]], names: list[str]) -> None:
    """Print the median of each indicator by class, condition and channel."""
    entries = zip(rows, _words(rows), values, strict=True)
    medians: list[tuple[object, ...]] = []
    for group in _group(entries, lambda entry: (entry[0].label, entry[1], entry[0].channel)):
        first, condition, _ = group[0]
        columns = zip(*(numbers for _, _, numbers in group), strict=True)
        medians.append((class_words(first.label), condition, first.channel, len(group), *map(_median, columns)))
    header = ("class", "condition", "channel", "recordings", *names)
    table(f"{len(rows)} rows, medians by class and condition (--out or --json has each)", header, medians)


def show_trend(trend: "Trend") -> None:
    """Print each recording of a trend, or how many lie within their baseline."""
    factor, unit = trend.indicator.shown
    name, title = f"{trend.indicator.name} [{unit or '1'}]", f"{trend.indicator.name} of {trend.channel}"
    rows: list[tuple[object, ...]] = []
    if len(trend.points) <= MOST_ROWS:
        for point in trend.points:
            shown = (factor * value for value in (point.value, point.median, point.spread))
            rows.append((point.row.recording_id, class_words(point.row.label), *shown, point.count, point.status))
        table(title, ("recording", "class", name, "baseline", "spread", "healthy", "status"), rows)
        return
    words = _words([point.row for point in trend.points])
    for group in _group(zip(trend.points, words, strict=True), lambda pair: (pair[0].row.label, pair[1])):
        points = [point for point, _ in group]
        counts = [sum(point.status == status for point in points) for status in _STATUS]
        values, medians = (_range(factor * getattr(point, part) for point in points) for part in ("value", "median"))
        rows.append((class_words(points[0].row.label), group[0][1], len(points), values, medians, *counts))
    header = ("class", "condition", "recordings", name, "baseline", *_STATUS)
    table(f"{title} by class and condition (--json has each)", header, rows)
    distances = {point.row.recording_id: abs(point.value - point.median) / point.spread for point in trend.flagged}
    furthest = sorted(distances, key=lambda name: -distances[name])[:_FURTHEST]
    if furthest:
        say(f"Furthest off: {', '.join(f'{name} ({distances[name]:.3g} spreads)' for name in furthest)}")


def _words(rows: "Sequence[Row]") -> list[str]:
    from swashtwin.recordings import condition_words

    return condition_words(
        [row.recording_id for row in rows], [row.speed for row in rows], [row.pressure for row in rows]
    )
