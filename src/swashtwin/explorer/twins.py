"""The twin's room: lines over the measured ones, a calibration that can be stopped, windows, and
new pumps.
"""

import math
import threading
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, fields, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from fastapi import Body

from swashtwin.explorer.workspace import Name, Workspace
from swashtwin.foundation import DataError, InputError, MPa, SwashTwinError, rpm, safe_file_name
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
from swashtwin.recordings import INDEX_NAME, Recordings
from swashtwin.report import render_cutaway
from swashtwin.signals import spectral_correlation, spectrum_value_error

if TYPE_CHECKING:
    from swashtwin.calibration import Calibration
    from swashtwin.physics import Twin

BANDWIDTH = 3000.0
"""Highest frequency [Hz] of a twin that no calibration made."""
BAND = (0.0, 2500.0)
"""Lines [Hz] that are compared."""
RESULT = "result"
"""Name of the start that the last calibration made."""
_HEAD = 4096


@dataclass(frozen=True)
class Setting:
    """A twin as the page's sliders say."""

    start: str
    """Name of one of `TwinWorkbench.starts`."""
    values: list[float] | None = None
    """The six values in the order of `pump.PARAMETERS`; None takes those of the start."""
    scales: dict[str, float] = field(default_factory=dict)
    """Factors of `Scales` over those of the start."""
    rpm: float | None = None
    """Speed; None takes the recording's, or else the start's."""
    mpa: float | None = None
    """Discharge pressure, likewise."""
    fault: str = "start"
    """Kind of `FAULT_KINDS`, empty for a healthy pump, or ``start``."""
    dimensions: dict[str, float] = field(default_factory=dict)
    """Dimensions of the fault in SI units."""
    recording: str = ""
    """Recording whose lines are compared; empty for those of the start's calibration."""


@dataclass
class Job:
    """A calibration that runs."""

    state: str = "none"
    """``none``, ``running``, ``stopped``, ``failed`` or ``done``."""
    done: int = 0
    total: int = 0
    loss: float | None = None
    error: str = ""
    is_stopped: bool = False
    result: "Calibration | None" = None


class _StoppedError(Exception):
    """Somebody stopped the calibration."""


class TwinWorkbench:
    """Twins of one workspace: pumps, calibrations beside its recordings, and what was calibrated
    here.
    """

    def __init__(self, workspace: Workspace) -> None:
        self._workspace = workspace
        self._last: tuple[Any, Twin] | None = None
        self._measured = lru_cache(maxsize=32)(self._measure)
        self._loaded = lru_cache(maxsize=8)(_load)
        self._names: set[str] = set()
        self.job = Job()

    def starts(self) -> dict[str, Any]:
        """Pumps and calibrations to start from, and faults with their dimensions."""
        from swashtwin.calibration import get_severity_search

        folder, own = self._workspace.folder, self._workspace.calibration
        files = [
            path
            for path in sorted(folder.glob("*"))
            if path.suffix in (".toml", ".json") and path.is_file()
        ]
        pumps = [
            path.name
            for path in files
            if path.name != INDEX_NAME and _begins(path, "rotating_group", "like =")
        ]
        calibrations = [
            path.name for path in files if _begins(path, '"format": "swashtwin calibration')
        ]
        if own is not None:
            calibrations = [own.name, *(name for name in calibrations if name != own.name)]
        names = (
            [RESULT] * (self.job.result is not None)
            + calibrations
            + pumps
            + list(available_pumps())
        )
        faults = [
            {"kind": kind, "label": typical.label, "dimensions": [
                {**asdict(item), "typical": getattr(typical, item.name)} for item in get_severity_search(typical).dimensions
            ]}
            for kind, typical in FAULT_KINDS.items() if typical is not None
        ]  # fmt: skip
        self._names = set(names)
        return {
            "starts": names,
            "faults": faults,
            "letters": [PARAMETER_SYMBOLS[name] for name in PARAMETERS],
        }

    def _start(self, name: str) -> "tuple[Twin, Calibration | None]":
        """Twin of a start at its own operating point, and the calibration that made it."""
        if name == RESULT and self.job.result is not None:
            return self.job.result.twin, self.job.result
        path = self._workspace.folder / name
        if name not in self._names and name not in self.starts()["starts"]:
            raise InputError(f"there is no pump or calibration {name[:100]!r} here.")
        is_file = path.suffix in (".toml", ".json")
        return self._loaded(path if is_file else name, path.stat().st_mtime_ns if is_file else 0)

    def _twin(self, setting: Setting) -> "tuple[Twin, Calibration | None]":
        """The twin that a setting describes; of one that differs from the last in values only, the
        rest is kept.
        """
        twin, calibration = self._start(setting.start)
        recording = self._workspace.recording(setting.recording) if setting.recording else None
        condition = (recording and recording.condition) or twin.condition
        changes = {
            "speed": setting.rpm and setting.rpm * math.pi / 30,
            "discharge_pressure": setting.mpa and setting.mpa * 1e6,
        }
        condition = condition.replace(**{name: value for name, value in changes.items() if value})
        fault = twin.fault if setting.fault == "start" else _fault(setting)
        key = setting.start, id(calibration), condition, fault
        if self._last is None or self._last[0] != key:
            self._last = key, replace(twin, condition=condition, fault=fault)
        values = twin.values.numpy() if setting.values is None else setting.values
        factors = {
            item.name: getattr(twin.scales, item.name) * setting.scales.get(item.name, 1.0)
            for item in fields(twin.scales)
        }
        moved = self._last[1].with_interfaces(
            Interfaces.from_values(values), replace(twin.scales, **factors)
        )
        return moved, calibration

    def lines(self, setting: Setting) -> dict[str, Any]:
        """Line amplitudes of a twin, those measured, and how far they are apart."""
        import torch

        twin, calibration = self._twin(setting)
        with torch.no_grad():
            amplitude = np.abs(twin.acceleration().numpy())
        count, shaft = twin.pump.rotating_group.piston_count, twin.condition.shaft_frequency
        by_shaft = bool(((twin.orders % count > 0) & (twin.orders > 1)).any())
        result: dict[str, Any] = {
            "orders": twin.orders, "amplitude": amplitude, "channels": twin.pump.channels, "shaft": shaft,
            "pistons": count, "values": twin.values.tolist(), "label": twin.label, "rpm": 60 * shaft,
            "pump": twin.pump.name, "mpa": twin.condition.discharge_pressure / 1e6,
            "displacement": twin.pump.rotating_group.displacement,
            "estimates": [{**asdict(item), "open": item.open_sides} for item in calibration.estimates] if calibration
            else [],
            "notes": [] if calibration is None else calibration.notes, "measured": None, "reason": "",
        }  # fmt: skip
        try:
            if setting.recording:
                facts = repr(self._workspace.rows[setting.recording].stated)
                found = self._measured(
                    setting.recording, facts, setting.start, setting.fault, by_shaft
                )
            elif calibration is not None:
                spectra = calibration.fits[0].spectra
                found = spectra.channels, spectra.orders, spectra.measured, spectra.deviation
            else:
                return result
        except SwashTwinError as cause:
            return {**result, "reason": str(cause)}
        channels, orders, measured, deviation = found
        rows = [twin.pump.channels.index(name) for name in channels]
        simulated = np.zeros_like(measured)
        has, at = np.isin(orders, twin.orders), np.searchsorted(twin.orders, orders)
        simulated[:, has] = amplitude[rows][:, at[has]]
        is_clear = measured > deviation
        misfit = 20 * np.log10(np.maximum(simulated, 1e-12) / np.where(is_clear, measured, np.nan))
        result["measured"] = {
            "channels": channels, "orders": orders, "amplitude": measured, "deviation": deviation, "misfit": misfit,
            "correlation": spectral_correlation(measured, simulated),
            "error": spectrum_value_error(measured, simulated),
        }  # fmt: skip
        return result

    def _measure(
        self, name: str, _: str, start: str, fault: str, by_shaft: bool
    ) -> tuple[Any, ...]:
        """Channels, orders, amplitudes and deviations of a recording's lines, taken for one of the
        twin's class.
        """
        from swashtwin.calibration import assign_single_channels, measure

        twin = self._start(start)[0]
        recording = assign_single_channels([self._workspace.recording(name)], twin.pump)[0][0]
        if recording.condition is None:
            raise DataError(f"{name} states no speed and pressure; state both in its facts.")
        its_fault = twin.fault if fault == "start" else FAULT_KINDS.get(fault)
        twin = replace(twin, condition=recording.condition, fault=its_fault)
        lines = measure(
            twin, [recording.replace(label=twin.label)], BAND, "shaft" if by_shaft else "piston"
        )
        return lines.channels, lines.orders, lines.amplitude, lines.deviation

    def calibrate(
        self, setting: Setting, others: Annotated[bool, Body()] = False
    ) -> dict[str, Any]:
        """Start to calibrate the twin of a setting on its recording, and on those of the same
        machine, class and point.

        Raises
        ------
        InputError
            One runs already, or no recording is chosen.
        """
        from swashtwin.calibration import calibrate

        if self.job.state == "running":
            raise InputError("a calibration runs already; stop it first.")
        if not setting.recording:
            raise InputError("choose a recording to calibrate on.")
        twin, _ = self._twin(setting)
        first = self._workspace.recording(setting.recording)
        if first.condition is None:
            raise DataError(
                f"{setting.recording} states no speed and pressure; state both in its facts."
            )
        names = [setting.recording, *(self._workspace.alike(setting.recording) if others else ())]
        found = [self._workspace.recording(name) for name in names]
        chosen = [item if item.label else item.replace(label=twin.label) for item in found]
        job = self.job = Job("running", result=self.job.result)

        def progress(done: int, total: int, loss: float) -> None:
            job.done, job.total, job.loss = done, total, float(loss)
            if job.is_stopped:
                raise _StoppedError

        def run() -> None:
            try:
                job.result = calibrate(
                    twin.at(first.condition or twin.condition),
                    Recordings(chosen),
                    progress=progress,
                )
                job.state = "done"
            except _StoppedError:
                job.state = "stopped"
            except Exception as cause:
                job.state, job.error = (
                    "failed",
                    str(cause) if isinstance(cause, SwashTwinError) else repr(cause),
                )

        threading.Thread(target=run, daemon=True).start()
        return self.progress()

    def progress(self) -> dict[str, Any]:
        """How far the calibration is."""
        job = self.job
        return {
            "state": job.state,
            "done": job.done,
            "total": job.total,
            "loss": job.loss,
            "error": job.error,
        }

    def stop(self) -> dict[str, Any]:
        """Stop the calibration."""
        self.job.is_stopped = True
        return self.progress()

    def cutaway(self, label: Name, pistons: int, shaft: float) -> dict[str, Any]:
        """The pump, cut open, with the part of a class marked."""
        return {"html": render_cutaway(label, pistons, shaft)}

    def save(self, name: Annotated[str, Body(embed=True)]) -> dict[str, Any]:
        """Save the last calibration beside the recordings."""
        if self.job.result is None:
            raise InputError("nothing was calibrated here yet.")
        return {"file": self._written(name, ".json", self.job.result.save)}

    def add_windows(
        self,
        setting: Setting,
        count: Annotated[int, Body(ge=1, le=10_000)],
        name: Annotated[str, Body()],
    ) -> dict[str, Any]:
        """Make synthetic windows of the twin of a setting, and save them beside the recordings."""
        from swashtwin.learning import save_windows
        from swashtwin.synthesis import synthesize

        twin, calibration = self._twin(setting)
        like = [
            row.recording
            for row in self._workspace.rows.values()
            if row.recording is not None and row.state == "ready"
        ]
        like = [
            recording
            for recording in like
            if recording.label and set(recording.channels) <= set(twin.pump.channels)
        ]
        is_moved = setting.values is not None or any(
            factor != 1 for factor in setting.scales.values()
        )
        windows = synthesize(
            twin if calibration is None or is_moved else calibration,
            twin.fault,
            count=count,
            like=Recordings(like),
        )
        path = self._written(name, ".safetensors", lambda target: save_windows(windows, target))
        return {
            "file": path,
            "count": len(windows),
            "label": str(windows.label[0]),
            "notes": windows.notes,
        }

    def add_pump(
        self, name: Annotated[str, Body()], plate: Annotated[dict[str, str], Body()]
    ) -> dict[str, Any]:
        """Write the file of a pump scaled to a nameplate beside the recordings."""
        try:
            pistons = int(plate.get("pistons", ""))
        except ValueError:
            raise InputError(
                f"pistons ({plate.get('pistons')!r}) must be a whole number."
            ) from None
        told = {
            key: plate[key]
            for key in ("displacement", "speed", "pressure", "mass")
            if plate.get(key)
        }
        if missing := {"displacement", "speed", "pressure"} - told.keys():
            raise InputError(f"a nameplate states {', '.join(sorted(missing))} too.")
        path = new_pump(
            name, nameplate=read_nameplate(pistons=pistons, **told), folder=self._workspace.folder
        )
        return {"start": path.name, **self.starts()}

    def _written(self, name: str, suffix: str, write: Callable[[Path], object]) -> str:
        stem = name.strip().removesuffix(suffix)
        if not stem or safe_file_name(stem) != stem:
            raise InputError(
                f"{name[:100]!r} cannot name a file; use letters, digits, '-', '_' and '.'."
            )
        path = self._workspace.folder / f"{stem}{suffix}"
        if path.exists():
            raise InputError(
                f"{path} exists already, and nothing is overwritten; choose another name."
            )
        write(path)
        return path.name


def _load(name: str | Path, _: int) -> "tuple[Twin, Calibration | None]":
    from swashtwin.calibration import load_calibration
    from swashtwin.physics import Twin

    if isinstance(name, Path) and name.suffix == ".json":
        calibration = load_calibration(name)
        return calibration.twin, calibration
    pump = load_pump(name)
    point = OperatingCondition(rpm(1500), MPa(15))
    if pump.rated is not None:
        point = OperatingCondition(pump.rated.speed, pump.rated.discharge_pressure)
    least = 1.05 * pump.rotating_group.piston_count * point.shaft_frequency
    return Twin(pump, point, bandwidth=max(BANDWIDTH, least)), None


def _begins(path: Path, *words: str) -> bool:
    with path.open("rb") as file:
        head = file.read(_HEAD).decode("utf-8", "replace")
    return any(word in head for word in words)


def _fault(setting: Setting) -> Fault | None:
    if not setting.fault:
        return None
    typical = FAULT_KINDS.get(setting.fault)
    if typical is None:
        raise InputError(f"there is no fault {setting.fault[:100]!r}.")
    known = {item.name for item in fields(typical)}
    if other := setting.dimensions.keys() - known:
        raise InputError(f"{setting.fault} has no dimension {sorted(other)[0][:100]!r}.")
    fault = replace(typical, **setting.dimensions)
    if fault.severity == 0:
        return None
    return fault.with_fitting_contact() if isinstance(fault, SwashPlateDefect) else fault
