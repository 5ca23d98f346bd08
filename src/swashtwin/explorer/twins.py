"""Twins of a workspace: their lines over measured ones, calibration, windows, and new pumps."""

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, fields, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple

import numpy as np
from fastapi import Body

from swashtwin.explorer.calibration_job import CalibrationJob
from swashtwin.explorer.excerpts import describe_excerpts, excerpts
from swashtwin.explorer.workspace import Name, RecordingVersion, Workspace
from swashtwin.foundation import (
    DataError,
    FileStamp,
    InputError,
    MPa,
    PressureUnit,
    SwashTwinError,
    convert_pressures,
    file_stamp,
    plural,
    rpm,
    safe_file_name,
)
from swashtwin.pump import (
    FAULT_KINDS,
    PARAMETER_SYMBOLS,
    PARAMETERS,
    Fault,
    Interfaces,
    OperatingCondition,
    SwashPlateDefect,
    available_pumps,
    load_pump,
    new_pump,
    read_nameplate,
)
from swashtwin.recordings import INDEX_NAME, Recording, Recordings
from swashtwin.report import MeasuredTurn, describe_turn, render_cutaway

if TYPE_CHECKING:
    from swashtwin.calibration import Calibration, MeasuredLines
    from swashtwin.explorer.mean_turn import MeanTurn
    from swashtwin.physics import Twin

MIN_BANDWIDTH_HZ = 3000.0
"""Bandwidth of a twin without a calibration, unless its first piston-pass line lies above."""
ORDER_MARGIN = 1.25
"""Orders of a mean turn over those of the twin at its speed: the page lowers it by up to 20 %."""
RESULT = "result"
"""Name of the start that the last calibration made."""

# Bytes of a file from which its kind is recognized.
_PEEK_BYTES = 4096

_NAMEPLATE_QUANTITIES = ("displacement", "speed", "pressure", "mass")

# Operating point of a pump that states no rated one.
_DEFAULT_CONDITION = OperatingCondition(rpm(1500), MPa(15))

LineKind = Literal["piston", "shaft"]
"""Lines that a twin has: harmonics of the pistons, or of the shaft if a piston is faulty."""


@dataclass(frozen=True)
class Setting:
    """A twin as the controls of the page describe it."""

    start: str
    """Name of one of `TwinWorkbench.starts`."""
    values: list[float] | None = None
    """The six values in the order of `pump.PARAMETERS`; `None` for those of the start."""
    scales: dict[str, float] = field(default_factory=dict)
    """Factors of `Scales` relative to those of the start."""
    rpm: float | None = None
    """Speed; `None` for that of the recording, or else of the start."""
    mpa: float | None = None
    """Discharge pressure, likewise."""
    fault: str = "start"
    """Kind of `FAULT_KINDS`, empty for a healthy pump, or ``start`` for that of the start."""
    dimensions: dict[str, float] = field(default_factory=dict)
    """Dimensions of the fault in SI units."""
    recording: str = ""
    """Recording whose lines are compared; empty for those of the start's calibration."""

    @property
    def has_changed_values(self) -> bool:
        """Whether a value or a scale differs from that of the start."""
        return self.values is not None or any(factor != 1 for factor in self.scales.values())


class _Start(NamedTuple):
    twin: "Twin"
    """Twin at its operating point."""
    calibration: "Calibration | None"
    """Calibration that made it."""


class TwinWorkbench:
    """Twins of one workspace: pumps, saved calibrations, and the last calibration made here.

    Parameters
    ----------
    pressure_unit : unit in which pressures are shown.
    """

    def __init__(self, workspace: Workspace, pressure_unit: PressureUnit = "MPa") -> None:
        self._workspace = workspace
        self._pressure_unit = pressure_unit
        self._base_twin: tuple[Any, Twin] | None = None
        self._measured_lines = lru_cache(maxsize=32)(self._measure)
        self._mean_turn = lru_cache(maxsize=32)(self._average_turns)
        self._load_start = lru_cache(maxsize=8)(_load_start)
        self._start_names: set[str] = set()
        self.job = CalibrationJob()

    def starts(self) -> dict[str, Any]:
        """Return pumps and calibrations to start from, and faults with their dimensions."""
        pumps = []
        calibrations = []
        for path in sorted(self._workspace.folder.glob("*")):
            if path.suffix not in (".toml", ".json") or not path.is_file():
                continue
            head = _read_head(path)
            if '"format": "swashtwin calibration' in head:
                calibrations.append(path.name)
            elif path.name != INDEX_NAME and ("rotating_group" in head or "like =" in head):
                pumps.append(path.name)

        # The calibration that the explorer was opened with comes first.
        opened_calibration = self._workspace.calibration
        if opened_calibration is not None:
            calibrations = [name for name in calibrations if name != opened_calibration.name]
            calibrations.insert(0, opened_calibration.name)

        names = [*calibrations, *pumps, *available_pumps()]
        if self.job.result is not None:
            names.insert(0, RESULT)
        self._start_names = set(names)
        return {
            "starts": names,
            "faults": _describe_faults(),
            "letters": [PARAMETER_SYMBOLS[name] for name in PARAMETERS],
        }

    def _start(self, name: str) -> _Start:
        """Return the twin of a start, and the calibration that made it."""
        if name == RESULT and self.job.result is not None:
            return _Start(self.job.result.twin, self.job.result)

        # Only listed names are opened, so that none leads out of the folder.
        if name not in self._start_names and name not in self.starts()["starts"]:
            raise InputError(f"There is no pump or calibration {name[:100]!r} here.")
        path = self._workspace.folder / name
        if path.suffix in (".toml", ".json"):
            return self._load_start(path, file_stamp(path))
        return self._load_start(name, None)

    def _twin(self, setting: Setting) -> _Start:
        """Return the twin that a setting describes, and the calibration it started from.

        Building a twin takes long, changing its values does not. The last twin is therefore kept,
        and reused while only values change.
        """
        start = self._start(setting.start)
        condition = self._condition(setting, start.twin)
        fault = start.twin.fault
        if setting.fault != "start":
            fault = _make_fault(setting)

        key = start.twin, condition, fault
        if self._base_twin is None or self._base_twin[0] != key:
            self._base_twin = key, replace(start.twin, condition=condition, fault=fault)
        base_twin = self._base_twin[1]

        values = setting.values
        if values is None:
            values = start.twin.values.tolist()
        scales = start.twin.scales
        factors = {
            scale.name: getattr(scales, scale.name) * setting.scales.get(scale.name, 1.0)
            for scale in fields(scales)
        }
        twin = base_twin.with_interfaces(Interfaces.from_values(values), replace(scales, **factors))
        return _Start(twin, start.calibration)

    def _condition(self, setting: Setting, twin: "Twin") -> OperatingCondition:
        """Return the operating point of a setting, of its recording, or of the start's twin."""
        condition = twin.condition
        if setting.recording:
            condition = self._workspace.recording(setting.recording).condition or condition
        if setting.rpm:
            condition = condition.replace(speed=rpm(setting.rpm))
        if setting.mpa:
            condition = condition.replace(discharge_pressure=MPa(setting.mpa))
        return condition

    def lines(self, setting: Setting) -> dict[str, Any]:
        """Return the line amplitudes of a twin, the measured ones, their misfit, and one turn."""
        import torch

        twin, calibration = self._twin(setting)
        with torch.no_grad():
            twin_lines = twin.acceleration().numpy()
        amplitude = np.abs(twin_lines)

        content = _describe_twin(twin, calibration)
        content |= {"amplitude": amplitude, "measured": None, "reason": ""}
        content["turn_source"] = ""
        turn = None
        try:
            measured = self._lines_to_compare(setting, twin, calibration)
        except SwashTwinError as cause:
            measured = None
            content["reason"] = convert_pressures(str(cause), self._pressure_unit)
        if measured is not None:
            content["measured"] = _describe_misfit(twin, amplitude, measured)
            content["measured"]["excerpts"] = self._describe_excerpt(setting)
            turn, content["turn_source"] = self._measured_turn(setting, twin, twin_lines)
        content["turn"] = describe_turn(twin, self._pressure_unit, turn)
        return content

    def _measured_turn(
        self, setting: Setting, twin: "Twin", twin_lines: np.ndarray
    ) -> tuple[MeasuredTurn | None, str]:
        """Return the mean turn of the selected recording at the twin's shaft angle.

        The second value states where it comes from, or why there is none.
        """
        from swashtwin.explorer.mean_turn import align_turn

        if not setting.recording:
            return None, ""
        version = self._workspace.version(setting.recording)
        try:
            mean_turn = self._mean_turn(version, self._start(setting.start).twin)
        except SwashTwinError as cause:
            return None, f"No measured waveform: {cause}"

        aligned = align_turn(mean_turn, twin, twin_lines)
        source = (
            f"Measured waveform: mean of {plural(mean_turn.n_turns, 'turn')}, at the shaft angle "
            "at which it correlates best with the twin's over all sensors (correlation "
            f"{aligned.correlation:.2f})."
        )
        return MeasuredTurn(mean_turn.channels, aligned.waveform), source

    def _average_turns(self, version: RecordingVersion, twin: "Twin") -> "MeanTurn":
        from swashtwin.explorer.mean_turn import average_turns

        recording = self._excerpt_of_pump(version, twin)
        condition = _require_condition(version.name, recording)
        max_order = math.ceil(ORDER_MARGIN * twin.bandwidth / condition.shaft_frequency)
        return average_turns(recording, twin.pump.rotating_group.piston_count, max_order)

    def _describe_excerpt(self, setting: Setting) -> str:
        """Return the part of the selected recording whose lines are measured; empty for all."""
        if not setting.recording:
            return ""
        recording = self._workspace.recording(setting.recording)
        return describe_excerpts(excerpts(recording, 1), recording)

    def _lines_to_compare(
        self, setting: Setting, twin: "Twin", calibration: "Calibration | None"
    ) -> "MeasuredLines | None":
        """Return the lines of the selected recording, or those that the calibration used."""
        from swashtwin.calibration import MeasuredLines

        if setting.recording:
            piston_count = twin.pump.rotating_group.piston_count
            is_shaft_line = (twin.orders % piston_count > 0) & (twin.orders > 1)
            lines: LineKind = "piston"
            if is_shaft_line.any():
                lines = "shaft"
            version = self._workspace.version(setting.recording)
            start = self._start(setting.start)
            return self._measured_lines(version, start.twin, setting.fault, lines)
        if calibration is None:
            return None

        spectra = calibration.fits[0].spectra
        return MeasuredLines(spectra.channels, spectra.orders, spectra.measured, spectra.deviation)

    def _measure(
        self, version: RecordingVersion, twin: "Twin", fault: str, lines: LineKind
    ) -> "MeasuredLines":
        """Measure the lines of a recording as if it were of the twin's class."""
        from swashtwin.calibration import DEFAULT_BAND, MeasuredLines, measure

        recording = self._excerpt_of_pump(version, twin)
        assumed_fault = twin.fault
        if fault != "start":
            assumed_fault = FAULT_KINDS.get(fault)
        condition = _require_condition(version.name, recording)
        twin = replace(twin, condition=condition, fault=assumed_fault)

        labeled = recording.replace(label=twin.label)
        measurement = measure(twin, [labeled], DEFAULT_BAND, lines)
        return MeasuredLines(
            measurement.channels, measurement.orders, measurement.amplitude, measurement.deviation
        )

    def _excerpt_of_pump(self, version: RecordingVersion, twin: "Twin") -> Recording:
        """Return a recording, or an excerpt from the middle of a long one, as of a twin's pump."""
        from swashtwin.calibration import assign_single_channels

        excerpt = excerpts(self._workspace.recording(version.name), 1)[0]
        return assign_single_channels([excerpt], twin.pump)[0][0]

    def calibrate(
        self, setting: Setting, comparable: Annotated[bool, Body()] = False
    ) -> dict[str, Any]:
        """Start to calibrate the twin of a setting on its recording.

        Parameters
        ----------
        comparable : whether to use also recordings of the same machine, class and operating point.

        Raises
        ------
        InputError
            No recording is selected, or a calibration runs already.
        DataError
            The recording has no operating point.
        """
        if not setting.recording:
            raise InputError("Select a recording to calibrate on.")

        twin, _ = self._twin(setting)
        first_recording = self._workspace.recording(setting.recording)
        condition = _require_condition(setting.recording, first_recording)
        names = [setting.recording]
        if comparable:
            names += self._workspace.comparable(setting.recording)

        recordings = [self._workspace.recording(name) for name in names]
        labeled = [
            recording if recording.label else recording.replace(label=twin.label)
            for recording in recordings
        ]
        self.job.start(twin.at(condition), Recordings(labeled))
        return self.job.progress()

    def progress(self) -> dict[str, Any]:
        """Return the progress of the calibration."""
        return self.job.progress()

    def stop(self) -> dict[str, Any]:
        """Stop the calibration."""
        self.job.stop()
        return self.job.progress()

    def cutaway(self, label: Name, pistons: int, shaft: float) -> dict[str, Any]:
        """Return a drawing of the pump, cut open, with the part of a class marked."""
        return {"html": render_cutaway(label, pistons, shaft)}

    def save(self, name: Annotated[str, Body(embed=True)]) -> dict[str, Any]:
        """Save the last calibration in the folder of the recordings."""
        if self.job.result is None:
            raise InputError("There is no calibration to save yet.")
        return {"file": self._write_new(name, ".json", self.job.result.save)}

    def add_windows(
        self,
        setting: Setting,
        count: Annotated[int, Body(ge=1, le=10_000)],
        name: Annotated[str, Body()],
    ) -> dict[str, Any]:
        """Synthesize windows of a twin, and save them in the folder of the recordings."""
        from swashtwin.learning import save_windows
        from swashtwin.synthesis import synthesize

        twin, calibration = self._twin(setting)
        like = [
            recording
            for _, recording in self._workspace.ready_recordings()
            if recording.label and set(recording.channels) <= set(twin.pump.channels)
        ]

        # The posterior of a calibration does not describe a twin that was changed by hand.
        source: Calibration | Twin = twin
        if calibration is not None and not setting.has_changed_values:
            source = calibration
        windows = synthesize(source, twin.fault, count=count, like=Recordings(like))
        file = self._write_new(name, ".safetensors", lambda path: save_windows(windows, path))
        return {
            "file": file,
            "count": len(windows),
            "label": str(windows.label[0]),
            "notes": windows.notes,
        }

    def add_pump(
        self, name: Annotated[str, Body()], plate: Annotated[dict[str, str], Body()]
    ) -> dict[str, Any]:
        """Write the file of a pump scaled to a nameplate in the folder of the recordings."""
        try:
            piston_count = int(plate.get("pistons", ""))
        except ValueError:
            raise InputError(
                f"pistons ({plate.get('pistons')!r}) must be a whole number."
            ) from None

        quantities = {key: plate[key] for key in _NAMEPLATE_QUANTITIES if plate.get(key)}
        missing_names = {"displacement", "speed", "pressure"} - quantities.keys()
        if missing_names:
            raise InputError(f"The nameplate lacks {', '.join(sorted(missing_names))}.")

        nameplate = read_nameplate(pistons=piston_count, **quantities)
        path = new_pump(name, nameplate=nameplate, folder=self._workspace.folder)
        return {"start": path.name, **self.starts()}

    def _write_new(self, name: str, suffix: str, write: Callable[[Path], object]) -> str:
        """Write a new file in the folder of the recordings, and return its name."""
        stem = name.strip().removesuffix(suffix)
        if not stem or safe_file_name(stem) != stem:
            raise InputError(
                f"Invalid file name {name[:100]!r}: use letters, digits, '-', '_' and '.'."
            )

        path = self._workspace.folder / f"{stem}{suffix}"
        if path.exists():
            raise InputError(f"{path} already exists. Use another name.")
        write(path)
        return path.name


def _describe_faults() -> list[dict[str, Any]]:
    """Return the kinds of faults with their dimensions and typical values."""
    from swashtwin.calibration import get_severity_search

    faults = []
    for kind, typical in FAULT_KINDS.items():
        if typical is None:
            continue
        dimensions = [
            {**asdict(dimension), "typical": getattr(typical, dimension.name)}
            for dimension in get_severity_search(typical).dimensions
        ]
        faults.append({"kind": kind, "label": typical.label, "dimensions": dimensions})
    return faults


def _describe_twin(twin: "Twin", calibration: "Calibration | None") -> dict[str, Any]:
    estimates = []
    notes: list[str] = []
    if calibration is not None:
        notes = list(calibration.notes)
        estimates = [
            {**asdict(estimate), "open": estimate.open_sides} for estimate in calibration.estimates
        ]

    return {
        "pump": twin.pump.name,
        "pistons": twin.pump.rotating_group.piston_count,
        "displacement": twin.pump.rotating_group.displacement,
        "channels": twin.pump.channels,
        "label": twin.label,
        "shaft": twin.condition.shaft_frequency,
        "rpm": 60 * twin.condition.shaft_frequency,
        "mpa": twin.condition.discharge_pressure / 1e6,
        "values": twin.values.tolist(),
        "nominal": twin.pump.interfaces.values(),
        "orders": twin.orders,
        "estimates": estimates,
        "notes": notes,
    }


def _describe_misfit(
    twin: "Twin", amplitude: np.ndarray, measured: "MeasuredLines"
) -> dict[str, Any]:
    from swashtwin.calibration import compare_lines

    misfit = compare_lines(twin, amplitude, measured)
    return {
        "channels": measured.channels,
        "orders": measured.orders,
        "amplitude": measured.amplitude,
        "deviation": measured.deviation,
        "misfit": misfit.level_difference,
        "correlation": misfit.spectral_correlation,
        "error": misfit.spectrum_value_error,
    }


def _load_start(source: str | Path, _: FileStamp | None) -> _Start:
    """Load a calibration or a pump; the second argument renews the cache when the file changes."""
    from swashtwin.calibration import load_calibration
    from swashtwin.physics import Twin

    if isinstance(source, Path) and source.suffix == ".json":
        calibration = load_calibration(source)
        return _Start(calibration.twin, calibration)

    pump = load_pump(source)
    condition = _DEFAULT_CONDITION
    if pump.rated is not None:
        condition = OperatingCondition(pump.rated.speed, pump.rated.discharge_pressure)

    # A twin needs at least its first piston-pass line.
    piston_pass_hz = pump.rotating_group.piston_count * condition.shaft_frequency
    bandwidth = max(MIN_BANDWIDTH_HZ, 1.05 * piston_pass_hz)
    return _Start(Twin(pump, condition, bandwidth=bandwidth), None)


def _require_condition(name: str, recording: Recording) -> OperatingCondition:
    if recording.condition is None:
        raise DataError(f"{name} has no speed and pressure. Specify both in its facts.")
    return recording.condition


def _read_head(path: Path) -> str:
    with path.open("rb") as file:
        return file.read(_PEEK_BYTES).decode("utf-8", "replace")


def _make_fault(setting: Setting) -> Fault | None:
    """Return the fault of a setting; `None` for a healthy pump."""
    if not setting.fault:
        return None
    typical = FAULT_KINDS.get(setting.fault)
    if typical is None:
        raise InputError(f"There is no fault {setting.fault[:100]!r}.")

    unknown_names = sorted(
        setting.dimensions.keys() - {dimension.name for dimension in fields(typical)}
    )
    if unknown_names:
        raise InputError(f"{setting.fault} has no dimension {unknown_names[0][:100]!r}.")

    fault = replace(typical, **setting.dimensions)
    if fault.severity == 0:
        return None
    if isinstance(fault, SwashPlateDefect):
        return fault.with_fitting_contact()
    return fault
