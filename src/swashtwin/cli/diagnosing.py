"""Commands that use a classifier: evaluate, diagnose."""

from itertools import zip_longest
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated

import typer

from swashtwin.cli.console import note, say, table, tell
from swashtwin.cli.exits import require_target
from swashtwin.cli.options import CalibrationFactor, Channels, Index, Json, Names, SampleRate, Seed, Unit, given
from swashtwin.cli.recordings import load_all

if TYPE_CHECKING:
    from swashtwin.diagnosis import Diagnosis, Evidence
    from swashtwin.learning import ConfidenceScores, Scores

EXPLAINED = 10
"""Recordings whose evidence a report shows; each costs some hundred passes through the network."""

Model = Annotated[Path, typer.Argument(help="Model file that train wrote.")]


def evaluate(
    model: Model,
    source: Index,
    level: Annotated[str | None, typer.Option(help="How far the test lies from the training: L0 to L5.")] = None,
    ids: Annotated[
        list[str] | None, typer.Option("--id", help="Recording to test on; repeatable. By default all that are unseen.")
    ] = None,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Score a classifier on the recordings of an index that had no part in it."""
    from swashtwin.diagnosis import load_classifier
    from swashtwin.learning import cut_windows, score_confidence, unseen_recordings
    from swashtwin.learning import evaluate as evaluation_of
    from swashtwin.recordings import load_recordings

    classifier = load_classifier(model)
    recordings = load_recordings(source)
    chosen = recordings.where(ids=ids) if ids else unseen_recordings(classifier, recordings)
    test = cut_windows(chosen, length=classifier.length, classes=classifier.classes, allow_partial_revolution=True)
    scores = evaluation_of(classifier, test, level=level, seed=seed)
    trusted = score_confidence(classifier, test) if classifier.confidence is not None else None
    names = [one.recording_id for one in chosen]
    if not ids and len(names) < len(recordings):
        note(f"{len(recordings) - len(names)} recordings had a part in the model and are left out.")
    result = {"model": model, "recordings": names, **scores.to_dict()}
    result["confidence"] = None if trusted is None else trusted.to_dict()

    def show() -> None:
        _show_scores(scores)
        if trusted is not None:
            _show_confidence(trusted)

    tell(result, as_json, show)


def diagnose(
    model: Model,
    paths: Annotated[list[Path], typer.Argument(metavar="FILE|INDEX...", help="Files, indexes, or folders with one.")],
    sample_rate: SampleRate = None,
    unit: Unit = None,
    calibration_factor: CalibrationFactor = None,
    channels: Channels = None,
    names: Names = None,
    error_rate: Annotated[
        float | None, typer.Option(help="Of the prediction sets and of calling unknown; the model's own by default.")
    ] = None,
    pistons: Annotated[int | None, typer.Option(min=1, help="Number of pistons, to name their lines.")] = None,
    report: Annotated[
        Path | None,
        typer.Option(help="Folder for report.html with its data, or one .html file: what each verdict rests on."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Name the class of each recording, and what a reader should know before trusting it."""
    from swashtwin.diagnosis import Evidence, explain, load_classifier
    from swashtwin.diagnosis import diagnose as diagnosis_of

    classifier = load_classifier(model)
    facts = given(
        sample_rate=sample_rate, unit=unit, channels=channels, names=names, calibration_factor=calibration_factor
    )
    recordings = load_all(paths, **facts)
    verdicts = [diagnosis_of(classifier, recording, error_rate=error_rate) for recording in recordings]
    page = None
    evidence: list[Evidence] = []
    if report is not None:
        if report.suffix == ".html":
            require_target(report)
        evidence = [
            explain(classifier, recording, verdict, pistons=pistons)
            for recording, verdict in zip(recordings[:EXPLAINED], verdicts, strict=False)
        ]
        pairs = zip_longest(verdicts, evidence)
        page = _page([one for pair in pairs for one in pair if one is not None], report)

    def show() -> None:
        _show_verdicts(verdicts)
        if report is not None and len(verdicts) > EXPLAINED:
            note(f"note: evidence is shown for the first {EXPLAINED} recordings only.")
        for one in verdicts:
            for text in one.notes:
                note(f"note: {one.recording_id}: {text}")
        if page is not None:
            say(str(page))

    result = {"model": model, "diagnoses": [one.to_dict() for one in verdicts], "report": page}
    tell({**result, "evidence": [one.to_dict() for one in evidence]}, as_json, show)


def _page(items: "list[Diagnosis | Evidence]", target: Path) -> Path:
    """Where the page was written: `target` itself where it is an HTML file, which needs no other."""
    from swashtwin.foundation import write_text
    from swashtwin.report import write_report

    if target.suffix != ".html":
        return write_report(*items, folder=target)
    with TemporaryDirectory() as folder:
        return write_text(target, write_report(*items, folder=folder).read_text(encoding="utf-8"))


def _show_verdicts(verdicts: "list[Diagnosis]") -> None:
    rows: list[tuple[object, ...]] = []
    for one in verdicts:
        trust = one.trust
        could_be = "" if trust is None else "unknown" if trust.unknown else ", ".join(trust.prediction_set)
        rows.append((one.recording_id, one.label, max(one.probabilities.values()), one.agreement, could_be))
    told = all(one.trust is not None for one in verdicts)
    header = ("recording", "class", "probability", "windows that agree", "could be")
    table(f"{len(rows)} recordings", header if told else header[:-1], rows if told else [row[:-1] for row in rows])
    if not told:
        note("note: the model was not taught how far to trust itself (train --validation-fraction 0.2).")


def _show_confidence(trusted: "ConfidenceScores") -> None:
    rows = [(name, value) for name, value in trusted.to_dict().items() if isinstance(value, int | float)]
    table("Trust in itself, by recording", ("figure", "value"), rows)


def _show_scores(scores: "Scores") -> None:
    names = ("accuracy", "recording_accuracy", "macro_recall", "macro_f1", "g_mean", "g_mean_laplace",
             "false_alarm_rate", "missed_fault_rate", "macro_auroc", "calibration_error")  # fmt: skip
    rows = [(name, getattr(scores, name), scores.reasons.get(name, "")) for name in names]
    title = f"{scores.n_windows} windows of {scores.n_recordings} recordings, level {scores.level or 'not stated'}"
    table(title, ("score", "value", ""), rows)
    low, high = scores.accuracy_interval
    say(f"95 % interval of the accuracy, by bootstrap over the recordings: {low:.3f} to {high:.3f}")
    counts = [(name, *(int(n) for n in row)) for name, row in zip(scores.classes, scores.confusion, strict=True)]
    table("Windows of each class (row) given each class (column)", ("", *scores.classes), counts)
