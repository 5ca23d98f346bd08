"""Commands that simulate: twin simulate and synthesize."""

from collections.abc import Iterator
from dataclasses import asdict, dataclass
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
    CalibrationFile,
    Json,
    OptionalFault,
    OptionalWindow,
    Pressure,
    PumpName,
    Seed,
    Speed,
    fault_from,
)
from swashtwin.foundation import plural

if TYPE_CHECKING:
    from swashtwin.physics import Twin
    from swashtwin.recordings import Recording
    from swashtwin.synthesis import Fidelity

_STREAMED = (".h5", ".hdf5")
_MOST_IN_MEMORY = 4 * 10**9
"""Bytes of a recording that is written to a file which cannot be streamed."""
_SPARE = 1 << 15
"""Space that a file takes beyond its samples, in samples, at most."""


def simulate(
    out: Annotated[
        Path,
        typer.Option(help="File to write: .h5, .mat, .wav, .csv or .tdms; with --count a folder."),
    ],
    speed: Speed,
    pressure: Pressure,
    pump: PumpName = "25scy14-1b",
    calibration: Annotated[
        Path | None,
        typer.Option(
            help="Use the twin and the fault of this calibration, at the speed and pressure given."
        ),
    ] = None,
    fault: OptionalFault = None,
    duration: Annotated[str, typer.Option(help="Duration of a recording.")] = "4 s",
    sample_rate: Annotated[str, typer.Option(help="Sample rate of each channel.")] = "25.6 kHz",
    count: Annotated[
        int, typer.Option(min=1, help="Number of recordings; above 1 they go to the folder --out.")
    ] = 1,
    seed: Seed = 0,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Write what the accelerometers of a twin measure, as synthetic recordings.

    With --count, speed, pressure, temperature, interface values, a fault's severity and place, and
    the shaft's phase are drawn for each recording, and the same command continues an interrupted
    run.
    """
    from swashtwin.calibration import load_calibration
    from swashtwin.foundation import parse_quantity
    from swashtwin.physics import Twin
    from swashtwin.pump import SwashPlateDefect, load_pump, read_condition
    from swashtwin.recordings import WRITABLE_SUFFIXES

    if count == 1:
        require_output(
            out, suffixes=WRITABLE_SUFFIXES, inputs=[calibration, Path(pump)], force=force
        )
    elif out.suffix in WRITABLE_SUFFIXES:
        raise typer.BadParameter(
            "names a file; more than one recording needs a folder.", param_hint="--out"
        )
    require_existing([calibration])
    seconds = parse_quantity(duration, "s", name="--duration")
    defect = fault_from(fault or "normal")
    condition = read_condition(speed=speed, discharge_pressure=pressure)
    if calibration is None:
        twin = Twin(load_pump(pump), condition, defect)
    else:
        twin = load_calibration(calibration).twin.at(condition)
        twin = twin if fault is None else twin.with_fault(defect)
    notes = twin.notes()
    if isinstance(twin.fault, SwashPlateDefect) and fault is not None and "contact" not in fault:
        depth = f"its depth of {twin.fault.depth * 1e3:.3g} mm"
        notes = (
            f"the slippers ride through the recess by contact={twin.fault.contact}, which suits {depth}.",
            *notes,
        )
    for text in notes:
        print_note(f"note: {text}")
    plan = _Plan(
        twin, seconds, parse_quantity(sample_rate, "Hz", name="--sample-rate"), seed, notes
    )
    if count == 1:
        _write_one(plan, out, as_json)
    else:
        _write_many(plan, out, count, as_json)


@dataclass(frozen=True)
class _Plan:
    """What every recording of a run has in common."""

    twin: "Twin"
    duration: float
    sample_rate: float
    seed: int
    notes: tuple[str, ...]

    @property
    def size(self) -> int:
        """Bytes of one recording in a file."""
        return (round(self.duration * self.sample_rate) + _SPARE) * len(self.twin.pump.channels) * 8


def _write_one(plan: _Plan, out: Path, as_json: bool) -> None:
    from swashtwin.foundation import require_disk_space
    from swashtwin.recordings import join_blocks, write_blocks, write_recording

    squares: list[Any] = []
    counts: list[int] = []

    def blocks(bar: Any) -> "Iterator[Recording]":
        for block in plan.twin.blocks(
            plan.duration, plan.sample_rate, phase=0.0, recording_id=out.stem
        ):
            squares.append((block.signal**2).sum(axis=1))
            counts.append(block.signal.shape[1])
            bar(sum(counts), round(plan.duration * plan.sample_rate))
            yield block

    streamed = out.suffix.lower() in _STREAMED
    if not streamed and plan.size > _MOST_IN_MEMORY:
        raise typer.BadParameter(
            f"would hold {plan.size / 1e9:.3g} GB in memory; .h5 is written block by block.",
            param_hint="--out",
        )
    with progress("simulating") as bar:
        if streamed:
            out.parent.mkdir(parents=True, exist_ok=True)
            require_disk_space(out.parent, 1, plan.size)
            recording = write_blocks(blocks(bar), out)
        else:
            recording = join_blocks(blocks(bar))
    if not streamed:
        write_recording(recording, out)
    values = [float(value) for value in (sum(squares) / sum(counts)) ** 0.5]
    rms = dict(zip(recording.channels, values, strict=True))
    result: dict[str, Any] = {
        "recording": out,
        "label": recording.label,
        "duration_s": sum(counts) / plan.sample_rate,
    }
    result |= {"sample_rate_hz": plan.sample_rate, "rms_m_s2": rms, "notes": plan.notes}
    print_result(
        result,
        as_json,
        lambda: print_table(
            f"{out}: {recording.label}", ("channel", "rms [m/s^2]"), list(rms.items())
        ),
    )


def _write_many(plan: _Plan, folder: Path, count: int, as_json: bool) -> None:
    from swashtwin.calibration import twin_to_dict
    from swashtwin.foundation import random_stream
    from swashtwin.recordings import write_series
    from swashtwin.synthesis import Variation, draw_twin

    variation = Variation()
    settings = {  # all that the recordings depend on, but for their count
        "twin": twin_to_dict(plan.twin), "duration_s": plan.duration, "sample_rate_hz": plan.sample_rate,
        "variation": asdict(variation), "seed": plan.seed,
    }  # fmt: skip

    def blocks_of(number: int) -> "Iterator[Recording]":
        twin = draw_twin(plan.twin, variation, plan.seed, number)
        phase = random_stream(plan.seed, "phase", number).uniform(0, 6.283185307179586)
        return twin.blocks(plan.duration, plan.sample_rate, phase=phase, recording_id=folder.name)

    with progress("simulating") as bar:
        index, new = write_series(
            folder, count, blocks_of, settings=settings, bytes_each=plan.size, progress=bar
        )
    result = {
        "index": index,
        "recordings": count,
        "new": new,
        "label": plan.twin.label,
        "seed": plan.seed,
    }
    result |= {"duration_s": plan.duration, "sample_rate_hz": plan.sample_rate, "notes": plan.notes}
    print_result(
        result,
        as_json,
        lambda: print_text(
            f"{index}: {plural(count, 'recording')} of {plan.twin.label}, {len(new)} new"
        ),
    )


def synthesize(
    calibration: CalibrationFile,
    like: Annotated[
        Path, typer.Option(help="Index of the training recordings: layout, classes, noise.")
    ],
    count: Annotated[int, typer.Option(min=1, help="Number of windows.")],
    out: Annotated[Path, typer.Option(help="File of windows to write, for train --add.")],
    fault: OptionalFault = None,
    speed: Annotated[
        str | None, typer.Option(help='Another speed for the twin, such as "1500 rpm".')
    ] = None,
    pressure: Annotated[
        str | None,
        typer.Option(help='Another absolute discharge pressure for the twin, such as "10 MPa".'),
    ] = None,
    window: OptionalWindow = None,
    seed: Seed = 0,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Make synthetic windows of one class with a calibrated twin, also of a fault that it was not
    calibrated on.

    The values of each window are drawn from the posterior. Its noise is that of the recordings of
    --like, which are training data from then on: give train.toml of a split. Where --like has
    measured windows of the class, the answer says how well they are told from the synthetic ones
    (AUROC, 0.5 is not at all), and by which features.
    """
    import swashtwin.synthesis as synthesis
    from swashtwin.calibration import load_calibration
    from swashtwin.foundation import parse_quantity, plural
    from swashtwin.learning import save_windows
    from swashtwin.recordings import load_recordings

    require_existing([calibration, like])
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
            speed=None if speed is None else parse_quantity(speed, "rad/s", name="--speed"),
            pressure=None
            if pressure is None
            else parse_quantity(pressure, "Pa", name="--pressure"),
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
            print_note(f"note: {text}")
        print_text(f"{out}: {plural(len(windows), 'window')} of {label}")
        show_fidelity(fidelity, label)
        print_text(
            f"Next: swashtwin train {like} --add {out} --test-fraction 0 --out model.safetensors"
        )

    print_result(answer, as_json, show)


def show_fidelity(fidelity: "Fidelity | None", label: str) -> None:
    """Print how well synthetic windows are told from measured ones, and by what."""
    from swashtwin.foundation import plural

    if fidelity is None:
        print_text(f"fidelity: not known, for --like has no measured window of {label}")
        return
    at = ", ".join(f"{pressure / 1e6:.4g}" for pressure in fidelity.pressures)
    measured = f"{plural(fidelity.n_measured, 'measured window')} of {plural(fidelity.n_recordings, 'recording')}"
    measured += f" at {at} MPa" if at else ""
    if fidelity.auroc is None:
        print_text(f"fidelity: {measured}; the AUROC takes two recordings of each")
    else:
        print_text(
            f"fidelity: AUROC {fidelity.auroc:.2f} of telling them from {measured}; 0.5 is not at all"
        )
    if fidelity.causes_db:
        parts = ", ".join(f"{name} {value:.1f}" for name, value in fidelity.causes_db.items())
        print_text(f"apart by cause [dB]: {parts}")
    print_table(
        "Features that tell them most",
        ("feature", "AUROC alone", "shift [std of measured]"),
        [
            (feature.name, f"{feature.auroc:.2f}", f"{feature.shift:+.1f}")
            for feature in fidelity.features
        ],
    )
