"""Commands that end a user's work: diagnose, report."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from swashtwin.cli.console import (
    NO_VERDICT,
    format_label,
    iterate_with_progress,
    print_merged_notes,
    print_note,
    print_result,
    print_table,
    print_text,
    require_existing,
)
from swashtwin.cli.files import Force, Report, load_sources, require_page, write_page
from swashtwin.cli.options import Json, ModelFile, Reading, Sources, reads_files, require_index
from swashtwin.cli.training import confidence_advice
from swashtwin.foundation import plural

if TYPE_CHECKING:
    from swashtwin.diagnosis import Diagnosis, Evidence, FaultClassifier
    from swashtwin.learning import FittedClassifier
    from swashtwin.recordings import Recording

EXPLAINED = 10
"""Recordings whose evidence a report shows; each costs some hundred passes through the network."""


@reads_files
def diagnose(
    model: ModelFile,
    paths: Sources,
    reading: Reading,
    error_rate: Annotated[
        float | None,
        typer.Option(
            help="Of the prediction sets and of calling unknown, or of false alarms; the model's by default."
        ),
    ] = None,
    healthy: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER|INDEX",
            help="Healthy recordings of the machine, which a classifier then compares with; others in it are left out.",
            callback=require_index,
        ),
    ] = None,
    pistons: Annotated[
        int | None, typer.Option(min=1, help="Number of pistons, to name their lines.")
    ] = None,
    report: Report = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Name the class of each recording, or whether it deviates, and what to know before trusting
    it.

    The exit code is 4 if a recording has no verdict, because it cannot be used or a number is not
    finite.
    """
    from swashtwin.diagnosis import FaultClassifier, load_model

    require_page(report, inputs=[model, *paths], force=force)
    trained = load_model(model)
    recordings = load_sources(paths, **reading)
    if healthy is not None:
        trained, recordings = _compared(trained, healthy, recordings)
    rate: dict[str, Any] = {} if error_rate is None else {"error_rate": error_rate}
    verdicts = [
        trained.diagnose(recording, **rate)
        for recording in iterate_with_progress(recordings, "diagnosing")
    ]
    if pistons is not None:
        verdicts = [
            replace(verdict, facts=replace(verdict.facts, pistons=pistons)) for verdict in verdicts
        ]
    evidence = {}
    if report is not None and isinstance(trained, FaultClassifier):
        evidence = _evidence_of(trained.fitted_, recordings, verdicts)
    items = [
        item
        for verdict in verdicts
        for item in (verdict, evidence.get(verdict.recording_id))
        if item is not None
    ]
    page = write_page(report, *items, about={"Model": model})

    def show() -> None:
        print_table(
            plural(len(verdicts), "recording"),
            _HEADERS[verdicts[0].kind],
            [_row(verdict) for verdict in verdicts],
        )
        if isinstance(trained, FaultClassifier) and trained.fitted_.confidence is None:
            print_note(
                f"note: the model's confidence is not calibrated; {confidence_advice(trained.fitted_)}."
            )
        said = {
            verdict: verdict.sentence()
            for verdict in verdicts
            if verdict.label is None or verdict.unknown
        }
        print_merged_notes(
            [
                (item.recording_id, text.replace(f": {item.recording_id} ", ": it ", 1))
                for item, text in said.items()
            ]
        )
        pairs = ((verdict, text) for verdict in verdicts for text in verdict.notes)
        print_merged_notes(
            [
                (verdict.recording_id, text)
                for verdict, text in pairs
                if text not in said.get(verdict, "")
            ]
        )
        if evidence and len(verdicts) > EXPLAINED:
            print_note(f"note: evidence is shown for the first {EXPLAINED} recordings only.")
        if page is not None:
            print_text(str(page))

    result = {
        "model": model,
        "diagnoses": [verdict.to_dict() for verdict in verdicts],
        "report": page,
    }
    print_result(
        {**result, "evidence": [item.to_dict() for item in evidence.values()]}, as_json, show
    )
    if any(verdict.label is None for verdict in verdicts):
        raise typer.Exit(NO_VERDICT)


def _compared(
    trained: object, healthy: Path, recordings: "Sequence[Recording]"
) -> "tuple[FaultClassifier, list[Recording]]":
    """(the classifier that compares with healthy recordings, recordings to diagnose): where the
    healthy ones are of one machine, so are those that state none.
    """
    from swashtwin.diagnosis import FaultClassifier
    from swashtwin.foundation import InputError
    from swashtwin.pump import is_healthy

    if not isinstance(trained, FaultClassifier):
        raise typer.BadParameter("belongs to a classifier; leave it out.", param_hint="--healthy")
    reference = [
        item for item in load_sources([healthy]) if item.label is None or is_healthy(item.label)
    ]
    if not reference:
        raise InputError(f"{healthy} has no healthy recording; name a folder or an index that has.")
    names, compared = {item.specimen or "" for item in reference}, list(recordings)
    if len(names) == 1:
        name = names.pop() or "this machine"
        reference = [item.replace(specimen=name) for item in reference]
        compared = [item if item.specimen else item.replace(specimen=name) for item in compared]
    informed = trained.with_healthy(reference)
    for text in informed.notes_:
        print_note(f"note: {text}")
    return informed, compared


def _evidence_of(
    classifier: "FittedClassifier",
    recordings: Sequence["Recording"],
    verdicts: Sequence["Diagnosis"],
) -> dict[str, "Evidence"]:
    """What the first verdicts rest on, by recording; none of a network that has no gradients."""
    from swashtwin.diagnosis import explain
    from swashtwin.foundation import DataError

    if not classifier.network.has_gradients:
        print_note(
            f"note: the page says no lines that speak for a verdict, since {classifier.network.name} has no gradients."
        )
        return {}
    pairs = [
        pair
        for pair in zip(recordings[:EXPLAINED], verdicts, strict=False)
        if pair[1].label is not None
    ]
    evidence = {}
    for recording, verdict in iterate_with_progress(pairs, "collecting evidence"):
        try:
            evidence[verdict.recording_id] = explain(classifier, recording, verdict)
        except DataError as cause:  # such as a file that is gone meanwhile; the verdicts stay
            print_note(
                f"note: the page says no lines that speak for the verdict on {verdict.recording_id}: {cause}"
            )
    return evidence


_HEADERS = {
    "classifier": (
        "recording",
        "verdict",
        "probability",
        "share of windows that agree",
        "could be",
    ),
    "detector": ("recording", "verdict", "p-value", "what moved"),
    "prior": ("recording", "verdict", "probability"),
}


def _row(verdict: "Diagnosis") -> tuple[object, ...]:
    """A diagnosis in the columns of its kind; no class, share or alternative stands beside an
    unknown one.
    """
    if verdict.kind == "detector":
        answer = {True: "ALARM", False: "no alarm", None: "no verdict"}[verdict.alarm]
        return (
            verdict.recording_id,
            answer,
            verdict.p_value,
            verdict.largest_changes if verdict.alarm else "",
        )
    if verdict.label is None or verdict.unknown:
        return (
            verdict.recording_id,
            verdict.verdict,
            *(None, "", "")[: len(_HEADERS[verdict.kind]) - 2],
        )
    row = (verdict.recording_id, format_label(verdict.label), verdict.probabilities[verdict.label])
    if verdict.kind == "prior":
        return row
    return *row, f"{verdict.agreement:.0%}", ", ".join(map(format_label, verdict.prediction_set))


def report(
    sources: Annotated[
        list[Path], typer.Argument(metavar="FILE...", help="Calibrations and models.")
    ],
    out: Annotated[
        Path, typer.Option(help="Folder for report.html with its data, or one .html file.")
    ],
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Write one page of saved calibrations and models.

    The page of a diagnosis comes from swashtwin diagnose --report.
    """
    from swashtwin.calibration import load_calibration
    from swashtwin.diagnosis import load_model
    from swashtwin.foundation import InputError

    require_existing(sources)
    if folders := [path for path in sources if path.is_dir()]:
        raise InputError(
            f"{folders[0]} is a folder; report takes files of calibrations and models."
        )
    require_page(out, inputs=sources, force=force)
    items: list[Any] = [
        load_model(path) if path.suffix == ".safetensors" else load_calibration(path)
        for path in sources
    ]
    page = write_page(out, *items, about={"File": ", ".join(path.name for path in sources)})
    print_result(
        {"report": page, "sources": sources}, as_json, lambda: print_text(f"Report: {page}")
    )
