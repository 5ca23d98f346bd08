"""The command that looks recordings over: inspect."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from swashtwin.cli.console import say, table, tell
from swashtwin.cli.exits import BAD_DATA
from swashtwin.cli.options import CalibrationFactor, Channels, Json, SampleRate, Unit, given
from swashtwin.cli.recordings import load_all
from swashtwin.cli.summaries import MOST_ROWS, All, condition_words, grouped, spread_of

if TYPE_CHECKING:
    from swashtwin.recordings import InspectionReport, Recording, RecordingReport


def inspect(
    paths: Annotated[list[Path], typer.Argument(metavar="FILE|INDEX...", help="Files, indexes, or folders with one.")],
    sample_rate: SampleRate = None,
    unit: Unit = None,
    calibration_factor: CalibrationFactor = None,
    channels: Channels = None,
    show_all: All = False,
    as_json: Json = False,
) -> None:
    """Name what is wrong with recordings before they are used. Exit code 3 where something must not be used."""
    from swashtwin.recordings import inspect_recordings

    facts = given(sample_rate=sample_rate, unit=unit, channels=channels, calibration_factor=calibration_factor)
    recordings = load_all(paths, **facts)
    report = inspect_recordings(recordings)
    few = show_all or len(recordings) <= MOST_ROWS

    def show() -> None:
        if few:
            _show_each(report.recordings)
        else:
            _show_summary(report.recordings, recordings)
        _show_findings(report, few)

    tell({**report.to_dict(), "has_errors": report.has_errors}, as_json, show)
    if report.has_errors:
        raise typer.Exit(BAD_DATA)


def _show_each(reports: "tuple[RecordingReport, ...]") -> None:
    rows = [
        (one.recording_id, one.label, one.sample_rate, round(one.duration, 3), channel.name, channel.minimum,
         channel.maximum, channel.rms, one.unit)
        for one in reports
        for channel in one.channels
    ]  # fmt: skip
    header = ("recording", "class", "rate [Hz]", "length [s]", "channel", "least", "greatest", "rms", "unit")
    table(f"{len(reports)} recordings", header, rows)


def _show_summary(reports: "tuple[RecordingReport, ...]", recordings: "list[Recording]") -> None:
    from swashtwin.recordings import stated_pressure, stated_speed

    ids = [one.recording_id for one in recordings]
    speeds = [stated_speed(one) for one in recordings]
    words = condition_words(
        ids,
        [math.nan if speed is None else 2 * math.pi * speed for speed in speeds],
        [stated_pressure(one) for one in recordings],
    )
    rows = []
    for group in grouped(zip(reports, words, strict=True), lambda pair: (pair[0].label, pair[1])):
        own = [report for report, _ in group]
        channels = [channel for report in own for channel in report.channels]
        rows.append(
            (
                own[0].label, group[0][1], len(own), spread_of((one.sample_rate for one in own), 6),
                spread_of(one.duration for one in own), min(one.minimum for one in channels),
                max(one.maximum for one in channels), spread_of(one.rms for one in channels),
                ", ".join(dict.fromkeys(one.unit for one in own)),
            )
        )  # fmt: skip
    header = ("class", "condition", "recordings", "rate [Hz]", "length [s]", "least", "greatest", "rms", "unit")
    table(f"{len(reports)} recordings by class and condition (--all shows each)", header, rows)


def _show_findings(report: "InspectionReport", few: bool) -> None:
    found = [(one.recording_id, finding) for one in report.recordings for finding in one.findings]
    together = [("all", finding) for finding in report.findings]
    groups = [[pair] for pair in found] if few else grouped(found, lambda pair: (pair[1].severity, pair[1].kind))
    for group in [*groups, *([pair] for pair in together)]:
        name, finding = group[0]
        others = len({other for other, _ in group}) - 1
        more = f" ({finding.kind} in {others} more recordings: --all)" if others else ""
        say(f"{finding.severity}: {name}{', ' + finding.channel if finding.channel else ''}: {finding.message}{more}")
    if not groups and not together:
        say("Nothing suspicious was found.")
