"""The command that makes windows with a calibrated twin: synthesize."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from swashtwin.cli.console import note, progress, say, table, tell
from swashtwin.cli.exits import require_files
from swashtwin.cli.options import CalibrationFile, Json, OptionalFault, Seed, UsualWindow, fault_from
from swashtwin.cli.outputs import Force, artifact_marks, require_output

if TYPE_CHECKING:
    from swashtwin.synthesis import Fidelity


def synthesize(
    calibration: CalibrationFile,
    like: Annotated[Path, typer.Option(help="Index of the training recordings: layout, classes, noise.")],
    count: Annotated[int, typer.Option(min=1, help="Number of windows.")],
    out: Annotated[Path, typer.Option(help="File of windows to write, for train --add.")],
    fault: OptionalFault = None,
    speed: Annotated[str | None, typer.Option(help='Another speed for the twin, such as "1500 rpm".')] = None,
    pressure: Annotated[
        str | None, typer.Option(help='Another absolute discharge pressure for the twin, such as "10 MPa".')
    ] = None,
    window: UsualWindow = None,
    seed: Seed = 0,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Make synthetic windows of one class with a calibrated twin, also of a fault that it was not calibrated on.

    The values of each window are drawn from the posterior. Its noise is that of the recordings of --like, which are
    training data from then on: give train.toml of a split. Where --like has measured windows of the class, the answer
    says how well they are told from the synthetic ones (AUROC, 0.5 is not at all), and by which features.
    """
    import swashtwin.synthesis as synthesis
    from swashtwin.calibration import load_calibration
    from swashtwin.foundation import parse, plural
    from swashtwin.learning import save_windows
    from swashtwin.recordings import load_recordings

    require_files([calibration, like])
    require_output(out, inputs=[calibration, like], own=artifact_marks("window set"), force=force)
    result = load_calibration(calibration)
    calibrated = result.twin.fault if result.law is None else result.law.fault
    with progress("synthesizing"):
        windows = synthesis.synthesize(
            result,
            calibrated if fault is None else fault_from(fault),
            count=count,
            like=load_recordings(like),
            seed=seed,
            speed=None if speed is None else parse(speed, "rad/s", name="--speed"),
            pressure=None if pressure is None else parse(pressure, "Pa", name="--pressure"),
            window=window,
        )
        fidelity = windows.fidelity
    label = str(windows.label[0])
    save_windows(windows, out)
    answer = {
        "windows": out, "label": label, "count": len(windows), "length": windows.length,
        "manifest": list(windows.manifest), "classes": windows.classes, "seed": seed,
        "notes": windows.notes, "fidelity": None if fidelity is None else fidelity.to_dict(),
    }  # fmt: skip

    def show() -> None:
        for text in windows.notes:
            note(f"note: {text}")
        say(f"{out}: {plural(len(windows), 'window')} of {label}")
        show_fidelity(fidelity, label)
        say(f"Next: swashtwin train {like} --add {out} --test-fraction 0 --out model.safetensors")

    tell(answer, as_json, show)


def show_fidelity(fidelity: "Fidelity | None", label: str) -> None:
    """Print how well synthetic windows are told from measured ones, and by what."""
    from swashtwin.foundation import plural

    if fidelity is None:
        say(f"fidelity: not known, for --like has no measured window of {label}")
        return
    at = ", ".join(f"{pressure / 1e6:.4g}" for pressure in fidelity.pressures)
    measured = f"{plural(fidelity.n_measured, 'measured window')} of {plural(fidelity.n_recordings, 'recording')}"
    measured += f" at {at} MPa" if at else ""
    if fidelity.auroc is None:
        say(f"fidelity: {measured}; the AUROC takes two recordings of each")
    else:
        say(f"fidelity: AUROC {fidelity.auroc:.2f} of telling them from {measured}; 0.5 is not at all")
    if fidelity.causes_db:
        parts = ", ".join(f"{name} {value:.1f}" for name, value in fidelity.causes_db.items())
        say(f"apart by cause [dB]: {parts}")
    table(
        "Features that tell them most",
        ("feature", "AUROC alone", "shift [std of measured]"),
        [(feature.name, f"{feature.auroc:.2f}", f"{feature.shift:+.1f}") for feature in fidelity.features],
    )
