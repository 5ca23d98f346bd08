"""Commands of models beside training: evaluate, model export and adapt, twin prior."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from swashtwin.cli.console import (
    format_label,
    print_note,
    print_result,
    print_table,
    print_text,
    progress,
)
from swashtwin.cli.files import (
    Force,
    Report,
    artifact_marks,
    require_output,
    require_page,
    write_page,
)
from swashtwin.cli.options import Index, Json, ModelFile, PumpName, Seed
from swashtwin.foundation import InputError, plural

if TYPE_CHECKING:
    from swashtwin.diagnosis import AlarmScores
    from swashtwin.learning import ConfidenceScores, Scores


def evaluate(
    model: ModelFile,
    source: Index,
    report: Report = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Score a model on the recordings of an index that had no part in it."""
    import swashtwin.learning as learning
    from swashtwin.diagnosis import FaultClassifier, load_model
    from swashtwin.recordings import describe_copies, load_recordings

    require_page(report, inputs=[model, source], force=force)
    trained, recordings = load_model(model), load_recordings(source)
    confidence: ConfidenceScores | None = None
    scores: Scores | AlarmScores
    with progress("evaluating"):
        chosen, seen = learning.unseen_recordings(trained.manifest, recordings)
        if isinstance(trained, FaultClassifier):
            reference = trained.fitted_.training_reference
            split = None if reference is None else learning.split_between(reference, chosen)
            test = trained.cut_windows(chosen)
            scores = trained.evaluate(test, split=split)
            if trained.fitted_.confidence is not None:
                confidence = learning.score_confidence(trained.fitted_, test)
        else:
            scores = trained.evaluate(chosen)
    if seen:
        print_note(f"left out: {plural(len(seen), 'recording')} that had a part in the model.")
    for name, listed in seen.items():
        if name != listed:
            print_note(f"left out: {describe_copies({name: listed})} had a part in the model.")
    if synthetic := len(recordings) - len(chosen) - len(seen):
        print_note(f"left out: {plural(synthetic, 'synthetic recording')}.")
    page = write_page(report, scores, recordings=chosen, about={"Model": model, "Test": source})

    def show() -> None:
        if isinstance(scores, learning.Scores):
            _show_scores(scores, confidence)
        else:
            _show_alarms(scores)
        if page is not None:
            print_text(str(page))

    names = [recording.recording_id for recording in chosen]
    sure = (
        {"confidence": confidence and confidence.to_dict()}
        if isinstance(trained, FaultClassifier)
        else {}
    )
    print_result(
        {"model": model, "recordings": names, **scores.to_dict(), **sure, "report": page},
        as_json,
        show,
    )


def _show_alarms(scores: "AlarmScores") -> None:
    rows = [
        (format_label(item.label), item.n_recordings, item.n_no_verdict, item.n_alarms, item.alarm_rate,
         f"{item.interval[0]:.2f} to {item.interval[1]:.2f}", item.auroc, item.n_correct)
        for item in scores.classes
    ]  # fmt: skip
    header = (
        "class",
        "recordings",
        "no verdict",
        "alarms",
        "alarm rate",
        "95 % interval",
        "AUROC against healthy",
        "correct",
    )
    rate = "" if scores.error_rate is None else f" at a false-alarm rate of {scores.error_rate:g}"
    columns = len(header) if scores.error_rate is None else len(header) - 1
    print_table(f"Alarms{rate}", header[:columns], [row[:columns] for row in rows])
    for text in dict.fromkeys(item.no_verdict for item in scores.classes if item.no_verdict):
        classes = [format_label(item.label) for item in scores.classes if item.no_verdict == text]
        print_note(f"note: no verdict on recordings of {', '.join(classes)}: {text}")


def _name(score: str) -> str:
    return score.replace("ece_", "calibration_error_").removeprefix("n_").replace("_", " ")


def _show_scores(scores: "Scores", confidence: "ConfidenceScores | None") -> None:
    names = ("accuracy", "recording_accuracy", "macro_recall", "macro_f1", "g_mean", "g_mean_laplace",
             "false_alarm_rate", "missed_fault_rate", "macro_auroc", "calibration_error")  # fmt: skip
    rows = [(_name(name), getattr(scores, name), scores.reasons.get(name, "")) for name in names]
    count = plural(scores.n_recordings, "recording")
    title = (
        f"{plural(scores.n_windows, 'window')} of {count}, split {scores.split or 'not specified'}"
    )
    print_table(title, ("score", "value", ""), rows)
    low, high = scores.accuracy_interval
    print_text(f"95 % interval of the accuracy, over the recordings: {low:.3f} to {high:.3f}")
    classes = [format_label(name) for name in scores.classes]
    counts = [
        (name, *(int(n) for n in row)) for name, row in zip(classes, scores.confusion, strict=True)
    ]
    without = ("no verdict",) if scores.confusion.shape[1] > len(classes) else ()
    print_table(
        "Windows of each class (row) by predicted class (column)", ("", *classes, *without), counts
    )
    if confidence is None:
        return
    figures = confidence.to_dict().items()
    sure = [(_name(name), value) for name, value in figures if isinstance(value, int | float)]
    print_table("Confidence, by recording", ("figure", "value"), sure)
    if confidence.called_unknown > 0:
        print_note(
            f"diagnose would call {confidence.called_unknown:.0%} of these recordings unknown; the scores count the "
            "likeliest class of each, not that answer."
        )


def export(
    model: ModelFile,
    out: Annotated[Path, typer.Option(help="ONNX file to write.")] = Path("model.onnx"),
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Write a model as an ONNX file, which runs without torch and without swashtwin."""
    from swashtwin.diagnosis import export_onnx, load_classifier

    require_output(out, suffixes=[".onnx"], inputs=[model], own=["swashtwin"], force=force)
    classifier = load_classifier(model)
    with progress("writing ONNX"):
        export_onnx(classifier, out)
    layout = classifier.layout
    result = {
        "model": out, "network": classifier.network.name, "classes": classifier.classes,
        "channels": layout.channels, "length": layout.length, "sample_rate": layout.sample_rate,
        "unit": layout.unit, "normalization": classifier.normalization.kind,
    }  # fmt: skip

    def show() -> None:
        shape = f"(any, {len(layout.channels)}, {layout.length})"
        usual = ", NaN if unknown" if classifier.network.settings.get("turns") else ""
        speed = f", speed (any) in rad/s{usual}" if classifier.network.uses_speed else ""
        rate = f"{layout.sample_rate:g} Hz"
        print_text(
            f"{out}: windows {shape} in {layout.unit} at {rate}{speed}, to one probability per class"
        )
        if classifier.recordings is not None:
            print_note(
                "note: it holds the part on short windows alone; diagnose listens to whole recordings beside it."
            )

    print_result(result, as_json, show)


_FEW = 200
"""Virtual pumps for which no further processes are worth their start."""

_PRIOR = artifact_marks("prior classifier")


def prior(
    out: Annotated[Path, typer.Option(help="Model file to write.")] = Path("prior.safetensors"),
    pump: PumpName = "25scy14-1b",
    count: Annotated[
        int, typer.Option(min=10, help="Virtual pumps; 2,000 take about 4 minutes of a core.")
    ] = 2_000,
    seed: Seed = 0,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Simulate virtual pumps of a design with every fault, and train on them what model adapt
    adapts to a machine.
    """
    from swashtwin.diagnosis import make_prior
    from swashtwin.pump import load_pump
    from swashtwin.synthesis import PumpPrior, operating_range, simulate_changes

    require_output(out, suffixes=[".safetensors"], inputs=[Path(pump)], own=_PRIOR, force=force)
    drawing = PumpPrior(pump=load_pump(pump))
    speed, pressure = operating_range(drawing.pump, drawing)
    with progress("simulating virtual pumps") as bar:
        changes = simulate_changes(
            drawing, count, seed=seed, jobs=-1 if count > _FEW else 1, progress=bar
        )
    n_pumps = len(changes.drawn)
    model = make_prior(
        changes.change,
        changes.label,
        changes.pump,
        changes.scatter,
        changes.drawn,
        pump=drawing.pump,
        speed=speed,
        pressure=pressure,
    )
    model.save(out)

    def show() -> None:
        print_text(f"{out}: {model!r}")
        if n_pumps < count:
            print_note(
                f"note: {plural(count - n_pumps, 'pump')} had chamber pressures that do not converge."
            )
        print_text(f"Next: swashtwin model adapt {out} HEALTHY")

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
        str, typer.Argument(metavar="PRIOR", help="25scy14-1b, or a prior's file (twin prior).")
    ],
    source: Index,
    out: Annotated[Path, typer.Option(help="Model file to write.")] = Path("pump.safetensors"),
    pistons: Annotated[
        int | None,
        typer.Option(
            min=5, help="Pistons of the machine where it is of another design than the prior's."
        ),
    ] = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Adapt a pump prior to a machine, from healthy recordings alone; measured faults in the index
    teach it further.
    """
    from swashtwin.diagnosis import PriorClassifier
    from swashtwin.recordings import declared_faults, load_recordings

    require_output(
        out, suffixes=[".safetensors"], inputs=[Path(design), source], own=_PRIOR, force=force
    )
    if Path(design).is_dir() or Path(design).suffix == ".toml":
        raise InputError(
            f"{design} holds recordings; the prior stands first: swashtwin model adapt PRIOR {design}"
        )
    shipped, recordings = PriorClassifier.load(design), load_recordings(source)
    unlabeled = sum(recording.label is None for recording in recordings)
    with progress("measuring levels"):
        model = shipped.fit(recordings, pistons=pistons, fault_of=declared_faults(source))
    model.save(out)
    result = {
        "model": out, "kind": "prior classifier", "prior": design, "pump": model.pump, "classes": model.classes,
        "healthy": len(model.specimen), "faults": dict(model.taught), "recordings": sorted(model.manifest),
    }  # fmt: skip

    def show() -> None:
        print_text(f"{out}: {model!r}")
        if unlabeled:
            print_note(
                f"note: {plural(unlabeled, 'recording')} without a class counted as healthy; label or leave out faults."
            )
        if pistons is None:
            print_note(
                f"note: its faults were simulated for {model.pump}; of a pump of another design name the --pistons."
            )
        print_text(f"Next: swashtwin diagnose {out} FILE")

    print_result(result, as_json, show)
