"""The command that uses what a twin learnt: synthesize."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from swashtwin.cli.console import say, tell
from swashtwin.cli.options import Dimensions, Json, Length, Seed, fault_of


def synthesize(
    calibration: Annotated[Path, typer.Argument(help="Saved calibration (swashtwin calibrate).")],
    like: Annotated[Path, typer.Option(help="Index of the training recordings: layout, classes, noise.")],
    count: Annotated[int, typer.Option(help="How many.")],
    out: Annotated[Path, typer.Option(help="File of windows to write, for train --add.")],
    label: Annotated[str | None, typer.Option(help="Class of the windows; the twin's, and checked.")] = None,
    fault: Annotated[
        str | None, typer.Option(help="Give the twin a fault that nobody recorded, such as piston, with --dimension.")
    ] = None,
    dimensions: Dimensions = None,
    pressure: Annotated[str | None, typer.Option(help="Take the twin to another outlet pressure.")] = None,
    nominal: Annotated[bool, typer.Option("--nominal", help="Use the twin as it was before calibration.")] = False,
    draws: Annotated[
        bool,
        typer.Option(help="Draw the values of each window from the posterior, or take those found."),
    ] = True,
    background: Annotated[bool, typer.Option(help="Lay the windows over noise as measured.")] = True,
    residual: Annotated[
        bool,
        typer.Option("--residual", help="Take for noise measured windows less what turns with the shaft, as they are."),
    ] = False,
    length: Length = 2048,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Make synthetic windows of one class with a calibrated twin, also of a fault that it was not calibrated on.

    Their noise is that of the recordings of --like, which are training data from then on: give train.toml of a split.
    """
    if residual and not background:
        raise typer.BadParameter("is a background; leave --no-background out.", param_hint="--residual")
    from swashtwin.calibration import load_calibration
    from swashtwin.foundation import parse
    from swashtwin.learning import cut_windows, save_windows
    from swashtwin.recordings import load_recordings
    from swashtwin.synthesis import simulate_windows

    found = load_calibration(calibration)
    twin = found.nominal if nominal else found.twin
    if pressure is not None:
        twin = twin.at(twin.condition.replaced(discharge_pressure=parse(pressure, "Pa", name="pressure")))
    if fault is not None:
        twin = twin.with_fault(fault_of(fault, None, None, None, dimensions))
    elif dimensions:
        raise typer.BadParameter("belongs to --fault.", param_hint="--dimension")
    label = twin.label if label is None else label
    recordings = load_recordings(like)
    classes = sorted({one.label for one in recordings if one.label is not None} | {label})
    measured = cut_windows(recordings, length=length, classes=classes)
    if label != twin.label:
        raise typer.BadParameter(f"is {label!r}, but the twin simulates {twin.label!r}.", param_hint="--label")
    windows = simulate_windows(
        twin,
        count=count,
        like=measured,
        seed=seed,
        background="residual" if residual else "spectrum" if background else "none",
        posterior=found.posterior if draws and not nominal else None,
    )
    windows = replace(windows, manifest=tuple(sorted({*windows.manifest, *found.recording_ids})))
    save_windows(windows, out)
    result = {
        "windows": out,
        "label": label,
        "count": len(windows),
        "length": windows.length,
        "manifest": list(windows.manifest),
    }
    result |= {"classes": windows.classes, "seed": seed, "draws": draws and not nominal}
    told = f"{out}: {len(windows)} windows of {label}"
    following = f"Next: swashtwin train {like} --add {out} --test-fraction 0 --out model.safetensors"
    tell(result, as_json, lambda: say(f"{told}\n{following}"))
