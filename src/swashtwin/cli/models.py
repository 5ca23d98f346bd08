"""Commands of saved models: evaluate, model export, adapt and library, and twin prior."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from swashtwin.cli.console import (
    format_label,
    print_merged_notes,
    print_note,
    print_result,
    print_table,
    print_text,
    progress,
)
from swashtwin.cli.options import (
    Cluster,
    Index,
    Json,
    ModelFile,
    PumpName,
    Seed,
    require_index,
)
from swashtwin.cli.outputs import (
    Force,
    Report,
    describe_model_file,
    require_output,
    require_page,
    write_page,
)
from swashtwin.foundation import InputError, plural, shell_command

if TYPE_CHECKING:
    from swashtwin.diagnosis import AlarmScores, ChangeLibrary, Exclusion, LibraryPump
    from swashtwin.learning import ConfidenceScores, Scores
    from swashtwin.recordings import Recording

_LIBRARY_KIND = "change library"

# Virtual pumps up to which starting further processes takes longer than it saves.
_MAX_PUMPS_IN_ONE_PROCESS = 200

# Scores that are printed; `--json` prints all.
_SCORE_NAMES = (
    "accuracy",
    "recording_accuracy",
    "macro_recall",
    "macro_f1",
    "g_mean",
    "g_mean_laplace",
    "false_alarm_rate",
    "missed_fault_rate",
    "macro_auroc",
    "calibration_error",
)


def evaluate(
    model: ModelFile,
    source: Index,
    report: Report = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Score a model on the recordings of an index that it was not trained on."""
    from swashtwin.diagnosis import FaultClassifier, evaluate_model, load_model
    from swashtwin.learning import Scores
    from swashtwin.recordings import load_recordings

    require_page(report, inputs=[model, source], force=force)
    trained = load_model(model)
    with progress("evaluating") as bar:
        evaluation = evaluate_model(trained, load_recordings(source), bar)

    scores = evaluation.scores
    confidence = evaluation.confidence
    for exclusion in evaluation.excluded:
        _print_exclusion(exclusion)
    page = write_page(
        report,
        scores,
        recordings=evaluation.recordings,
        about={
            "Model": describe_model_file(model),
            "Test": source,
            **_count_excluded(evaluation.excluded),
        },
    )

    def show() -> None:
        if isinstance(scores, Scores):
            _print_scores(scores, confidence)
        else:
            _print_alarm_scores(scores)
        if page is not None:
            print_text(str(page))

    result: dict[str, Any] = {
        "model": model,
        "recordings": [recording.recording_id for recording in evaluation.recordings],
        "excluded": [exclusion.to_dict() for exclusion in evaluation.excluded],
        **scores.to_dict(),
    }
    if isinstance(trained, FaultClassifier):
        result["confidence"] = None if confidence is None else confidence.to_dict()
    print_result({**result, "report": page}, as_json, show)


def _print_exclusion(exclusion: "Exclusion") -> None:
    """Print which recordings were not scored for one reason."""
    from swashtwin.recordings import describe_copies, join_names

    recordings = exclusion.recordings
    count = plural(len(recordings), "recording")
    line = f"excluded: {count} {exclusion.description}"
    if exclusion.reason == "untrained class":
        line += f", {', '.join(map(format_label, sorted(set(recordings.values()))))}"
    print_note(f"{line} ({join_names(list(recordings))}).")

    if exclusion.reason == "in training":
        copies = {name: trained for name, trained in recordings.items() if name != trained}
        if copies:
            print_note(f"excluded: {describe_copies(copies)} had a part in the training.")
    if exclusion.reason == "unusable":
        # Without the recording's name in each reason, equal reasons are one line.
        reasons = [
            (name, detail.removeprefix(name).lstrip(" ,:")) for name, detail in recordings.items()
        ]
        print_merged_notes(reasons, "excluded")


def _count_excluded(excluded: "Sequence[Exclusion]") -> dict[str, str]:
    """Return the fact of a page on what was not scored; empty if all recordings were."""
    counts = [f"{len(exclusion.recordings)} {exclusion.description}" for exclusion in excluded]
    return {"Not scored": "; ".join(counts)} if counts else {}


def _print_alarm_scores(scores: "AlarmScores") -> None:
    header = [
        "class",
        "recordings",
        "no verdict",
        "alarms",
        "alarm rate",
        "95 % interval",
        "AUROC against healthy",
    ]
    rows: list[list[object]] = []
    for score in scores.classes:
        low, high = score.interval
        rows.append(
            [
                format_label(score.label),
                score.n_recordings,
                score.n_no_verdict,
                score.n_alarms,
                score.alarm_rate,
                f"{low:.2f} to {high:.2f}",
                score.auroc,
            ]
        )

    # Only a model without an error rate, the pump prior, names faults.
    title = "Alarms"
    if scores.error_rate is None:
        header.append("correct")
        for row, score in zip(rows, scores.classes, strict=True):
            row.append(score.n_correct)
    else:
        title += f" at a false-alarm rate of {scores.error_rate:g}"
    print_table(title, header, rows)

    reasons = dict.fromkeys(score.no_verdict for score in scores.classes if score.no_verdict)
    for reason in reasons:
        labels = [
            format_label(score.label) for score in scores.classes if score.no_verdict == reason
        ]
        print_note(f"note: no verdict on recordings of {', '.join(labels)}: {reason}")


def _score_title(name: str) -> str:
    return name.replace("ece_", "calibration_error_").removeprefix("n_").replace("_", " ")


def _print_scores(scores: "Scores", confidence: "ConfidenceScores | None") -> None:
    windows = plural(scores.n_windows, "window")
    recordings = plural(scores.n_recordings, "recording")
    denominators = {
        "accuracy": f"of {windows}",
        "recording_accuracy": f"of {recordings}",
    }
    rows = []
    for name in _SCORE_NAMES:
        remarks = (denominators.get(name, ""), scores.reasons.get(name, ""))
        remark = "; ".join(text for text in remarks if text)
        rows.append((_score_title(name), getattr(scores, name), remark))
    print_table(
        f"{windows} of {recordings}, split {scores.split or 'not specified'}",
        ("score", "value", ""),
        rows,
    )
    low, high = scores.accuracy_interval
    print_text(f"95 % interval of the accuracy, over recordings: {low:.3f} to {high:.3f}")

    labels = [format_label(name) for name in scores.classes]
    columns = list(labels)
    if scores.confusion.shape[1] > len(labels):
        columns.append("no verdict")
    print_table(
        "Windows by true class (rows) and predicted class (columns)",
        ("", *columns),
        [(label, *map(int, row)) for label, row in zip(labels, scores.confusion, strict=True)],
    )

    if confidence is None:
        return
    figures = [
        (_score_title(name), value)
        for name, value in confidence.to_dict().items()
        if isinstance(value, int | float)
    ]
    print_table("Confidence, by recording", ("score", "value"), figures)
    if confidence.unknown:
        from swashtwin.recordings import join_names

        print_note(
            f"diagnose would report {confidence.called_unknown:.0%} of these recordings as "
            f"unknown ({join_names(confidence.unknown)}); the scores count the most probable class "
            "of each instead."
        )


def export(
    model: ModelFile,
    out: Annotated[Path, typer.Option(help="ONNX file to write.")] = Path("model.onnx"),
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Write a classifier as an ONNX file, which runs without torch and without swashtwin."""
    from swashtwin.diagnosis import export_onnx, load_classifier

    require_output(out, suffixes=[".onnx"], inputs=[model], force=force)
    classifier = load_classifier(model)
    with progress("writing ONNX"):
        export_onnx(classifier, out)

    layout = classifier.layout
    network = classifier.network
    result = {
        "model": out,
        "network": network.name,
        "classes": classifier.classes,
        "channels": layout.channels,
        "length": layout.length,
        "sample_rate": layout.sample_rate,
        "unit": layout.unit,
        "normalization": classifier.normalization.kind,
    }

    def show() -> None:
        shape = f"(any, {len(layout.channels)}, {layout.length})"
        inputs = f"windows {shape} in {layout.unit} at {layout.sample_rate:g} Hz"
        if network.uses_speed:
            inputs += ", speed (any) in rad/s"
            if network.settings.get("turns"):
                inputs += ", NaN if unknown"
        print_text(f"{out}: {inputs}; returns one probability per class")
        if classifier.recordings is not None:
            print_note(
                "note: the file holds only the part for short windows; diagnose also uses a part "
                "for whole recordings."
            )

    print_result(result, as_json, show)


def prior(
    out: Annotated[Path, typer.Option(help="Model file to write.")] = Path("prior.safetensors"),
    pump: PumpName = "25scy14-1b",
    count: Annotated[
        int,
        typer.Option(
            min=10, help="Number of virtual pumps; 2000 take about 4 minutes on one core."
        ),
    ] = 2_000,
    seed: Seed = 0,
    cluster: Cluster = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Train a pump prior on virtual pumps of a design, simulated with every fault.

    model adapt then adapts the prior to a machine.
    """
    from swashtwin.diagnosis import make_prior
    from swashtwin.foundation import use_cluster
    from swashtwin.pump import load_pump
    from swashtwin.synthesis import PumpPrior, operating_range, simulate_changes

    require_output(out, suffixes=[".safetensors"], inputs=[Path(pump)], force=force)
    distribution = PumpPrior(pump=load_pump(pump))
    speed, pressure = operating_range(distribution.pump, distribution)
    n_jobs = -1 if count > _MAX_PUMPS_IN_ONE_PROCESS else 1
    with use_cluster(cluster), progress("simulating virtual pumps") as bar:
        changes = simulate_changes(distribution, count, seed=seed, jobs=n_jobs, progress=bar)

    model = make_prior(
        changes.change,
        changes.label,
        changes.pump,
        changes.scatter,
        changes.has_own_drawing,
        pump=distribution.pump,
        speed=speed,
        pressure=pressure,
    )
    model.save(out)
    n_pumps = len(changes.has_own_drawing)

    def show() -> None:
        print_text(f"{out}: {model!r}")
        if n_pumps < count:
            print_note(
                f"note: {plural(count - n_pumps, 'pump')} excluded: the chamber pressures did not "
                "converge."
            )
        print_text(f"Next: {shell_command('model', 'adapt', out, 'HEALTHY')}")

    result = {
        "model": out,
        "pump": model.pump,
        "pumps": n_pumps,
        "classes": model.classes,
        "seed": seed,
    }
    print_result(result, as_json, show)


def adapt(
    design: Annotated[
        str,
        typer.Argument(
            metavar="PRIOR", help="Shipped pump prior (25scy14-1b), or file written by twin prior."
        ),
    ],
    source: Index,
    out: Annotated[Path, typer.Option(help="Model file to write.")] = Path("pump.safetensors"),
    pistons: Annotated[
        int | None,
        typer.Option(
            min=5, help="Number of pistons, if the machine is of another design than the prior's."
        ),
    ] = None,
    libraries: Annotated[
        list[Path] | None,
        typer.Option(
            "--library",
            metavar="LIBRARY",
            help="Measured faults of other machines, written by model library. Repeatable.",
        ),
    ] = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Adapt a pump prior to a machine, from its healthy recordings alone.

    Recordings of faults in the index improve the model further.
    """
    from swashtwin.diagnosis import (
        ChangeLibrary,
        PriorClassifier,
        fit_with_library,
        join_libraries,
    )
    from swashtwin.recordings import declared_faults, load_recordings

    libraries = libraries or []
    require_output(
        out,
        suffixes=[".safetensors"],
        inputs=[Path(design), source, *libraries],
        force=force,
    )
    if Path(design).is_dir() or Path(design).suffix == ".toml":
        raise InputError(
            f"{design} holds recordings, but the pump prior comes first: swashtwin model adapt "
            f"PRIOR {design}"
        )

    pump_prior = PriorClassifier.load(design)
    recordings = load_recordings(source)
    _require_piston_count(
        recordings,
        pump_prior.bands.piston_count if pistons is None else pistons,
        remedy="Specify {pistons}, or correct the speed of the recordings.",
    )
    n_unlabeled = sum(recording.label is None for recording in recordings)
    fault_of = declared_faults(source)
    use = None
    if libraries:
        joined = join_libraries([ChangeLibrary.load(path) for path in libraries])
        with progress("measuring band powers") as bar:
            model, use = fit_with_library(
                pump_prior, recordings, joined, pistons=pistons, fault_of=fault_of, progress=bar
            )
    else:
        with progress("measuring band powers") as bar:
            model = pump_prior.fit(recordings, pistons=pistons, fault_of=fault_of, progress=bar)
    model.save(out)
    result = {
        "model": out,
        "kind": "prior classifier",
        "prior": design,
        "pump": model.pump,
        "classes": model.classes,
        "healthy": len(model.specimen),
        "faults": dict(model.taught),
        "recordings": sorted(recording.recording_id for recording in recordings),
        "library": None if use is None else use.to_dict(),
    }

    def show() -> None:
        print_text(f"{out}: {model!r}")
        if use is not None:
            print_text(use.sentence)
            for note in use.notes:
                print_note(f"note: {note}")
        if n_unlabeled:
            print_note(
                f"note: {plural(n_unlabeled, 'recording')} without a class counted as healthy. "
                "Label or remove recordings of faults."
            )
        if pistons is None:
            print_note(
                f"note: faults were simulated for {model.pump}. For a pump of another design, "
                "specify --pistons."
            )
        print_text(f"Next: {shell_command('diagnose', out, 'FILE')}")

    print_result(result, as_json, show)


def _require_piston_count(
    recordings: "Sequence[Recording]", piston_count: int, *, remedy: str
) -> None:
    """Refuse a piston count that the lines of a machine contradict."""
    from swashtwin.calibration import require_piston_count

    for machine in dict.fromkeys(recording.specimen for recording in recordings):
        members = [recording for recording in recordings if recording.specimen == machine]
        require_piston_count(members, piston_count, remedy=remedy)


def library(
    sources: Annotated[
        list[Path],
        typer.Argument(
            metavar="INDEX|LIBRARY...",
            help="Indexes of labeled recordings of machines of one design, and libraries.",
        ),
    ],
    out: Annotated[Path, typer.Option(help="Library file to write.")] = Path("pumps.safetensors"),
    pump: PumpName = "25scy14-1b",
    specimens: Annotated[
        list[str] | None,
        typer.Option(
            "--specimen",
            help="Use only recordings of this machine from the indexes. Libraries are used as a "
            "whole. Repeatable.",
        ),
    ] = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Write how faults changed the vibration of machines, as numbers without waveforms.

    model adapt learns from it for machines of a similar design. Several libraries become one.
    """
    from swashtwin.diagnosis import join_libraries

    require_output(
        out,
        suffixes=[".safetensors"],
        inputs=[*sources, Path(pump)],
        force=force,
    )
    parts = []
    with progress("measuring band powers") as bar:
        for source in sources:
            parts.append(_read_library(source, pump, specimens or [], bar))
    joined = join_libraries(parts)
    machine_names = [member.name for member in joined.pumps]
    for name in specimens or []:
        if name not in machine_names:
            raise InputError(f"No source has the machine {name!r}.", field="specimen")
    joined.save(out)

    machines = [_describe_machine(member) for member in joined.pumps]

    def show() -> None:
        rows = []
        for machine in machines:
            counts = ", ".join(f"{format_label(name)} {n}" for name, n in machine["faults"].items())
            rows.append((machine["machine"], machine["pistons"], machine["healthy"], counts))
        header = ("machine", "pistons", "healthy", "recordings of faults")
        print_table(f"{out}: {plural(len(rows), 'machine')}", header, rows)
        arguments = ("model", "adapt", "PRIOR", "HEALTHY", "--library", out)
        print_text(f"Next: {shell_command(*arguments)}")

    print_result({"library": out, "machines": machines}, as_json, show)


def _describe_machine(member: "LibraryPump") -> dict[str, Any]:
    """Return what a library holds of a machine, without its numbers."""
    from swashtwin.foundation import to_table

    faults = dict.fromkeys(member.label)
    severities: dict[str, list[str]] = {label: [] for label in faults}
    for label, severity in zip(member.label, member.severity, strict=True):
        severities[label].append(severity)
    return {
        "machine": member.name,
        "pistons": member.nameplate.piston_count,
        "nameplate": to_table(member.nameplate),
        "channels": member.channels,
        "healthy": len(member.healthy),
        "faults": {label: member.label.count(label) for label in faults},
        "severities": severities,
    }


def _read_library(
    source: Path, pump: str, specimens: Sequence[str], bar: Callable[[int, int], None]
) -> "ChangeLibrary":
    """Return a saved library, or that of the recordings of an index."""
    from swashtwin.diagnosis import ChangeLibrary, measure_library
    from swashtwin.foundation import artifact_kind
    from swashtwin.pump import load_pump
    from swashtwin.recordings import declared_faults, load_recordings

    if artifact_kind(source) == _LIBRARY_KIND or source.suffix == ".safetensors":
        return ChangeLibrary.load(source)

    require_index(source)
    recordings = [
        recording
        for recording in load_recordings(source)
        if not specimens or recording.specimen in specimens
    ]
    if specimens and not recordings:
        names = " or ".join(map(repr, specimens))
        raise InputError(f"{source} has no recording of the machine {names}.", field="specimen")
    design = load_pump(pump)
    _require_piston_count(
        recordings,
        design.rotating_group.piston_count,
        remedy="Specify the design with {pump}, or correct the speed of the recordings.",
    )
    return measure_library(recordings, design, fault_of=declared_faults(source), progress=bar)
