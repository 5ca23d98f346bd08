"""Commands that simulate: twin simulate, twin export and synthesize."""

import math
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
from swashtwin.cli.filling import (
    FaultOfOption,
    FillOption,
    build_filling,
    collect_fault_texts,
    is_calibration,
    load_twin_sources,
    print_plan,
    simulate_plan,
    twin_files,
)
from swashtwin.cli.options import (
    Json,
    OptionalFault,
    OptionalWindow,
    Pressure,
    PumpName,
    Seed,
    Speed,
    fault_from,
)
from swashtwin.cli.outputs import Force, require_output
from swashtwin.foundation import parse_quantity, plural, shell_command

if TYPE_CHECKING:
    from swashtwin.physics import Twin
    from swashtwin.recordings import Recording
    from swashtwin.synthesis import Fidelity, Filling

# Formats that are written block by block; the others require the whole recording in memory.
_STREAMED_SUFFIXES = (".h5", ".hdf5")

# Bytes of a recording in memory, so that it fits a computer of 8 GB with its copies.
_MAX_SIZE_IN_MEMORY = 4 * 10**9

# Upper bound of what a file holds beside its samples, counted in samples.
_MAX_OVERHEAD = 1 << 15


def simulate(
    out: Annotated[
        Path,
        typer.Option(help="File to write: .h5, .mat, .wav, .csv or .tdms. With --count: a folder."),
    ],
    speed: Speed,
    pressure: Pressure,
    pump: PumpName = "25scy14-1b",
    calibration: Annotated[
        Path | None,
        typer.Option(
            help="Calibration whose twin and fault are used, at the given speed and pressure."
        ),
    ] = None,
    fault: OptionalFault = None,
    duration: Annotated[str, typer.Option(help="Duration of a recording.")] = "4 s",
    sample_rate: Annotated[str, typer.Option(help="Sample rate of each channel.")] = "25.6 kHz",
    count: Annotated[
        int, typer.Option(min=1, help="Number of recordings; several are written to a folder.")
    ] = 1,
    seed: Seed = 0,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Simulate what the accelerometers of a pump measure, as synthetic recordings.

    With --count, each recording gets its own random speed, pressure, temperature, interface values,
    severity and place of the fault, and shaft phase. The same command continues an interrupted run.
    """
    from swashtwin.calibration import load_calibration
    from swashtwin.physics import Twin
    from swashtwin.pump import load_pump, read_condition
    from swashtwin.recordings import WRITABLE_SUFFIXES

    if count == 1:
        require_output(
            out, suffixes=WRITABLE_SUFFIXES, inputs=[calibration, Path(pump)], force=force
        )
    elif out.suffix in WRITABLE_SUFFIXES:
        raise typer.BadParameter(
            "is a file, but several recordings require a folder.", param_hint="--out"
        )
    require_existing([calibration])
    duration_s = parse_quantity(duration, "s", name="--duration")
    defect = fault_from(fault or "normal")
    condition = read_condition(speed=speed, discharge_pressure=pressure)

    if calibration is None:
        twin = Twin(load_pump(pump), condition, defect)
    else:
        twin = load_calibration(calibration).twin.at(condition)
        if fault is not None:
            twin = twin.with_fault(defect)

    notes = _recess_notes(twin, fault)
    for text in notes:
        print_note(f"note: {text}")

    plan = _Plan(
        twin=twin,
        duration=duration_s,
        sample_rate=parse_quantity(sample_rate, "Hz", name="--sample-rate"),
        seed=seed,
        notes=notes,
    )
    if count == 1:
        _write_one(plan, out, as_json)
    else:
        _write_many(plan, out, count, as_json)


@dataclass(frozen=True)
class _Plan:
    """What all recordings of a run have in common."""

    twin: "Twin"
    duration: float
    """Duration of a recording [s]."""
    sample_rate: float
    """Sample rate [Hz]."""
    seed: int
    notes: tuple[str, ...]

    @property
    def n_samples(self) -> int:
        """Samples of one channel."""
        return round(self.duration * self.sample_rate)

    @property
    def size(self) -> int:
        """Upper bound of one recording's size in a file [bytes]."""
        n_channels = len(self.twin.pump.channels)
        return (self.n_samples + _MAX_OVERHEAD) * n_channels * 8


def _write_one(plan: _Plan, out: Path, as_json: bool) -> None:
    from swashtwin.foundation import require_disk_space
    from swashtwin.recordings import join_blocks, write_blocks, write_recording

    is_streamed = out.suffix.lower() in _STREAMED_SUFFIXES
    if not is_streamed and plan.size > _MAX_SIZE_IN_MEMORY:
        raise typer.BadParameter(
            f"requires {plan.size / 1e9:.3g} GB of memory in this format. Use .h5, which is "
            "written block by block.",
            param_hint="--out",
        )

    # The mean squares are summed while the blocks pass: a streamed recording is never whole.
    square_sums: list[Any] = []
    n_written = 0

    def blocks(bar: Any) -> "Iterator[Recording]":
        nonlocal n_written
        for block in plan.twin.blocks(
            plan.duration, plan.sample_rate, phase=0.0, recording_id=out.stem
        ):
            square_sums.append((block.signal**2).sum(axis=1))
            n_written += block.signal.shape[1]
            bar(n_written, plan.n_samples)
            yield block

    with progress("simulating") as bar:
        if is_streamed:
            out.parent.mkdir(parents=True, exist_ok=True)
            require_disk_space(out.parent, 1, plan.size)
            recording = write_blocks(blocks(bar), out)
        else:
            recording = join_blocks(blocks(bar))
            write_recording(recording, out)

    rms_values = [float(value) for value in (sum(square_sums) / n_written) ** 0.5]
    rms = dict(zip(recording.channels, rms_values, strict=True))
    result = {
        "recording": out,
        "label": recording.label,
        "duration_s": n_written / plan.sample_rate,
        "sample_rate_hz": plan.sample_rate,
        "rms_m_s2": rms,
        "notes": plan.notes,
    }

    def show() -> None:
        print_table(f"{out}: {recording.label}", ("channel", "rms [m/s^2]"), list(rms.items()))

    print_result(result, as_json, show)


def _write_many(plan: _Plan, folder: Path, count: int, as_json: bool) -> None:
    from swashtwin.calibration import twin_to_dict
    from swashtwin.foundation import random_stream
    from swashtwin.recordings import write_series
    from swashtwin.synthesis import Variation, draw_twin

    variation = Variation()

    # All that a recording depends on but its number: a run continues only with equal settings.
    settings = {
        "twin": twin_to_dict(plan.twin),
        "duration_s": plan.duration,
        "sample_rate_hz": plan.sample_rate,
        "variation": asdict(variation),
        "seed": plan.seed,
    }

    def blocks_of(number: int) -> "Iterator[Recording]":
        twin = draw_twin(plan.twin, variation, plan.seed, number)
        phase = random_stream(plan.seed, "phase", number).uniform(0, 2 * math.pi)
        return twin.blocks(plan.duration, plan.sample_rate, phase=phase, recording_id=folder.name)

    with progress("simulating") as bar:
        index, new_files = write_series(
            folder, count, blocks_of, settings=settings, bytes_each=plan.size, progress=bar
        )
    result = {
        "index": index,
        "recordings": count,
        "new": new_files,
        "label": plan.twin.label,
        "seed": plan.seed,
        "duration_s": plan.duration,
        "sample_rate_hz": plan.sample_rate,
        "notes": plan.notes,
    }

    def show() -> None:
        count_text = plural(count, "recording")
        print_text(f"{index}: {count_text} of {plan.twin.label}, {len(new_files)} new")

    print_result(result, as_json, show)


def export_twin(
    source: Annotated[
        str,
        typer.Argument(
            metavar="CALIBRATION|PUMP",
            help="Calibration file, or a pump by name or file, which is a nominal twin.",
        ),
    ],
    out: Annotated[Path, typer.Option(help="FMU file to write.")] = Path("twin.fmu"),
    fault: OptionalFault = None,
    speed: Annotated[
        str | None,
        typer.Option(
            help='Speed at the start, such as "1500 rpm". Default: that of the calibration, or '
            "the rated one."
        ),
    ] = None,
    pressure: Annotated[
        str | None,
        typer.Option(
            help='Absolute discharge pressure at the start, such as "10 MPa". Default: that of the '
            "calibration, or the rated one."
        ),
    ] = None,
    sources_only: Annotated[
        bool,
        typer.Option(
            "--sources-only", help="Write C sources without a binary, which requires no compiler."
        ),
    ] = False,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Write a twin as an FMU for co-simulation (FMI 2.0), which other simulators run.

    Inputs are speed, discharge pressure and the severity of the fault; outputs are the acceleration
    of each sensor and the amplitudes of its lines. The FMU simulates steady states: changed inputs
    take effect at the next revolution.
    """
    from swashtwin.physics import export_fmu

    files = twin_files([source])
    require_existing(files)
    require_output(out, suffixes=[".fmu"], inputs=files, force=force)
    twin, notes = _twin_at_start(source, fault, speed=speed, pressure=pressure)
    notes = (*notes, *_recess_notes(twin, fault))
    for text in notes:
        print_note(f"note: {text}")

    with progress("writing the FMU"):
        fmu = export_fmu(twin, out, sources_only=sources_only)
    inputs = [variable for variable in fmu.variables if variable.is_input]
    result = {
        "fmu": out,
        "fmi_version": "2.0",
        "model_identifier": fmu.identifier,
        "platform": fmu.platform,
        "inputs": [
            {
                "name": variable.name,
                "unit": variable.unit,
                "start": variable.start,
                "minimum": variable.minimum,
                "maximum": variable.maximum,
            }
            for variable in inputs
        ],
        "outputs": [variable.name for variable in fmu.variables if not variable.is_input],
        "notes": notes,
    }

    def show() -> None:
        rows = []
        for variable in inputs:
            values = (variable.start, variable.minimum, variable.maximum)
            rows.append(
                (variable.name, *(_in_trade_units(value, variable.unit) for value in values))
            )
        print_table(f"{out}: inputs", ("input", "at the start", "minimum", "maximum"), rows)
        n_outputs = len(fmu.variables) - len(inputs)
        binary = f"a binary for {fmu.platform}" if fmu.platform else "no binary"
        print_text(f"{plural(n_outputs, 'output')}, {binary}, and C sources")

    print_result(result, as_json, show)


def _in_trade_units(value: float | None, unit: str) -> str | None:
    from swashtwin.pump import format_quantity

    return None if value is None else format_quantity(value, unit, 4)


def _twin_at_start(
    source: str, fault: str | None, *, speed: str | None, pressure: str | None
) -> "tuple[Twin, tuple[str, ...]]":
    """Return the twin of a calibration or a pump at an operating point, and notes on it."""
    from swashtwin.calibration import Calibration
    from swashtwin.foundation import InputError
    from swashtwin.physics import Twin
    from swashtwin.pump import OperatingCondition

    changes = {}
    if speed is not None:
        changes["speed"] = parse_quantity(speed, "rad/s", name="--speed")
    if pressure is not None:
        changes["discharge_pressure"] = parse_quantity(pressure, "Pa", name="--pressure")

    (start,) = load_twin_sources([source])
    if isinstance(start, Calibration):
        twin = start.twin.at(start.twin.condition.replace(**changes))
        if fault is not None:
            twin = twin.with_fault(fault_from(fault))
        return twin, (start.doubt,) if start.doubt else ()

    pump = start
    if pump.rated is not None:
        changes = {
            "speed": pump.rated.speed,
            "discharge_pressure": pump.rated.discharge_pressure,
            **changes,
        }
    elif len(changes) < 2:
        raise InputError(
            f"{pump.name} has no rated operating point to start from. Specify --speed and "
            "--pressure."
        )
    return Twin(pump, OperatingCondition(**changes), fault_from(fault or "normal")), ()


def _recess_notes(twin: "Twin", fault: str | None) -> tuple[str, ...]:
    """Return how a twin leaves the range of its model, and the contact law that was selected."""
    from swashtwin.pump import SwashPlateDefect

    notes = twin.notes()
    if isinstance(twin.fault, SwashPlateDefect) and fault is not None and "contact" not in fault:
        law = (
            f"the contact law of the recess is contact={twin.fault.contact}, which suits its depth "
            f"of {twin.fault.depth * 1e3:.3g} mm."
        )
        return (law, *notes)
    return notes


def synthesize(
    twins: Annotated[
        list[str],
        typer.Argument(
            metavar="CALIBRATION|PUMP...",
            help="Calibration files, or pumps by name or file, which are nominal twins.",
        ),
    ],
    like: Annotated[
        Path,
        typer.Option(
            help="Index of the training recordings, which define layout, classes and noise."
        ),
    ],
    out: Annotated[Path, typer.Option(help="File of windows to write, for train --add.")],
    fill: FillOption = None,
    count: Annotated[
        int | None,
        typer.Option(min=1, help="Number of windows. With --fill: of each cell, default 72."),
    ] = None,
    fault: OptionalFault = None,
    fault_of: FaultOfOption = None,
    speed: Annotated[
        str | None,
        typer.Option(help='Speed of the twin, such as "1500 rpm". Default: the calibration\'s.'),
    ] = None,
    pressure: Annotated[
        str | None,
        typer.Option(
            help='Absolute discharge pressure of the twin, such as "10 MPa". Default: the '
            "calibration's."
        ),
    ] = None,
    window: OptionalWindow = None,
    seed: Seed = 0,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Simulate windows with twins, to train a classifier: of all classes alike, or of one.

    By default, windows are planned for the classes and operating points that are short of
    recordings, so that every class gets as many (--fill), and the plan is printed. With --count or
    --fault, a calibrated twin simulates one class at the operating points of its calibration, which
    may be a fault that it was not calibrated on.

    The interface values of each window of a calibration are drawn from the posterior, and its noise
    from the recordings of --like. These become training data: specify train.toml of a split. If
    --like has measured windows of a single class, the AUROC of separating them from the synthetic
    windows is printed (0.5 = indistinguishable), with the features that separate them.
    """
    is_single_class = fill is None and (count is not None or fault is not None)
    if not is_single_class:
        _refuse_options_of_one_class({"--fault": fault, "--speed": speed, "--pressure": pressure})
    elif fault_of:
        raise typer.BadParameter("applies to --fill. Use --fault.", param_hint="--fault-of")

    inputs = [*twin_files(twins), like]
    require_existing(inputs)
    require_output(out, inputs=inputs, force=force)
    job = _WindowJob(like=like, out=out, window=window, seed=seed, as_json=as_json)
    if not is_single_class:
        fault_texts = collect_fault_texts(like, fault_of)
        _fill_cells(job, build_filling(twins, fault_texts, fill=fill, count=count, seed=seed))
        return

    if len(twins) != 1 or not is_calibration(twins[0]):
        raise typer.BadParameter(
            "must be one calibration file if windows of one class are made. Several twins, and "
            "pumps, fill cells: add --fill, and name faults with --fault-of instead of --fault.",
            param_hint="CALIBRATION|PUMP",
        )
    if count is None:
        raise typer.BadParameter("is required with --fault.", param_hint="--count")
    _synthesize_class(job, Path(twins[0]), count, fault, speed=speed, pressure=pressure)


@dataclass(frozen=True)
class _WindowJob:
    """What windows are made like, and where they are written."""

    like: Path
    """Index of the training recordings."""
    out: Path
    window: int | None
    """Samples per window; None for the default."""
    seed: int
    as_json: bool


def _refuse_options_of_one_class(values: dict[str, str | None]) -> None:
    """Refuse an option, by its name, that applies only if windows of one class are made."""
    for option, value in values.items():
        if value is not None:
            raise typer.BadParameter(
                "applies to windows of one class, which --count without --fill makes. "
                "Specify the faults of several classes with --fault-of.",
                param_hint=option,
            )


def _fill_cells(job: _WindowJob, filling: "Filling") -> None:
    """Plan and write windows of all cells that are to be filled."""
    from swashtwin.learning import save_windows
    from swashtwin.recordings import load_recordings

    plan = filling.plan(load_recordings(job.like), window=job.window)
    plan.require_windows()
    if not job.as_json:
        print_plan(plan)

    windows = simulate_plan(plan)
    save_windows(windows, job.out)
    result = {
        "windows": job.out,
        "count": len(windows),
        "length": windows.length,
        "manifest": list(windows.manifest),
        "classes": windows.classes,
        "seed": job.seed,
        "filling": plan.to_dict(),
    }

    def show() -> None:
        print_text(f"{job.out}: {plural(len(windows), 'window')}")
        _print_next_command(job.like, job.out)

    print_result(result, job.as_json, show)


def _print_next_command(like: Path, out: Path) -> None:
    options = ("--test-fraction", 0, "--out", "model.safetensors")
    print_text(f"Next: {shell_command('train', like, '--add', out, *options)}")


def _synthesize_class(
    job: _WindowJob,
    calibration: Path,
    count: int,
    fault: str | None,
    *,
    speed: str | None,
    pressure: str | None,
) -> None:
    """Write windows of one class of a calibrated twin."""
    import swashtwin.synthesis as synthesis
    from swashtwin.calibration import load_calibration
    from swashtwin.learning import save_windows
    from swashtwin.recordings import load_recordings

    calibrated = load_calibration(calibration)
    if fault is not None:
        synthetic_fault = fault_from(fault)
    elif calibrated.law is not None:
        synthetic_fault = calibrated.law.fault
    else:
        synthetic_fault = calibrated.twin.fault
    new_speed = None if speed is None else parse_quantity(speed, "rad/s", name="--speed")
    new_pressure = None if pressure is None else parse_quantity(pressure, "Pa", name="--pressure")

    with progress("synthesizing") as bar:
        windows = synthesis.synthesize(
            calibrated,
            synthetic_fault,
            count=count,
            like=load_recordings(job.like),
            seed=job.seed,
            speed=new_speed,
            pressure=new_pressure,
            window=job.window,
            progress=bar,
        )
        # Measured while the progress is shown, for it takes as long as the windows.
        fidelity = windows.fidelity

    save_windows(windows, job.out)
    label = str(windows.label[0])
    result = {
        "windows": job.out,
        "label": label,
        "count": len(windows),
        "length": windows.length,
        "manifest": list(windows.manifest),
        "classes": windows.classes,
        "seed": job.seed,
        "notes": windows.notes,
        "fidelity": None if fidelity is None else fidelity.to_dict(),
    }

    def show() -> None:
        for text in windows.notes:
            print_note(f"note: {text}")
        print_text(f"{job.out}: {plural(len(windows), 'window')} of {label}")
        print_fidelity(fidelity, label)
        _print_next_command(job.like, job.out)

    print_result(result, job.as_json, show)


def print_fidelity(fidelity: "Fidelity | None", label: str) -> None:
    """Print how well a classifier separates synthetic from measured windows, and by what."""
    if fidelity is None:
        print_text(f"Fidelity unknown: --like has no measured window of {label}.")
        return

    windows = plural(fidelity.n_measured, "measured window")
    measured = f"{windows} of {plural(fidelity.n_recordings, 'recording')}"
    if fidelity.pressures:
        pressures = ", ".join(f"{pressure / 1e6:.4g}" for pressure in fidelity.pressures)
        measured += f" at {pressures} MPa"
    if fidelity.auroc is None:
        print_text(f"Fidelity unknown: {measured}. The AUROC requires two recordings of each.")
    else:
        print_text(
            f"Fidelity: AUROC {fidelity.auroc:.2f} for separating synthetic windows from "
            f"{measured} (0.5 = indistinguishable)"
        )

    if fidelity.causes_db:
        parts = ", ".join(f"{name} {value:.1f}" for name, value in fidelity.causes_db.items())
        print_text(f"Differences by cause [dB]: {parts}")
    print_table(
        "Features that separate them best",
        ("feature", "AUROC alone", "shift [std of measured]"),
        [
            (feature.name, f"{feature.auroc:.2f}", f"{feature.shift:+.1f}")
            for feature in fidelity.features
        ],
    )
