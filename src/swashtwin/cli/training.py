"""Commands that make and test a classifier: train, evaluate, model export."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from swashtwin.cli.console import note, progress, say, table, tell
from swashtwin.cli.detecting import are_healthy, evaluate_detector, train_detector
from swashtwin.cli.exits import require_files, require_target, resumable
from swashtwin.cli.options import (
    GroupName,
    Index,
    Json,
    ModelFile,
    Preset,
    PresetName,
    Seed,
    Window,
    defaults_of,
    read_settings,
)
from swashtwin.cli.summaries import confidence_advice
from swashtwin.foundation import plural

if TYPE_CHECKING:
    from swashtwin.learning import (
        ConfidenceScores,
        FittedClassifier,
        Scores,
        TrainingSettings,
        ValidationPlan,
        WindowSet,
    )
    from swashtwin.recordings import Manifest


_ERROR_RATE = 0.1
"""Error rate by default."""
_TEST_FRACTION = 0.2
"""Share held out by default."""


def train(
    source: Index,
    out: Annotated[Path, typer.Option(help="Model file to write.")] = Path("model.safetensors"),
    add: Annotated[
        list[Path] | None, typer.Option(help="Synthetic windows (swashtwin synthesize); repeatable.")
    ] = None,
    test_fraction: Annotated[
        float | None,
        typer.Option(min=0, max=0.5, help="Share held out for evaluate; 0.2 by default, 0 trains on all."),
    ] = None,
    validation_fraction: Annotated[
        float,
        typer.Option(
            min=0, max=0.5, help="Share of the rest that calibrates the model's confidence, by --group; 0 for none."
        ),
    ] = 0.0,
    error_rate: Annotated[
        float | None,
        typer.Option(
            help="Share of recordings whose prediction set may be wrong, or that are wrongly unknown; 0.1 by default, "
            "or the least that the validation recordings allow. Of healthy recordings alone: the false-alarm rate, "
            "0.05 by default."
        ),
    ] = None,
    group: GroupName = "recording",
    window: Window = 2048,
    window_stride: Annotated[
        int | None, typer.Option(help="Samples from window to window; its length by default.")
    ] = None,
    allow_partial_revolution: Annotated[
        bool, typer.Option("--allow-partial-revolution", help="Accept windows shorter than one turn of the shaft.")
    ] = False,
    network: Annotated[
        str | None, typer.Option(help="Name of the network; spectral_bitcn by default, the paper's is bitcn.")
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="NAME=VALUE",
            help="Any setting of the training or the network: epochs=60, noise_snr=5, hidden=256,128; repeatable.",
        ),
    ] = None,
    preset: PresetName = Preset.recommended,
    device: Annotated[str, typer.Option(help='"cpu", or a GPU such as "cuda".')] = "cpu",
    checkpoint: Annotated[Path | None, typer.Option(help="File saved after each epoch.")] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Continue from the checkpoint, if it exists.")] = False,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Train a classifier on an index's windows; whole recordings are held out, which evaluate then tests on.

    Where all recordings are healthy, it makes an anomaly detector with a stated false-alarm rate.
    """
    from swashtwin.diagnosis import save_classifier
    from swashtwin.foundation import DataError
    from swashtwin.learning import (
        build_network,
        check_disjoint,
        cut_windows,
        fit,
        learn_confidence,
        load_windows,
        plan_validation,
        require_enough,
        require_shared_speed,
        split_by_recording,
        without_overlap,
    )
    from swashtwin.recordings import (
        declared_classes,
        join_manifests,
        load_recordings,
        recording_groups,
        repeated_recordings,
        seen_recordings,
    )

    _require_checkpoint(checkpoint, resume)
    require_target(out)
    require_files(add or [])
    network_name, (network, recipe, shape) = network, _recipe(network, settings, preset, window)
    added = [load_windows(path) for path in add or ()]
    manifest = join_manifests([synthetic.manifest for synthetic in added])
    layout: dict[str, Any] = {"like": added[0]} if added else {"length": window}
    recordings = load_recordings(source)
    if not added and are_healthy(recordings):
        classifier_options = {
            "test_fraction": test_fraction, "validation_fraction": validation_fraction, "network": network_name,
            "set": settings, "checkpoint": checkpoint, "window_stride": window_stride,
        }  # fmt: skip
        train_detector(recordings, source, out, error_rate, as_json, **classifier_options)
        return
    test_fraction = _or_default(test_fraction, _TEST_FRACTION)
    _check_classes({*recordings.labels} | {name for synthetic in added for name in synthetic.classes}, source)
    groups = recording_groups(recordings, group)
    windows = cut_windows(
        recordings,
        classes=None if added else declared_classes(source),
        stride=window_stride,
        allow_partial_revolution=allow_partial_revolution,
        **layout,
    )
    training, held_out = windows, windows.subset(windows.target < -1)
    if test_fraction:
        training, held_out = split_by_recording(windows, test_fraction=test_fraction, seed=seed, group=groups)
    validation = None
    asked_rate = allowed_rate = _or_default(error_rate, _ERROR_RATE)
    if validation_fraction:
        n_left = len(training.recordings.keys() - seen_recordings(manifest, training.recordings).keys())
        plan = plan_validation(n_left, asked_rate, validation_fraction)
        try:
            training, validation = split_by_recording(
                training, test_fraction=plan.fraction, seed=seed, group=groups, keep_in_training=manifest
            )
        except DataError as cause:
            raise DataError(_no_validation(str(cause), group, test_fraction)) from cause
        validation = without_overlap(validation)
        count = len(set(validation.recording_id.tolist()))
        if error_rate is not None:
            require_enough(count, error_rate)
        allowed_rate = _told_error_rate(plan, validation_fraction, count, asked_rate)
    _refuse_seen(held_out, manifest)
    for name, first in repeated_recordings(windows.recordings).items():
        note(f"note: {name} holds the same samples as {first}; keep one of them, or it counts twice.")
    for synthetic in added:
        require_shared_speed(windows, synthetic)
        training = training + synthetic
    check_disjoint(training, held_out)
    hint = f"{checkpoint} holds the last whole epoch: the same command with --resume continues" if checkpoint else ""
    with resumable(hint or "nothing is half-written; with --checkpoint FILE a training can be resumed"):
        with progress("training") as bar:
            classifier = fit(
                build_network(network, training.n_channels, len(training.classes), length=training.length, **shape),
                training,
                settings=recipe,
                seed=seed,
                validation=validation,
                checkpoint=checkpoint,
                resume=resume,
                progress=lambda epoch: bar(epoch.number, recipe.epochs, f"training, loss {epoch.loss:.4f}"),
                device=device,
            )
        if validation is not None:
            classifier = learn_confidence(classifier, validation, error_rate=allowed_rate)
        save_classifier(classifier, out)
    _tell_training(classifier, training, validation, held_out, source, out, seed, as_json)


def _or_default(value: float | None, default: float) -> float:
    return default if value is None else value


def _require_checkpoint(checkpoint: Path | None, resume: bool) -> None:
    """Refuse to continue from nothing, and to replace a checkpoint."""
    from swashtwin.foundation import InputError

    if resume and checkpoint is None:
        raise typer.BadParameter("needs --checkpoint FILE, the file to continue from.", param_hint="--resume")
    if checkpoint is not None and checkpoint.exists() and not resume:
        raise InputError(f"{checkpoint} exists; continue it with --resume, or delete it to start again.")


def _recipe(
    network: str | None, texts: list[str] | None, preset: Preset, window: int
) -> tuple[str, "TrainingSettings", dict[str, Any]]:
    """Network, settings of the training and those of the network; an unknown name is a wrong command line."""
    from swashtwin import presets
    from swashtwin.learning import NETWORKS, build_network, default_settings, has_network

    recipe = presets.paper if preset is Preset.paper else presets.recommended
    name = network or recipe.classifier["network"]
    if not has_network(name):
        build_network(name, 2, 2)
    shape_defaults = default_settings(NETWORKS[name])
    chosen = read_settings(texts, {**shape_defaults, **defaults_of(recipe.training)}, f"training a {name}")
    shape = {setting: value for setting, value in chosen.items() if setting in shape_defaults}
    build_network(name, 2, 2, length=window, **shape)
    return name, replace(recipe.training, **{key: chosen[key] for key in chosen if key not in shape_defaults}), shape


def _check_classes(labels: set[str | None], source: Path) -> None:
    """Refuse a single class, and note several that are healthy."""
    from swashtwin.foundation import DataError
    from swashtwin.recordings import several_healthy

    for finding in several_healthy(labels):
        note(f"note: {finding.message}")
    classes = sorted(name for name in labels if name is not None)
    if len(classes) == 1:
        raise DataError(
            f"{source}: every recording is of the class {classes[0]!r}; a classifier needs two classes at least: "
            "record another, or add synthetic windows of one with --add; healthy recordings alone make an anomaly "
            "detector."
        )


def _no_validation(cause: str, group: str, test_fraction: float) -> str:
    """Message that the recordings left after the test cannot be split again."""
    left = f"of what --test-fraction {test_fraction:g} left, by --group {group}, " if test_fraction else ""
    other = "" if group == "recording" else "--group recording, "
    advice = f"{other}--validation-fraction 0, or --test-fraction 0 trains without this split"
    return f"no validation set can be held out {left}with every class on both sides: {cause} Otherwise {advice}."


def _told_error_rate(plan: "ValidationPlan", fraction: float, count: int, error_rate: float) -> float:
    """The error rate that `count` validation recordings allow, said where it or the share is not what was asked for."""
    from swashtwin.learning import allowed_error_rate

    allowed = allowed_error_rate(count, error_rate)
    if allowed != error_rate or plan.fraction != fraction:
        share = f"{count} of {plan.n_recordings} recordings (--validation-fraction {plan.fraction:g})"
        rate = f"; they allow --error-rate {allowed:g}" if allowed != error_rate else ""
        note(
            f"note: --error-rate {error_rate:g} needs {plan.needed} validation recordings, and --validation-fraction "
            f"{fraction:g} is about {round(fraction * plan.n_recordings)}; {share} are held out{rate}."
        )
    return allowed


def _refuse_seen(held_out: "WindowSet", manifest: "Manifest") -> None:
    from swashtwin.foundation import LeakError
    from swashtwin.recordings import say_seen, seen_recordings

    if seen := seen_recordings(manifest, held_out.recordings):
        raise LeakError(
            f"{say_seen(seen)} had a part in the synthetic windows and would be tested on; split first (swashtwin data "
            "split), then calibrate, synthesize and train with train.toml and --test-fraction 0."
        )


def _tell_training(
    classifier: "FittedClassifier",
    training: "WindowSet",
    validation: "WindowSet | None",
    held_out: "WindowSet",
    source: Path,
    out: Path,
    seed: int,
    as_json: bool,
) -> None:
    last, confidence = classifier.history[-1], classifier.confidence
    test_ids = sorted(set(held_out.recording_id.tolist()))
    result = {
        "model": out, "classes": classifier.classes, "windows": len(training),
        "synthetic_windows": int(training.synthetic.sum()), "held_out": test_ids, "epochs": last.number,
        "loss": last.loss, "accuracy": last.accuracy, "seed": seed,
        "validation": [] if validation is None else sorted(set(validation.recording_id.tolist())),
        "temperature": None if confidence is None else confidence.temperature,
        "dependence": None if confidence is None else confidence.dependence,
    }  # fmt: skip

    def show() -> None:
        say(f"{out}: {len(training)} windows of {len(classifier.classes)} classes, loss {last.loss:.4f}")
        if confidence is None:
            note(f"note: its confidence is not calibrated; {confidence_advice(len(classifier.manifest))}.")
        else:
            learned = f"temperature {confidence.temperature:.3g}, dependence of windows {confidence.dependence:.2g}"
            say(f"Confidence from {confidence.basis}: {learned}, error rate {confidence.error_rate:g}")
        if test_ids:
            say(f"Next, on {plural(len(test_ids), 'recording')} held out: swashtwin evaluate {out} {source}")
        else:
            note("note: nothing was held out; evaluate it on an index of other recordings.")

    tell(result, as_json, show)


def evaluate(
    model: ModelFile,
    source: Index,
    level: Annotated[str | None, typer.Option(help="Distance of the test from the training: L0 to L5.")] = None,
    ids: Annotated[
        list[str] | None, typer.Option("--id", help="Recording to test on; repeatable. By default all that are unseen.")
    ] = None,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Score a model on the recordings of an index that had no part in it."""
    import swashtwin.learning as learning
    from swashtwin.diagnosis import AnomalyDetector, load_model
    from swashtwin.recordings import load_recordings

    if level is not None and level not in learning.LEVELS:
        raise typer.BadParameter(f"{level!r} is none of {', '.join(learning.LEVELS)}.", param_hint="--level")
    classifier = load_model(model)
    recordings = load_recordings(source)
    if isinstance(classifier, AnomalyDetector):
        evaluate_detector(classifier, model, recordings, ids, as_json)
        return
    with progress("evaluating"):
        chosen = recordings.where(ids=ids) if ids else learning.unseen_recordings(classifier, recordings)
        test = learning.cut_windows(
            chosen, length=classifier.length, classes=classifier.classes, allow_partial_revolution=True
        )
        scores = learning.evaluate(classifier, test, level=level, seed=seed)
        confidence = learning.score_confidence(classifier, test) if classifier.confidence is not None else None
    names = [recording.recording_id for recording in chosen]
    if not ids and len(names) < len(recordings):
        note(f"left out: {plural(len(recordings) - len(names), 'recording')} that had a part in the model.")
    result = {"model": model, "recordings": names, **scores.to_dict()}
    result["confidence"] = None if confidence is None else confidence.to_dict()

    def show() -> None:
        _show_scores(scores)
        if confidence is not None:
            _show_confidence(confidence)

    tell(result, as_json, show)


def _show_confidence(confidence: "ConfidenceScores") -> None:
    rows = [(name, value) for name, value in confidence.to_dict().items() if isinstance(value, int | float)]
    table("Confidence, by recording", ("figure", "value"), rows)


def _show_scores(scores: "Scores") -> None:
    names = ("accuracy", "recording_accuracy", "macro_recall", "macro_f1", "g_mean", "g_mean_laplace",
             "false_alarm_rate", "missed_fault_rate", "macro_auroc", "calibration_error")  # fmt: skip
    rows = [(name, getattr(scores, name), scores.reasons.get(name, "")) for name in names]
    count = plural(scores.n_recordings, "recording")
    title = f"{scores.n_windows} windows of {count}, level {scores.level or 'not stated'}"
    table(title, ("score", "value", ""), rows)
    low, high = scores.accuracy_interval
    say(f"95 % interval of the accuracy, over the recordings: {low:.3f} to {high:.3f}")
    counts = [(name, *(int(n) for n in row)) for name, row in zip(scores.classes, scores.confusion, strict=True)]
    without = ("no verdict",) if scores.confusion.shape[1] > len(scores.classes) else ()
    table("Windows of each class (row) by predicted class (column)", ("", *scores.classes, *without), counts)


def export(
    model: ModelFile,
    out: Annotated[Path, typer.Option(help="ONNX file to write.")] = Path("model.onnx"),
    as_json: Json = False,
) -> None:
    """Write a model as an ONNX file, which runs without torch and without swashtwin."""
    from swashtwin.diagnosis import export_onnx, load_classifier

    require_target(out, ".onnx")
    classifier = load_classifier(model)
    with progress("writing ONNX"):
        export_onnx(classifier, out)
    layout, kind = classifier.layout, classifier.normalization.kind
    result = {
        "model": out, "network": classifier.network.name, "classes": classifier.classes,
        "channels": layout.channels, "length": layout.length, "sample_rate": layout.sample_rate,
        "unit": layout.unit, "normalization": kind, "scaled": kind != "recording",
    }  # fmt: skip

    def show() -> None:
        shape = f"(any, {len(layout.channels)}, {layout.length})"
        say(f"{out}: windows {shape} in {layout.unit} at {layout.sample_rate:g} Hz, to one probability per class")
        if kind == "recording":
            note("note: it scales nothing; give it samples scaled by the mean and deviation of their recording.")

    tell(result, as_json, show)
