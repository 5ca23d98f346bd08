"""Commands that make and test a classifier: train, evaluate, model export."""

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
from swashtwin.cli.files import Force, artifact_marks, require_output
from swashtwin.cli.options import (
    GroupName,
    Index,
    Json,
    OptionalWindow,
    Preset,
    PresetName,
    Seed,
    defaults_of,
    read_pairs,
    read_settings,
)
from swashtwin.foundation import plural

if TYPE_CHECKING:
    from swashtwin.diagnosis import AnomalyDetector, FaultClassifier
    from swashtwin.learning import FittedClassifier

_MODELS = artifact_marks("classifier", "anomaly detector")
_TEST_FRACTION = 0.2
"""Share held out by default."""


def train(
    source: Index,
    out: Annotated[Path, typer.Option(help="Model file to write.")] = Path("model.safetensors"),
    add: Annotated[
        list[Path] | None,
        typer.Option(help="Synthetic windows (swashtwin synthesize); repeatable."),
    ] = None,
    test_fraction: Annotated[
        float | None,
        typer.Option(
            min=0, max=0.5, help="Share held out for evaluate; 0.2 by default, 0 trains on all."
        ),
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
    window: OptionalWindow = None,
    network: Annotated[
        str | None,
        typer.Option(
            help="Train this network, such as the paper's bitcn, instead of choosing by trials. Interrupted, it "
            "goes on when the same command is given again."
        ),
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="NAME=VALUE",
            help="Any setting of a named network or its training: epochs=60, noise_snr=5, hidden=256,128, device=cuda; "
            "repeatable.",
        ),
    ] = None,
    fault_of: Annotated[
        list[str] | None,
        typer.Option(
            metavar="CLASS=FAULT",
            help='Fault that a class is, whose synthetic windows join it: "Kolbenverschleiss=piston"; repeatable, and '
            "beside what the index states as fault_of.",
        ),
    ] = None,
    prior: Annotated[
        str | None,
        typer.Option(
            help="Pump prior, a file or a shipped design (25scy14-1b): recordings that it takes for a fault that was "
            "never trained are unknown, and the answer names what they resemble."
        ),
    ] = None,
    preset: PresetName = Preset.recommended,
    seed: Seed = 0,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Train a classifier on an index's windows; whole recordings are held out, which evaluate then
    tests on.

    Where all recordings are healthy, it makes an anomaly detector with a stated false-alarm rate.
    """
    is_chosen = network is None and preset is Preset.recommended
    if is_chosen and settings:
        raise typer.BadParameter(
            "belongs to a network; name it with --network, such as bitcn.", param_hint="--set"
        )
    from swashtwin.diagnosis import AnomalyDetector, FaultClassifier
    from swashtwin.learning import load_windows
    from swashtwin.pump import is_healthy
    from swashtwin.recordings import (
        declared_classes,
        declared_faults,
        healthy_class_findings,
        load_recordings,
    )

    require_output(out, inputs=[source, *(add or ())], own=_MODELS, force=force)
    require_existing(add or [])
    recipe = {} if is_chosen else _recipe(network, settings, preset, window)
    added = [load_windows(path) for path in add or ()]
    recordings = load_recordings(source)
    if not added and recordings and all(map(is_healthy, recordings.labels)):
        classifier_options = {
            "--test-fraction": test_fraction, "--validation-fraction": validation_fraction, "--network": network,
            "--set": settings, "--window": window,
            "--prior": prior, "--preset": preset is Preset.paper, "--group": group != "recording",
        }  # fmt: skip
        for name, value in classifier_options.items():
            if value:
                raise typer.BadParameter(
                    f"belongs to a classifier, and every recording of {source} is healthy, so train makes an anomaly "
                    "detector from all of them; leave it out, or add recordings of a fault.",
                    param_hint=name,
                )
        with progress("measuring levels") as bar:
            detector = AnomalyDetector(error_rate=error_rate).fit(recordings, progress=bar)
        detector.save(out)
        _tell_detector(detector, out, as_json)
        return
    declared = {
        name: fault for name, fault in declared_faults(source).items() if name in recordings.labels
    }
    for finding in healthy_class_findings(recordings.labels):
        print_note(f"note: {finding.message}")
    classifier = FaultClassifier(
        **recipe,
        window=window,
        test_fraction=_TEST_FRACTION if test_fraction is None else test_fraction,
        validation_fraction=validation_fraction,
        group=group,
        error_rate=error_rate,
        fault_of=declared | read_pairs(fault_of, "--fault-of"),
        prior=prior,
        seed=seed,
    )
    checkpoint = None if is_chosen else out.with_name(f"{out.stem}.checkpoint.safetensors")
    with progress("training") as bar:
        classifier.fit(
            recordings,
            synthetic=added,
            classes=None if added else declared_classes(source),
            checkpoint=checkpoint,
            resume=checkpoint is not None,
            progress=lambda activity, finished, total: bar(finished, total, activity),
        )
    classifier.save(out)
    if checkpoint is not None:
        checkpoint.unlink(missing_ok=True)
    for text in classifier.notes_:
        print_note(f"note: {text}")
    _tell_training(classifier, source, out, seed, as_json)


def _recipe(
    network: str | None, texts: list[str] | None, preset: Preset, window: int | None
) -> dict[str, Any]:
    from swashtwin import presets
    from swashtwin.diagnosis import FaultClassifier
    from swashtwin.learning import build_network, default_settings, network_class

    recipe = presets.paper if preset is Preset.paper else presets.recommended
    name = network or str(recipe.classifier["network"])
    shape_defaults = default_settings(network_class(name))
    defaults = {**shape_defaults, **defaults_of(recipe.training), "device": "cpu"}
    chosen = read_settings(texts, defaults, f"training a {name}")
    device = chosen.pop("device", "cpu")
    shape = {setting: value for setting, value in chosen.items() if setting in shape_defaults}
    build_network(name, 2, 2, length=window or 2048, **shape)
    training = replace(
        recipe.training, **{key: chosen[key] for key in chosen if key not in shape_defaults}
    )
    names = defaults_of(training).keys() & FaultClassifier().get_params().keys()
    parameters = {key: getattr(training, key) for key in names}
    other = {
        key: chosen[key] for key in chosen if key not in shape_defaults and key not in parameters
    }
    settings = {"training_settings": other or None, "network_settings": shape or None}
    return {"network": name, "device": device, **parameters, **settings}


def _tell_detector(detector: "AnomalyDetector", out: Path, as_json: bool) -> None:
    healthy, n_levels = detector.fitted_, len(detector.layout.band_powers)
    result = {
        "model": out, "kind": "anomaly detector", "recordings": sorted(detector.manifest),
        "operating_points": len(healthy.points), "band_powers": n_levels, "error_rate": detector.error_rate_,
        "notes": detector.notes_,
    }  # fmt: skip

    def show() -> None:
        print_text(
            f"{out}: anomaly detector from {plural(healthy.n_recordings, 'healthy recording')} at "
            f"{plural(len(healthy.points), 'operating point')}, {n_levels} levels, false-alarm rate "
            f"{detector.error_rate_:g}"
        )
        for text in detector.notes_:
            print_note(f"note: {text}")
        print_text(f"Next: swashtwin diagnose {out} FILE")

    print_result(result, as_json, show)


def _tell_training(
    trained: "FaultClassifier", source: Path, out: Path, seed: int, as_json: bool
) -> None:
    fitted, test_ids = trained.fitted_, trained.held_out_
    last, confidence = fitted.history[-1], fitted.confidence
    result = {
        "model": out, "classes": fitted.classes, "windows": trained.n_windows_,
        "synthetic_windows": trained.n_synthetic_, "held_out": test_ids, "epochs": last.number,
        "loss": last.loss, "accuracy": last.accuracy, "seed": seed, "validation": trained.validation_,
        "temperature": None if confidence is None else confidence.temperature,
        "dependence": None if confidence is None else confidence.dependence,
        "choice": None if fitted.choice is None else fitted.choice.to_dict(),
    }  # fmt: skip

    def show() -> None:
        print_text(
            f"{out}: {plural(trained.n_windows_, 'window')} of {len(fitted.classes)} classes, loss {last.loss:.4f}"
        )
        if (choice := fitted.choice) is not None:
            rows = [
                (
                    trial.candidate,
                    trial.clean,
                    trial.disturbed,
                    "chosen" if trial.candidate == choice.candidate else "",
                )
                for trial in choice.trials
            ] + [
                (f"whole recordings: {name}", recall, None, "")
                for name, recall in choice.head_recalls.items()
            ]
            if rows:
                folds = f"recall on unseen {choice.group}s, {plural(choice.n_folds, 'fold')}"
                print_table(
                    f"Candidates: {folds}", ("candidate", "clean", "noise, gain, speed", ""), rows
                )
            print_text(choice.sentence())
        if confidence is None:
            print_note(f"note: its confidence is not calibrated; {confidence_advice(fitted)}.")
        else:
            learned = f"temperature {confidence.temperature:.3g}, dependence of windows {confidence.dependence:.2g}"
            print_text(
                f"Confidence from {confidence.basis}: {learned}, error rate {confidence.error_rate:g}"
            )
        if test_ids:
            print_text(
                f"Next, on {plural(len(test_ids), 'recording')} held out: swashtwin evaluate {out} {source}"
            )
        else:
            print_note("note: nothing was held out; evaluate it on an index of other recordings.")

    print_result(result, as_json, show)


def confidence_advice(fitted: "FittedClassifier") -> str:
    """How to calibrate the confidence of a training."""
    from swashtwin.learning import allowed_error_rate, validation_share

    if fitted.choice is not None:
        return f"that takes a trial: {fitted.choice.reason or 'no class has two recordings to compare'}"
    n_recordings = len(fitted.manifest)
    share, count = validation_share(n_recordings)
    if count < 2:
        return f"that takes more recordings than the {n_recordings} it was trained on"
    allowed = allowed_error_rate(count, 0.1)
    rate = "" if allowed == 0.1 else f" --error-rate {allowed:g}"
    return (
        "train without --network calibrates it on the recordings it trains on; "
        f"--validation-fraction {share:g}{rate} holds back about {count} of the "
        f"{plural(n_recordings, 'recording')} for it"
    )
