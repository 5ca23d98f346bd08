"""Commands that end a user's work: diagnose, report."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from swashtwin.cli.console import note, note_merged, say, table, tell, with_bar
from swashtwin.cli.detecting import diagnose_anomalies
from swashtwin.cli.exits import NO_VERDICT, require_files
from swashtwin.cli.options import (
    Json,
    ModelFile,
    Reading,
    Sources,
    as_folder,
    reads_files,
)
from swashtwin.cli.pages import Report, write_page
from swashtwin.cli.prior import diagnose_with_prior
from swashtwin.cli.sources import load_distinct
from swashtwin.cli.summaries import confidence_advice
from swashtwin.foundation import plural

if TYPE_CHECKING:
    from collections.abc import Sequence

    from swashtwin.diagnosis import Diagnosis

EXPLAINED = 10
"""Recordings whose evidence a report shows; each costs some hundred passes through the network."""


@reads_files
def diagnose(
    model: ModelFile,
    paths: Sources,
    reading: Reading,
    error_rate: Annotated[
        float | None,
        typer.Option(help="Of the prediction sets and of calling unknown, or of false alarms; the model's by default."),
    ] = None,
    pistons: Annotated[int | None, typer.Option(min=1, help="Number of pistons, to name their lines.")] = None,
    report: Report = None,
    as_json: Json = False,
) -> None:
    """Name the class of each recording, or whether it deviates, and what to know before trusting it.

    The exit code is 4 if a recording has no verdict, because it cannot be used or a number is not finite.
    """
    import swashtwin.diagnosis as diagnosis

    classifier = diagnosis.load_model(model)
    recordings = load_distinct(paths, **reading)
    if isinstance(classifier, diagnosis.PriorClassifier):
        diagnose_with_prior(classifier, model, recordings, report, as_json)
        return
    if isinstance(classifier, diagnosis.AnomalyDetector):
        diagnose_anomalies(classifier, model, recordings, error_rate, report, as_json)
        return
    verdicts = [
        classifier.diagnose(recording, error_rate=error_rate) for recording in with_bar(recordings, "diagnosing")
    ]
    if pistons is not None:
        verdicts = [replace(verdict, facts=replace(verdict.facts, pistons=pistons)) for verdict in verdicts]
    page, evidence = None, []
    if report is not None:
        pairs = [pair for pair in zip(recordings[:EXPLAINED], verdicts, strict=False) if pair[1].label is not None]
        evidence = [
            diagnosis.explain(classifier.fitted_, recording, verdict, pistons=pistons)
            for recording, verdict in with_bar(pairs, "collecting evidence")
        ]
        by_id = {item.recording_id: item for item in evidence}
        items = [item for verdict in verdicts for item in (verdict, by_id.get(verdict.recording_id))]
        page = write_page(report, *(item for item in items if item is not None), about={"Model": model})

    def show() -> None:
        _show_verdicts(verdicts, len(classifier.fitted_.manifest))
        _note_reasons(verdicts)
        if report is not None and len(verdicts) > EXPLAINED:
            note(f"note: evidence is shown for the first {EXPLAINED} recordings only.")
        if page is not None:
            say(str(page))

    result = {"model": model, "diagnoses": [verdict.to_dict() for verdict in verdicts], "report": page}
    tell({**result, "evidence": [item.to_dict() for item in evidence]}, as_json, show)
    if any(verdict.label is None for verdict in verdicts):
        raise typer.Exit(NO_VERDICT)


def _note_reasons(verdicts: "Sequence[Diagnosis]") -> None:
    for verdict in verdicts:
        if verdict.no_verdict is not None:
            note(f"no verdict on {verdict.recording_id}: {verdict.no_verdict}")
    note_merged([(verdict.recording_id, text) for verdict in verdicts for text in verdict.notes])


def _show_verdicts(verdicts: "Sequence[Diagnosis]", n_trained: int) -> None:
    rows: list[tuple[object, ...]] = []
    for verdict in verdicts:
        trust = verdict.trust
        could_be = "" if trust is None else "unknown" if trust.unknown else ", ".join(trust.prediction_set)
        if verdict.label is None:
            rows.append((verdict.recording_id, "no verdict", None, None, ""))
        else:
            highest = max(verdict.probabilities.values())
            rows.append((verdict.recording_id, verdict.label, highest, f"{verdict.agreement:.0%}", could_be))
    calibrated = all(verdict.trust is not None or verdict.label is None for verdict in verdicts)
    header = ("recording", "class", "probability", "share of windows that agree", "could be")
    columns = len(header) if calibrated else len(header) - 1
    table(plural(len(rows), "recording"), header[:columns], [row[:columns] for row in rows])
    if not calibrated:
        note(f"note: the model's confidence is not calibrated; {confidence_advice(n_trained)}.")


def report(
    sources: Annotated[list[Path], typer.Argument(metavar="FILE...", help="Calibrations and models.")],
    out: Annotated[Path, typer.Option(help="Folder for report.html, its figures and their data.", callback=as_folder)],
    as_json: Json = False,
) -> None:
    """Write one page of saved calibrations and models.

    The page of a diagnosis comes from swashtwin diagnose --report.
    """
    from swashtwin.calibration import load_calibration
    from swashtwin.diagnosis import load_model
    from swashtwin.report import write_report

    require_files(sources)
    items: list[Any] = [
        load_model(path) if path.suffix == ".safetensors" else load_calibration(path) for path in sources
    ]
    page = write_report(*items, folder=out, about={"File": ", ".join(path.name for path in sources)})
    tell({"report": page, "sources": sources}, as_json, lambda: say(f"Report: {page}"))
