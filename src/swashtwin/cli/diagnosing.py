"""Commands that answer a user's question: diagnose and report."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
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
    progress,
    require_existing,
)
from swashtwin.cli.options import (
    Cluster,
    Json,
    ModelFile,
    ReadingOptions,
    Sources,
    reads_files,
    require_index,
    without_none,
)
from swashtwin.cli.outputs import Force, Report, describe_model_file, require_page, write_page
from swashtwin.cli.sources import load_sources
from swashtwin.cli.training import confidence_advice
from swashtwin.foundation import plural

if TYPE_CHECKING:
    from swashtwin.diagnosis import Diagnosis, Evidence
    from swashtwin.foundation import DataError
    from swashtwin.learning import FittedClassifier
    from swashtwin.recordings import Recording

MAX_EXPLAINED = 10
"""Recordings whose evidence a report shows; each requires some hundred passes of the network."""

# Folders whose files a note names: a folder of recordings of faults among them is seen.
_MAX_LISTED_FOLDERS = 10

# Columns of the table, by kind of model.
_HEADERS = {
    "classifier": ("recording", "verdict", "probability", "agreeing windows", "prediction set"),
    "detector": ("recording", "verdict", "p-value", "largest change"),
    "prior": ("recording", "verdict", "probability"),
}


@reads_files
def diagnose(
    model: ModelFile,
    paths: Sources,
    reading_options: ReadingOptions,
    error_rate: Annotated[
        float | None,
        typer.Option(
            help="Target miscoverage of the prediction sets and rate of wrong unknowns, or "
            "false-alarm rate of an anomaly detector. Default: the model's."
        ),
    ] = None,
    healthy: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER|INDEX",
            help="Healthy recordings of the machine, with which a classifier compares. Recordings "
            "of other classes in it are ignored. All files of a folder without an index are "
            "healthy, except those to diagnose.",
            callback=require_index,
        ),
    ] = None,
    specimen: Annotated[
        str | None,
        typer.Option(help="Machine of the files, to compare with its healthy recordings."),
    ] = None,
    pistons: Annotated[
        int | None, typer.Option(min=1, help="Number of pistons, to name their lines.")
    ] = None,
    report: Report = None,
    cluster: Cluster = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Classify each recording, or flag it as anomalous.

    The exit code is 4 if a recording has no verdict, because it is unusable or a number is not
    finite.
    """
    from swashtwin.diagnosis import (
        FaultClassifier,
        compare_with_healthy,
        diagnose_recordings,
        load_model,
    )
    from swashtwin.foundation import use_cluster

    require_page(report, inputs=[model, *paths], force=force)
    trained = load_model(model)
    facts = reading_options | without_none(specimen=specimen)
    with use_cluster(cluster):
        recordings = load_sources(paths, **facts)
        if healthy is not None:
            healthy_recordings = _load_healthy(healthy, facts, recordings)
            with _naming_healthy(healthy):
                trained, recordings = compare_with_healthy(trained, healthy_recordings, recordings)
            for text in trained.notes_:
                print_note(f"note: {text}")

        with progress("diagnosing") as bar:
            verdicts = diagnose_recordings(trained, recordings, error_rate=error_rate, progress=bar)
    if pistons is not None:
        verdicts = [
            replace(verdict, facts=replace(verdict.facts, pistons=pistons)) for verdict in verdicts
        ]

    evidence: dict[str, Evidence] = {}
    if report is not None and isinstance(trained, FaultClassifier):
        evidence = _collect_evidence(trained.fitted_, recordings, verdicts)
    about = {"Model": describe_model_file(model)}
    page = write_page(report, *_page_parts(verdicts, evidence), about=about)

    def show() -> None:
        _print_verdicts(verdicts)
        if isinstance(trained, FaultClassifier) and trained.fitted_.confidence is None:
            advice = confidence_advice(trained.fitted_)
            print_note(f"note: the confidence of the model is not calibrated; {advice}.")
        _print_notes(verdicts)
        if evidence and len(verdicts) > MAX_EXPLAINED:
            print_note(f"note: evidence is shown for the first {MAX_EXPLAINED} recordings only.")
        if page is not None:
            print_text(str(page))

    result = {
        "model": model,
        "diagnoses": [verdict.to_dict() for verdict in verdicts],
        "report": page,
        "evidence": [part.to_dict() for part in evidence.values()],
    }
    print_result(result, as_json, show)
    if any(verdict.label is None for verdict in verdicts):
        raise typer.Exit(NO_VERDICT)


def _load_healthy(
    source: Path, facts: dict[str, Any], diagnosed: "Sequence[Recording]"
) -> "list[Recording]":
    """Load the recordings of an index, or the files of a folder without one.

    Nothing states that such a file is healthy, so that recordings to diagnose are left out, and a
    note names the files that are taken.

    Parameters
    ----------
    facts : facts of such files.
    diagnosed : recordings to diagnose.
    """
    from swashtwin.foundation import DataError
    from swashtwin.pump import is_healthy
    from swashtwin.recordings import INDEX_NAME, find_exact_copies, join_names

    if not source.is_dir() or (source / INDEX_NAME).is_file():
        with _naming_healthy(source):
            return load_sources([source])

    diagnosed_hashes = _content_hashes(diagnosed)
    with _naming_healthy(source):
        files = _find_recordings(source, facts)
        loaded = load_sources(files, **facts)
        copies = find_exact_copies(diagnosed_hashes, _content_hashes(loaded))
    if len(copies) == len(loaded):
        raise DataError(
            f"{source} has no file besides the recordings to diagnose.",
            field="healthy",
            remedy="Specify a folder or an index of healthy recordings for {healthy}.",
        )

    names_by_folder: dict[Path, dict[str, None]] = {}
    healthy = []
    for file, recording in zip(_files_of_recordings(files), loaded, strict=True):
        is_other_class = recording.label is not None and not is_healthy(recording.label)
        if recording.recording_id not in copies and not is_other_class:
            names_by_folder.setdefault(file.parent, {})[file.name] = None
            healthy.append(recording)

    folders = [
        f"{join_names(list(names))} in {folder}" for folder, names in names_by_folder.items()
    ]
    if folders:
        print_note(f"note: taken as healthy: {join_names(folders, _MAX_LISTED_FOLDERS)}.")
    if copies:
        reason = "it is to be diagnosed" if len(copies) == 1 else "they are to be diagnosed"
        print_note(f"note: not taken as healthy, as {reason}: {join_names(list(copies))}.")
    return healthy


@contextmanager
def _naming_healthy(source: Path) -> Iterator[None]:
    """Put into errors that healthy recordings are meant, not those to diagnose.

    An error whose field is `healthy` states that already.
    """
    from swashtwin.foundation import SwashTwinError

    try:
        yield
    except SwashTwinError as cause:
        if cause.field == "healthy":
            raise
        raise cause.with_context(f"Healthy recordings in {source}: ") from cause


def _find_recordings(folder: Path, facts: dict[str, Any]) -> list[Path]:
    """Return the files of a folder that are recordings, by the rules by which it is indexed.

    A note names the others, such as event logs.
    """
    from swashtwin.foundation import DataError
    from swashtwin.recordings import INDEX_NAME, find_readable_files, find_side_files, join_names

    names = [file.relative_to(folder).as_posix() for file in find_readable_files(folder)]
    if not names:
        raise DataError(
            f"{folder} has neither an index ({INDEX_NAME}) nor a file that can be read.",
            field="healthy",
        )

    side_files = find_side_files(folder, names)
    if side_files:
        print_note(
            f"note: not taken as healthy: {join_names(side_files)}: text and few numbers, such as "
            "an event log or a device description."
        )

    files = [folder / name for name in names if name not in side_files]
    reasons = {}
    for file in files:
        cause = _opening_error(file, facts)
        if cause is not None:
            reasons[file] = cause
    if len(reasons) == len(files):
        raise reasons[files[0]]
    for cause in reasons.values():
        print_note(f"note: not taken as healthy: {cause.message}")
    return [file for file in files if file not in reasons]


def _opening_error(file: Path, facts: dict[str, Any]) -> "DataError | None":
    """Return why a file cannot be opened as a recording; None if it can."""
    from swashtwin.foundation import DataError, MissingFileError
    from swashtwin.recordings import Entry, is_store, open_raw

    if is_store(file):
        return None
    try:
        open_raw(file, Entry.from_mapping({"file": str(file), **facts}, str(file)).options)
    except MissingFileError:
        raise
    except DataError as cause:
        return cause
    return None


def _files_of_recordings(files: Sequence[Path]) -> list[Path]:
    """Return the file of each recording that `load_sources` loads; a store has several."""
    from swashtwin.recordings import is_store, load_recordings

    files_of_recordings = []
    for file in files:
        count = len(load_recordings(file)) if is_store(file) else 1
        files_of_recordings += [file] * count
    return files_of_recordings


def _content_hashes(recordings: "Sequence[Recording]") -> dict[str, tuple[str, ...]]:
    return {recording.recording_id: recording.content_hashes() for recording in recordings}


def _collect_evidence(
    classifier: "FittedClassifier",
    recordings: "Sequence[Recording]",
    verdicts: "Sequence[Diagnosis]",
) -> "dict[str, Evidence]":
    """Return what the first verdicts rest on, by recording; nothing if a network has no
    gradients.
    """
    from swashtwin.diagnosis import explain
    from swashtwin.foundation import DataError

    if not classifier.network.has_gradients:
        print_note(
            "note: the page shows no evidence for the verdicts: the network "
            f"{classifier.network.name} has no gradients."
        )
        return {}

    pairs = [
        (recording, verdict)
        for recording, verdict in zip(recordings[:MAX_EXPLAINED], verdicts, strict=False)
        if verdict.label is not None
    ]
    evidence = {}
    for recording, verdict in iterate_with_progress(pairs, "collecting evidence"):
        try:
            evidence[verdict.recording_id] = explain(classifier, recording, verdict)
        except DataError as cause:
            # Such as a file that was removed meanwhile; the verdicts remain valid.
            print_note(f"note: the page shows no evidence for {verdict.recording_id}: {cause}")
    return evidence


def _page_parts(
    verdicts: "Sequence[Diagnosis]", evidence: "Mapping[str, Evidence]"
) -> "Iterator[Diagnosis | Evidence]":
    """Yield each verdict, followed by its evidence."""
    for verdict in verdicts:
        yield verdict
        if verdict.recording_id in evidence:
            yield evidence[verdict.recording_id]


def _print_verdicts(verdicts: "Sequence[Diagnosis]") -> None:
    header = _HEADERS[verdicts[0].kind]
    rows = [_verdict_row(verdict) for verdict in verdicts]
    print_table(plural(len(verdicts), "recording"), header, rows)


def _verdict_row(verdict: "Diagnosis") -> tuple[object, ...]:
    """Return a diagnosis in the columns of its kind; an unknown recording has no further values."""
    if verdict.kind == "detector":
        answer = {True: "ALARM", False: "no alarm", None: "no verdict"}[verdict.alarm]
        largest_changes = verdict.largest_changes if verdict.alarm else ""
        return verdict.recording_id, answer, verdict.p_value, largest_changes

    if verdict.label is None or verdict.unknown:
        n_empty = len(_HEADERS[verdict.kind]) - 2
        return verdict.recording_id, verdict.verdict, *(None, "", "")[:n_empty]

    probability = verdict.probabilities[verdict.label]
    if verdict.kind == "prior" and len(verdict.candidates) > 1:
        names = " or ".join(map(format_label, verdict.candidates))
        return verdict.recording_id, f"not certain: {names}", probability
    row = (verdict.recording_id, format_label(verdict.label), probability)
    if verdict.kind == "prior":
        return row
    prediction_set = ", ".join(map(format_label, verdict.prediction_set))
    return *row, f"{verdict.agreement:.0%}", prediction_set


def _print_notes(verdicts: "Sequence[Diagnosis]") -> None:
    """Print why recordings are unknown or have no verdict, and the notes on each recording."""
    sentences = {
        verdict: verdict.sentence()
        for verdict in verdicts
        if verdict.label is None or verdict.unknown
    }
    # The recording's name precedes each line, so that it need not stand in the sentence too.
    print_merged_notes(
        [
            (verdict.recording_id, text.replace(f": {verdict.recording_id} ", ": it ", 1))
            for verdict, text in sentences.items()
        ]
    )

    notes: list[tuple[str, str]] = []
    for verdict in verdicts:
        sentence = sentences.get(verdict, "")
        notes += [(verdict.recording_id, text) for text in verdict.notes if text not in sentence]
    print_merged_notes(notes)


def report(
    sources: Annotated[
        list[Path], typer.Argument(metavar="FILE...", help="Calibrations and models.")
    ],
    out: Annotated[
        Path,
        typer.Option(
            help="Report to write: a folder for report.html and its data, or one .html file."
        ),
    ],
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Write one report page on saved calibrations and models.

    For the page of a diagnosis, use swashtwin diagnose --report.
    """
    from swashtwin.calibration import load_calibration
    from swashtwin.diagnosis import load_model
    from swashtwin.foundation import InputError

    require_existing(sources)
    for path in sources:
        if path.is_dir():
            raise InputError(f"{path} is a folder. Specify files of calibrations and models.")
    require_page(out, inputs=sources, force=force)

    results: list[Any] = []
    for path in sources:
        is_model = path.suffix == ".safetensors"
        results.append(load_model(path) if is_model else load_calibration(path))
    page = write_page(out, *results, about={"File": ", ".join(path.name for path in sources)})
    print_result(
        {"report": page, "sources": sources}, as_json, lambda: print_text(f"Report: {page}")
    )
