"""What train, evaluate and diagnose do where all training recordings are healthy: an anomaly detector."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from swashtwin.cli.console import note, note_merged, progress, say, table, tell, with_bar
from swashtwin.cli.exits import NO_VERDICT
from swashtwin.cli.pages import page_entry, write_page
from swashtwin.foundation import plural

if TYPE_CHECKING:
    from collections.abc import Sequence

    from swashtwin.diagnosis import AnomalyDetector, AnomalyVerdict
    from swashtwin.recordings import Recording, Recordings


def are_healthy(recordings: "Recordings") -> bool:
    """Whether every recording has a label that says that nothing is wrong."""
    from swashtwin.pump import is_healthy

    return bool(recordings) and all(is_healthy(label) for label in recordings.labels)


def train_detector(
    recordings: "Recordings",
    source: Path,
    out: Path,
    error_rate: float | None,
    as_json: bool,
    **others: Any,
) -> None:
    """Write a detector of deviations from healthy recordings.

    Parameters
    ----------
    others : options of train that belong to a classifier, by name; a wrong command line where one was given.
    """
    from swashtwin.diagnosis import AnomalyDetector

    for name, value in others.items():
        if value:
            raise typer.BadParameter(
                f"belongs to a classifier, and every recording of {source} is healthy, so train makes an anomaly "
                "detector from all of them; leave it out, or add recordings of a fault.",
                param_hint=f"--{name.replace('_', '-')}",
            )
    with progress("measuring levels") as bar:
        detector = AnomalyDetector.fit(recordings, error_rate=error_rate, progress=bar)
    detector.save(out)
    healthy = detector.healthy
    result = {
        "model": out, "kind": "anomaly detector", "recordings": sorted(detector.manifest),
        "operating_points": len(healthy.points), "levels": len(detector.layout.levels),
        "error_rate": detector.error_rate, "notes": detector.notes,
    }  # fmt: skip

    def show() -> None:
        points = plural(len(healthy.points), "operating point")
        say(
            f"{out}: anomaly detector from {plural(healthy.n_recordings, 'healthy recording')} at {points}, "
            f"{len(detector.layout.levels)} levels, false-alarm rate {detector.error_rate:g}"
        )
        for text in detector.notes:
            note(f"note: {text}")
        say(f"Next: swashtwin diagnose {out} FILE")

    tell(result, as_json, show)


def diagnose_anomalies(
    detector: "AnomalyDetector",
    model: Path,
    recordings: "Sequence[Recording]",
    error_rate: float | None,
    report: Path | None,
    as_json: bool,
) -> None:
    """Tell for each recording whether it deviates, and in what; exit code 4 if one has no verdict."""
    verdicts = [detector.diagnose(recording, error_rate=error_rate) for recording in with_bar(recordings, "diagnosing")]
    page = write_page(report, *verdicts, about={"Model": model})

    def show() -> None:
        rows = [
            (verdict.recording_id, _ANSWERS[verdict.alarm], verdict.p_value, _moved(verdict)) for verdict in verdicts
        ]
        rate = detector.error_rate if error_rate is None else error_rate
        title = f"{plural(len(rows), 'recording')}, false-alarm rate {rate:g}"
        table(title, ("recording", "verdict", "p-value", "what moved"), rows)
        for verdict in verdicts:
            if verdict.no_verdict is not None:
                note(f"no verdict on {verdict.recording_id}: {verdict.no_verdict}")
        note_merged([(verdict.recording_id, text) for verdict in verdicts for text in verdict.notes])
        if page is not None:
            say(str(page))

    result = {"model": model, "diagnoses": [verdict.to_dict() for verdict in verdicts], "report": page}
    tell(result, as_json, show)
    if any(verdict.alarm is None for verdict in verdicts):
        raise typer.Exit(NO_VERDICT)


_ANSWERS = {True: "ALARM", False: "no alarm", None: "no verdict"}


def _moved(verdict: "AnomalyVerdict") -> str:
    """The three levels that moved furthest, of an alarm."""
    changes = [change.sentence for change in verdict.changes[: 3 - len(verdict.shifts)]]
    return "; ".join((*verdict.shifts, *changes)) if verdict.alarm else ""


def evaluate_detector(
    detector: "AnomalyDetector",
    model: Path,
    recordings: "Recordings",
    ids: list[str] | None,
    report: Path | None,
    as_json: bool,
) -> None:
    """Print false alarms and alarms by class on the recordings that had no part in a detector."""
    from swashtwin.diagnosis import score_alarms
    from swashtwin.foundation import DataError
    from swashtwin.recordings import manifest_of, seen_recordings

    with progress("evaluating"):
        chosen = recordings.where(ids=ids) if ids else recordings
        seen = {} if ids else seen_recordings(detector.manifest, manifest_of(recordings))
        if len(seen) == len(chosen):
            raise DataError(f"all {plural(len(chosen), 'recording')} had a part in the detector; test on others.")
        test = [recording for recording in chosen if recording.recording_id not in seen]
        scores = score_alarms(detector, test)
    page = write_page(report, scores, recordings=test, about={"Model": model})
    if seen:
        note(f"left out: {plural(len(seen), 'recording')} that had a part in the detector.")

    def show() -> None:
        rows = [
            (
                item.label, item.n_recordings, item.n_no_verdict, item.n_alarms, item.share,
                f"{item.interval[0]:.2f} to {item.interval[1]:.2f}", item.auroc,
            )
            for item in scores.classes
        ]  # fmt: skip
        header = ("class", "recordings", "no verdict", "alarms", "share", "95 % interval", "AUROC against healthy")
        table(f"Alarms at a false-alarm rate of {scores.error_rate:g}", header, rows)

        if page is not None:
            say(str(page))

    names = [recording.recording_id for recording in test]
    tell({"model": model, "recordings": names, **scores.to_dict(), **page_entry(page)}, as_json, show)
