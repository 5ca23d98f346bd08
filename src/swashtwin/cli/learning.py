"""Command that learns: train."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from swashtwin.cli.console import note, progress, say, tell
from swashtwin.cli.exits import require_target, resumable
from swashtwin.cli.options import GroupName, Index, Json, Length, Seed, given, list_of, settings_of


def train(
    source: Index,
    out: Annotated[Path, typer.Option(help="Model file to write.")] = Path("model.safetensors"),
    add: Annotated[
        list[Path] | None, typer.Option(help="Synthetic windows (swashtwin synthesize); repeatable.")
    ] = None,
    test_fraction: Annotated[float, typer.Option(help="Share held out for evaluate; 0 trains on all.")] = 0.2,
    group: GroupName = "recording",
    validation_fraction: Annotated[
        float,
        typer.Option(help="Share of the rest that teaches the model how far to trust itself, by --group; 0 for none."),
    ] = 0.0,
    error_rate: Annotated[
        float, typer.Option(help="Share of recordings whose prediction set may miss, or that are wrongly unknown.")
    ] = 0.1,
    length: Length = 2048,
    window_stride: Annotated[
        int | None, typer.Option(help="Readings from window to window; its length by default.")
    ] = None,
    allow_partial_revolution: Annotated[
        bool, typer.Option("--allow-partial-revolution", help="Accept windows shorter than one turn of the shaft.")
    ] = False,
    epochs: Annotated[
        int | None, typer.Option(help="Passes over the windows; 30 by default, the paper's are 200.")
    ] = None,
    batch_size: Annotated[int | None, typer.Option(help="Windows per step; 64 by default, the paper's are 30.")] = None,
    learning_rate: Annotated[
        float | None, typer.Option(help="Step size of Adam; 2e-3 by default, the paper's is 1e-3.")
    ] = None,
    decay: Annotated[str | None, typer.Option(help="cosine (default), or none: how the rate falls.")] = None,
    weight_decay: Annotated[float | None, typer.Option(help="Weight decay; 0 by default.")] = None,
    normalization: Annotated[
        str | None, typer.Option(help="Scaling per set (default), recording, window, or none.")
    ] = None,
    class_weights: Annotated[bool, typer.Option(help="Count each class the same in the loss.")] = False,
    balance: Annotated[
        str | None, typer.Option(help="class or condition: what counts the same in every epoch; none by default.")
    ] = None,
    mixup: Annotated[float | None, typer.Option(help="Strength of mixing pairs of windows; 0 by default.")] = None,
    alignment: Annotated[
        str | None, typer.Option(help="coral or mmd: draw features of different conditions together; none by default.")
    ] = None,
    noise_snr: Annotated[
        float | None,
        typer.Option(help="Noise in training: half of each epoch's windows, down to so many dB; none by default."),
    ] = None,
    gain: Annotated[
        float | None,
        typer.Option(help="Gains in training: each channel of half the windows, up to so many dB; 0 by default."),
    ] = None,
    stretch: Annotated[
        float | None,
        typer.Option(help="Speeds in training: half the windows, up to 0.02 for 2 % faster or slower; 0 by default."),
    ] = None,
    network: Annotated[str, typer.Option(help="Name of the network: ours by default, bitcn is the paper's.")] = (
        "spectral_bitcn"
    ),
    setting: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=VALUE", help="Any setting of the network: patch=8, hidden=256,128; repeatable."),
    ] = None,
    kernel_size: Annotated[int | None, typer.Option(help="Taps of each convolution.")] = None,
    channels: Annotated[str | None, typer.Option(help='Features of each residual unit: "32,32,64".')] = None,
    dilations: Annotated[str | None, typer.Option(help='Dilation of each residual unit: "1,2,4".')] = None,
    dropout: Annotated[float | None, typer.Option(help="Share of the features dropped in training.")] = None,
    stride: Annotated[int | None, typer.Option(help="Readings per step of bitcn; 1 is the paper's.")] = None,
    device: Annotated[str, typer.Option(help='"cpu", or a GPU such as "cuda".')] = "cpu",
    checkpoint: Annotated[Path | None, typer.Option(help="File saved after each epoch.")] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Continue from the checkpoint, if it exists.")] = False,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Train a classifier on an index's windows; whole recordings are held out, which evaluate then tests on."""
    from swashtwin.diagnosis import save_classifier
    from swashtwin.learning import (
        RECOMMENDED_TRAINING,
        build_network,
        check_disjoint,
        cut_windows,
        fit,
        learn_confidence,
        load_windows,
        require_enough,
        split_by_recording,
        without_overlap,
    )
    from swashtwin.recordings import declared_classes, load_recordings, recording_groups

    require_target(out)
    settings = replace(
        RECOMMENDED_TRAINING,
        class_weights=class_weights,
        **given(
            epochs=epochs, batch_size=batch_size, learning_rate=learning_rate, weight_decay=weight_decay,
            decay=decay, normalization=normalization, balance=balance, mixup=mixup, alignment=alignment,
            noise_snr=noise_snr, gain=gain, stretch=stretch,
        ),
    )  # fmt: skip
    added = [load_windows(path) for path in add or ()]
    manifest = {name for synthetic in added for name in synthetic.manifest}
    layout: dict[str, Any] = {"like": added[0]} if added else {"length": length}
    recordings = load_recordings(source)
    windows = cut_windows(
        recordings,
        classes=None if added else declared_classes(source),
        stride=window_stride,
        allow_partial_revolution=allow_partial_revolution,
        **layout,
    )
    training, held_out = windows, windows.subset(windows.target < -1)
    if test_fraction:
        groups = recording_groups(recordings, group)
        training, held_out = split_by_recording(windows, test_fraction=test_fraction, seed=seed, group=groups)
    validation = None
    if validation_fraction:
        training, validation = split_by_recording(
            training, test_fraction=validation_fraction, seed=seed, group=recording_groups(recordings, group)
        )
        validation = without_overlap(validation)
        require_enough(len(set(validation.recording_id.tolist())), error_rate)
    _refuse_seen(held_out.recording_id.tolist(), manifest)
    for synthetic in added:
        training = training + synthetic
    check_disjoint(training, held_out)
    shape = given(
        kernel_size=kernel_size, channels=list_of(channels, int, "--channels"),
        dilations=list_of(dilations, int, "--dilations"), dropout=dropout, stride=stride,
    ) | settings_of(setting, "--setting")  # fmt: skip
    hint = f"{checkpoint} holds the last whole epoch: the same command with --resume goes on" if checkpoint else ""
    with resumable(hint or "nothing is half-written; with --checkpoint FILE a training can be resumed"):
        with progress("training") as bar:
            classifier = fit(
                build_network(network, training.n_channels, len(training.classes), length=training.length, **shape),
                training,
                settings=settings,
                seed=seed,
                validation=validation,
                checkpoint=checkpoint,
                resume=resume,
                progress=lambda epoch: bar(epoch.number, settings.epochs, f"training, loss {epoch.loss:.4f}"),
                device=device,
            )
        if validation is not None:
            classifier = learn_confidence(classifier, validation, error_rate=error_rate)
        save_classifier(classifier, out)
    last = classifier.history[-1]
    held = sorted(set(held_out.recording_id.tolist()))
    trust = classifier.confidence
    result = {
        "model": out, "classes": classifier.classes, "windows": len(training),
        "synthetic_windows": int(training.synthetic.sum()), "held_out": held, "epochs": last.number,
        "loss": last.loss, "accuracy": last.accuracy, "seed": seed,
        "validation": [] if validation is None else sorted(set(validation.recording_id.tolist())),
        "temperature": None if trust is None else trust.temperature,
    }  # fmt: skip

    def show() -> None:
        say(f"{out}: {len(training)} windows of {len(classifier.classes)} classes, loss {last.loss:.4f}")
        if trust is None:
            note("note: it was not taught how far to trust itself; --validation-fraction 0.2 does.")
        else:
            say(f"Temperature {trust.temperature:.3g}, from {trust.n_recordings} validation recordings")
        if held:
            say(f"Next, on {len(held)} recordings held out: swashtwin evaluate {out} {source}")
        else:
            note("note: nothing was held out; evaluate it on an index of other recordings.")

    tell(result, as_json, show)


def _refuse_seen(held_out: list[str], manifest: set[str]) -> None:
    from swashtwin.foundation import LeakError

    seen = sorted(manifest.intersection(held_out))
    if seen:
        raise LeakError(
            f"{seen[0]} had a part in the synthetic windows and would be tested on; split first (swashtwin split), "
            "then calibrate, synthesize and train with train.toml and --test-fraction 0."
        )
