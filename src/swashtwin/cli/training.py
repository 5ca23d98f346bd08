"""Commands that make and test a classifier: train, evaluate, model export."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from swashtwin.cli.console import note, progress, say, table, tell
from swashtwin.cli.detecting import are_healthy, train_detector
from swashtwin.cli.exits import require_files, require_target, resumable
from swashtwin.cli.options import (
    GroupName,
    Index,
    Json,
    Preset,
    PresetName,
    Seed,
    UsualWindow,
    defaults_of,
    read_settings,
)
from swashtwin.cli.summaries import confidence_advice
from swashtwin.foundation import plural

if TYPE_CHECKING:
    from swashtwin.learning import (
        Choice,
        FittedClassifier,
        TrainingSettings,
        ValidationPlan,
        WindowSet,
    )
    from swashtwin.recordings import Manifest


_ERROR_RATE = 0.1
"""Error rate by default."""
_TEST_FRACTION = 0.2
"""Share held out by default."""
_NETWORK_WINDOW = 2048
"""Samples per window of a named network by default."""


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
            min=0,
            max=0.5,
            help="Share of the rest that is held out to calibrate the model's confidence, by --group; with 0 the "
            "trials calibrate it, and with --network nothing does.",
        ),
    ] = 0.0,
    error_rate: Annotated[
        float | None,
        typer.Option(
            help="Share of recordings whose prediction set may be wrong, or that are wrongly unknown; 0.1 by default, "
            "or the least that the recordings allow. Of healthy recordings alone: the false-alarm rate, "
            "0.05 by default."
        ),
    ] = None,
    group: GroupName = "recording",
    window: UsualWindow = None,
    window_stride: Annotated[
        int | None, typer.Option(help="Samples from window to window; its length by default.")
    ] = None,
    allow_partial_revolution: Annotated[
        bool, typer.Option("--allow-partial-revolution", help="Accept windows shorter than one turn of the shaft.")
    ] = False,
    network: Annotated[
        str | None,
        typer.Option(help="Train this network, such as the paper's bitcn, instead of choosing by trials."),
    ] = None,
    budget: Annotated[
        str | None,
        typer.Option(help='Computing time that choosing may take on one core, such as "5 min"; 10 min by default.'),
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="NAME=VALUE",
            help="Any setting of a named network or its training: epochs=60, noise_snr=5, hidden=256,128; repeatable.",
        ),
    ] = None,
    preset: PresetName = Preset.recommended,
    device: Annotated[str, typer.Option(help='"cpu", or a GPU such as "cuda".')] = "cpu",
    checkpoint: Annotated[Path | None, typer.Option(help="File saved after each epoch of a named network.")] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Continue from the checkpoint, if it exists.")] = False,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Train a classifier on an index's windows; whole recordings are held out, which evaluate then tests on.

    Where all recordings are healthy, it makes an anomaly detector with a stated false-alarm rate.
    """
    is_chosen = network is None and preset is Preset.recommended
    _refuse_options(is_chosen, {"--set": settings, "--checkpoint": checkpoint}, {"--budget": budget})
    from swashtwin.diagnosis import save_classifier
    from swashtwin.foundation import DataError, parse
    from swashtwin.learning import (
        BUDGET,
        build_network,
        check_disjoint,
        cut_windows,
        fit,
        fit_chosen,
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
        usual_window,
    )

    _require_checkpoint(checkpoint, resume)
    require_target(out)
    require_files(add or [])
    seconds = BUDGET if budget is None else parse(budget, "s", name="--budget")
    recipe = None if is_chosen else _recipe(network, settings, preset, window or _NETWORK_WINDOW)
    added = [load_windows(path) for path in add or ()]
    manifest = join_manifests([synthetic.manifest for synthetic in added])
    recordings = load_recordings(source)
    length = window or (usual_window(recordings) if is_chosen else _NETWORK_WINDOW)
    layout: dict[str, Any] = {"like": added[0]} if added else {"length": length}
    if not added and are_healthy(recordings):
        classifier_options = {
            "test_fraction": test_fraction, "validation_fraction": validation_fraction, "network": network,
            "set": settings, "checkpoint": checkpoint, "window_stride": window_stride, "window": window,
            "budget": budget, "preset": preset is Preset.paper, "group": group != "recording",
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
            if recipe is None:
                classifier = fit_chosen(
                    training,
                    budget=seconds,
                    error_rate=None if validation_fraction else error_rate,
                    seed=seed,
                    device=device,
                    progress=lambda activity, finished, total: bar(finished, total, activity),
                )
            else:
                name, how, shape = recipe
                classifier = fit(
                    build_network(name, training.n_channels, len(training.classes), length=training.length, **shape),
                    training,
                    settings=how,
                    seed=seed,
                    validation=validation,
                    checkpoint=checkpoint,
                    resume=resume,
                    progress=lambda epoch: bar(epoch.number, how.epochs, f"training, loss {epoch.loss:.4f}"),
                    device=device,
                )
        if validation is not None:
            classifier = learn_confidence(classifier, validation, error_rate=allowed_rate)
        save_classifier(classifier, out)
    _tell_training(classifier, training, validation, held_out, source, out, seed, as_json)


def _refuse_options(is_chosen: bool, of_network: dict[str, object], of_choice: dict[str, object]) -> None:
    """Refuse options of a named network where training chooses, and the other way round."""
    for name, value in (of_network if is_chosen else of_choice).items():
        if value:
            advice = (
                "belongs to a network; name it with --network, such as spectral_bitcn."
                if is_chosen
                else "belongs to the training that chooses; leave it out, or leave out --network and --preset."
            )
            raise typer.BadParameter(advice, param_hint=name)


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
    name = network or str(recipe.classifier["network"])
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
        "choice": None if classifier.choice is None else classifier.choice.to_dict(),
    }  # fmt: skip

    def show() -> None:
        say(f"{out}: {plural(len(training), 'window')} of {len(classifier.classes)} classes, loss {last.loss:.4f}")
        if classifier.choice is not None:
            _show_choice(classifier.choice)
        if confidence is None:
            no_trial = classifier.choice is not None and not classifier.choice.trials
            advice = "that takes a trial" if no_trial else confidence_advice(len(classifier.manifest))
            note(f"note: its confidence is not calibrated; {advice}.")
        else:
            learned = f"temperature {confidence.temperature:.3g}, dependence of windows {confidence.dependence:.2g}"
            say(f"Confidence from {confidence.basis}: {learned}, error rate {confidence.error_rate:g}")
        if test_ids:
            say(f"Next, on {plural(len(test_ids), 'recording')} held out: swashtwin evaluate {out} {source}")
        else:
            note("note: nothing was held out; evaluate it on an index of other recordings.")

    tell(result, as_json, show)


def _show_choice(choice: "Choice") -> None:
    rows = [
        (trial.candidate, trial.clean, trial.disturbed, "chosen" if trial.candidate == choice.chosen else "")
        for trial in choice.trials
    ]
    if rows:
        folds = f"recall on unseen {choice.group}s, {plural(choice.n_folds, 'fold')}"
        table(f"Candidates: {folds}", ("candidate", "clean", "noise, gain, speed", ""), rows)
    say(choice.sentence())
