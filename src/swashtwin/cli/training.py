"""The command that trains a model: train."""

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from swashtwin.cli.console import (
    print_note,
    print_result,
    print_table,
    print_text,
    progress,
    require_existing,
)
from swashtwin.cli.filling import (
    FaultOfOption,
    FillName,
    FillOption,
    ReportedFilling,
    build_filling,
    collect_fault_texts,
    fault_names,
    read_fault_texts,
    twin_files,
)
from swashtwin.cli.options import (
    GroupName,
    Index,
    Json,
    OptionalWindow,
    Preset,
    PresetName,
    Seed,
    defaults_of,
    read_settings,
)
from swashtwin.cli.outputs import Force, require_output
from swashtwin.foundation import plural, shell_command

if TYPE_CHECKING:
    from swashtwin.diagnosis import AnomalyDetector, FaultClassifier
    from swashtwin.learning import CandidateChoice, Confidence, FittedClassifier, WindowSet
    from swashtwin.recordings import Recordings
    from swashtwin.synthesis import FillingPlan

DEFAULT_TEST_FRACTION = 0.2
"""Share of the recordings that is held out for ``evaluate``, the usual split of 80 to 20."""


def train(
    source: Index,
    out: Annotated[Path, typer.Option(help="Model file to write.")] = Path("model.safetensors"),
    add: Annotated[
        list[Path] | None,
        typer.Option(help="Synthetic windows written by swashtwin synthesize. Repeatable."),
    ] = None,
    test_fraction: Annotated[
        float | None,
        typer.Option(
            min=0,
            max=0.5,
            help="Share of the recordings held out for evaluate. Default: 0.2; 0 trains on all.",
        ),
    ] = None,
    validation_fraction: Annotated[
        float,
        typer.Option(
            min=0,
            max=0.5,
            help="Share of the remaining recordings held out to calibrate the confidence, split by "
            "--group. With 0, cross-validation calibrates it, or nothing if --network is given.",
        ),
    ] = 0.0,
    error_rate: Annotated[
        float | None,
        typer.Option(
            help="Target miscoverage of the prediction sets, and false alarms of unknown. Default: "
            "0.1, or the minimum that the recordings allow. If all recordings are healthy: "
            "false-alarm rate, default 0.05."
        ),
    ] = None,
    group: GroupName = "recording",
    window: OptionalWindow = None,
    network: Annotated[
        str | None,
        typer.Option(
            help="Network to train, such as the paper's bitcn, instead of selecting a model by "
            "cross-validation. The same command continues an interrupted training."
        ),
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="NAME=VALUE",
            help="Setting of the --network or of its training: epochs=60, noise_snr=5, "
            "hidden=256,128, device=cuda. Repeatable.",
        ),
    ] = None,
    twin: Annotated[
        list[str] | None,
        typer.Option(
            metavar="CALIBRATION|PUMP",
            help="Twin that simulates windows for short cells of the training recordings: a "
            "calibration file, or a pump by name or file. Recordings that it was calibrated on are "
            "not held out. Repeatable.",
        ),
    ] = None,
    fill: FillOption = None,
    fault_of: FaultOfOption = None,
    prior: Annotated[
        str | None,
        typer.Option(
            help="Pump prior, as a file or a shipped design (25scy14-1b). A recording that the "
            "prior takes for a fault that was not trained is reported as unknown, with the fault "
            "that it resembles."
        ),
    ] = None,
    preset: PresetName = Preset.recommended,
    seed: Seed = 0,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Train a classifier on the recordings of an index.

    Whole recordings are held out, on which evaluate then tests the model. With --twin, twins
    simulate what is short among the other recordings; the plan is printed first. If all recordings
    are healthy, an anomaly detector with a given false-alarm rate is trained instead.
    """
    is_selected_by_trials = network is None and preset is Preset.recommended
    if is_selected_by_trials and settings:
        raise typer.BadParameter(
            "applies to a network. Name the network with --network, such as bitcn.",
            param_hint="--set",
        )
    _require_fitting_options(twin, add, fill)

    from swashtwin.diagnosis import AnomalyDetector, FaultClassifier
    from swashtwin.learning import load_windows
    from swashtwin.pump import is_healthy
    from swashtwin.recordings import class_name_findings, load_recordings

    synthetic_files = add or []
    inputs = [source, *synthetic_files, *twin_files(twin or ())]
    require_output(out, inputs=inputs, force=force)
    require_existing(synthetic_files)
    recipe = {} if is_selected_by_trials else _recipe(network, settings, preset, window)
    synthetic = [load_windows(path) for path in synthetic_files]
    recordings = load_recordings(source)

    fault_texts = collect_fault_texts(source, fault_of)
    filling = None
    if twin:
        filling = ReportedFilling(
            build_filling(twin, fault_texts, fill=fill, count=None, seed=seed), is_silent=as_json
        )

    are_all_healthy = bool(recordings) and all(map(is_healthy, recordings.labels))
    are_all_healthy &= not synthetic and filling is None
    default_test_fraction = 0.0 if are_all_healthy else DEFAULT_TEST_FRACTION
    # Only twins know classes that no recording has.
    known_classes = {*recordings.labels}
    if not twin:
        known_classes |= {*read_fault_texts(fault_of)}
    recorded_texts = {name: texts for name, texts in fault_texts.items() if name in known_classes}
    classifier = FaultClassifier(
        **recipe,
        window=window,
        test_fraction=default_test_fraction if test_fraction is None else test_fraction,
        validation_fraction=validation_fraction,
        group=group,
        error_rate=error_rate,
        fault_of=fault_names(recorded_texts),
        prior=prior,
        seed=seed,
    )
    if are_all_healthy:
        _train_detector(AnomalyDetector.in_place_of(classifier), recordings, out, as_json)
        return

    for finding in class_name_findings(recordings.labels):
        print_note(f"note: {finding.describe()}")
    keeps_checkpoint = not is_selected_by_trials
    _fit_classifier(classifier, recordings, filling or synthetic, source, out, keeps_checkpoint)

    for text in classifier.notes_:
        print_note(f"note: {text}")
    plan = None if filling is None else filling.plan
    _print_training(classifier, plan, source, out, seed, as_json)


def _require_fitting_options(
    twin: list[str] | None, add: list[Path] | None, fill: FillName | None
) -> None:
    """Refuse options that contradict each other in where synthetic windows come from."""
    if twin and add:
        raise typer.BadParameter(
            "does not combine with --twin, which simulates windows itself.", param_hint="--add"
        )
    if fill is not None and not twin:
        raise typer.BadParameter(
            "applies to twins. Specify one with --twin, such as 25scy14-1b.", param_hint="--fill"
        )


def _fit_classifier(
    classifier: "FaultClassifier",
    recordings: "Recordings",
    synthetic: "Sequence[WindowSet] | ReportedFilling",
    source: Path,
    out: Path,
    keeps_checkpoint: bool,
) -> None:
    """Fit and save a classifier; an interrupted fit of a named network continues."""
    from swashtwin.recordings import declared_classes

    checkpoint = out.with_name(f"{out.stem}.checkpoint.safetensors") if keeps_checkpoint else None
    with ExitStack() as stack:
        bar: Callable[..., None] | None = None

        def report(activity: str, count: int, total: int) -> None:
            nonlocal bar
            if bar is None:
                # Not before: the plan of a filling is printed first.
                bar = stack.enter_context(progress("training"))
            bar(count, total, activity)

        classifier.fit(
            recordings,
            synthetic=synthetic,
            # With synthetic windows, the classes include those that no recording has.
            classes=None if synthetic else declared_classes(source),
            checkpoint=checkpoint,
            resume=checkpoint is not None,
            progress=report,
        )

    classifier.save(out)
    if checkpoint is not None:
        checkpoint.unlink(missing_ok=True)


def _recipe(
    network: str | None, texts: list[str] | None, preset: Preset, window: int | None
) -> dict[str, Any]:
    """Return the parameters of a `FaultClassifier` that trains a named network.

    The network is built once, so that an invalid setting is reported before any work.
    """
    from swashtwin import presets
    from swashtwin.diagnosis import FaultClassifier
    from swashtwin.learning import build_network, default_settings, network_class

    recipe = presets.paper if preset is Preset.paper else presets.recommended
    name = network or str(recipe.classifier["network"])
    network_defaults = default_settings(network_class(name))
    allowed = {**network_defaults, **defaults_of(recipe.training), "device": "cpu"}

    settings = read_settings(texts, allowed, f"training a {name}")
    device = settings.pop("device", "cpu")
    network_settings = {key: value for key, value in settings.items() if key in network_defaults}
    training_settings = {
        key: value for key, value in settings.items() if key not in network_defaults
    }
    build_network(name, 2, 2, length=window or 2048, **network_settings)

    # Some training settings are parameters of the classifier itself.
    training = replace(recipe.training, **training_settings)
    shared_names = defaults_of(training).keys() & FaultClassifier().get_params().keys()
    parameters = {key: getattr(training, key) for key in shared_names}
    further_settings = {
        key: value for key, value in training_settings.items() if key not in parameters
    }
    return {
        "network": name,
        "device": device,
        **parameters,
        "training_settings": further_settings or None,
        "network_settings": network_settings or None,
    }


def _train_detector(
    detector: "AnomalyDetector", recordings: "Recordings", out: Path, as_json: bool
) -> None:
    with progress("measuring band powers") as bar:
        detector.fit(recordings, progress=bar)
    detector.save(out)

    healthy = detector.fitted_
    n_band_powers = len(detector.layout.band_powers)
    result = {
        "model": out,
        "kind": "anomaly detector",
        "recordings": sorted(detector.manifest),
        "operating_points": len(healthy.points),
        "band_powers": n_band_powers,
        "error_rate": detector.error_rate_,
        "notes": detector.notes_,
    }

    def show() -> None:
        print_text(
            f"{out}: anomaly detector trained on "
            f"{plural(healthy.n_recordings, 'healthy recording')} at "
            f"{plural(len(healthy.points), 'operating point')}, {n_band_powers} band powers, "
            f"false-alarm rate {detector.error_rate_:g}"
        )
        for text in detector.notes_:
            print_note(f"note: {text}")
        print_text(f"Next: {shell_command('diagnose', out, 'FILE')}")

    print_result(result, as_json, show)


def _print_training(
    classifier: "FaultClassifier",
    plan: "FillingPlan | None",
    source: Path,
    out: Path,
    seed: int,
    as_json: bool,
) -> None:
    fitted = classifier.fitted_
    final_epoch = fitted.history[-1]
    confidence = fitted.confidence
    held_out_ids = classifier.held_out_
    result = {
        "model": out,
        "classes": fitted.classes,
        "windows": classifier.n_windows_,
        "synthetic_windows": classifier.n_synthetic_,
        "filling": None if plan is None else plan.to_dict(),
        "held_out": held_out_ids,
        "epochs": final_epoch.number,
        "loss": final_epoch.loss,
        "accuracy": final_epoch.accuracy,
        "seed": seed,
        "validation": classifier.validation_,
        "temperature": None if confidence is None else confidence.temperature,
        "dependence": None if confidence is None else confidence.dependence,
        "choice": None if fitted.choice is None else fitted.choice.to_dict(),
    }

    def show() -> None:
        print_text(
            f"{out}: trained on {plural(classifier.n_windows_, 'window')} of "
            f"{len(fitted.classes)} classes, loss {final_epoch.loss:.4f}"
        )
        if fitted.choice is not None:
            _print_choice(fitted.choice)
        _print_confidence(confidence, fitted)
        if held_out_ids:
            count = plural(len(held_out_ids), "held-out recording")
            next_command = shell_command("evaluate", out, source)
            print_text(f"Next, test it on {count}: {next_command}")
        else:
            print_note(
                "note: no recording was held out. Evaluate the model on an index of other "
                "recordings."
            )

    print_result(result, as_json, show)


def _print_choice(choice: "CandidateChoice") -> None:
    """Print the candidates that were compared by cross-validation, and which one was selected."""
    rows: list[tuple[object, ...]] = []
    for trial in choice.trials:
        mark = "selected" if trial.candidate == choice.candidate else ""
        rows.append((trial.candidate, trial.clean, trial.disturbed, mark))
    for name, recall in choice.head_recalls.items():
        rows.append((f"whole recordings: {name}", recall, None, ""))

    if rows:
        print_table(
            f"Candidates: recall on held-out {choice.group}s, {plural(choice.n_folds, 'fold')}",
            ("candidate", "undisturbed", "with noise, gain, speed", ""),
            rows,
        )
    print_text(choice.sentence())


def _print_confidence(confidence: "Confidence | None", fitted: "FittedClassifier") -> None:
    if confidence is None:
        print_note(f"note: its confidence is not calibrated; {confidence_advice(fitted)}.")
        return
    print_text(
        f"Confidence calibrated on {confidence.basis}: temperature {confidence.temperature:.3g}, "
        f"dependence between windows {confidence.dependence:.2g}, error rate "
        f"{confidence.error_rate:g}"
    )
    choice = fitted.choice
    limit = "" if choice is None else choice.describe_machine_limit(confidence.error_rate)
    if limit:
        print_note(f"note: {limit}.")


def confidence_advice(fitted: "FittedClassifier") -> str:
    """Return what a training needs to calibrate its confidence."""
    from swashtwin.learning import DEFAULT_ERROR_RATE, allowed_error_rate, validation_share

    if fitted.choice is not None:
        reason = fitted.choice.reason or "no class has two recordings to compare"
        return f"cross-validation was not possible: {reason}"

    # A synthetic window is listed too, but was not read from a recording.
    n_recordings = sum(bool(content) for content in fitted.manifest.values())
    share, n_validation = validation_share(n_recordings)
    if n_validation < 2:
        return f"this requires more recordings than the {n_recordings} it was trained on"

    error_rate = allowed_error_rate(n_validation, DEFAULT_ERROR_RATE)
    option = "" if error_rate == DEFAULT_ERROR_RATE else f" --error-rate {error_rate:g}"
    return (
        "training without --network calibrates it on the training recordings; "
        f"--validation-fraction {share:g}{option} holds back about {n_validation} of the "
        f"{plural(n_recordings, 'recording')} for it"
    )
