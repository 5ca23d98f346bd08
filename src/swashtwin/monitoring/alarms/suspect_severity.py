"""The severity of an alarm's suspect, measured by a calibrated twin in another process.

That takes minutes, and memory that would not be returned to the system.
"""

import logging
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from swashtwin.foundation import ChildProcess, DataError, SwashTwinError
from swashtwin.monitoring.alarms.operating_point import OperatingPoint
from swashtwin.monitoring.alarms.suspect import describe_class
from swashtwin.monitoring.config.settings import Machine
from swashtwin.pump import FAULT_KINDS, Fault, load_pump, read_severity
from swashtwin.recordings import Recording, load_recordings

if TYPE_CHECKING:
    from swashtwin.calibration import Calibration, SeverityTrend

N_POINTS = 60
"""Newest severities of an alarm that are kept: what is older says little about the growth now."""
MEASURE_TIMEOUT_S = 1200.0
"""Time limit for measuring a severity, which takes some minutes."""
_log = logging.getLogger("swashtwin.watch")


@dataclass(frozen=True)
class SeverityRequest:
    """A recording of a machine with a fault, whose severity its calibrated twin measures."""

    machine: Machine
    """Machine with a calibration."""
    label: str
    """Class of the fault."""
    recording: Path | None
    """File of the recording; None if its samples were not kept."""
    time: datetime
    """When the recording was made."""
    healthy: tuple[Path, ...] = ()
    """Files of healthy recordings of the machine at the same operating point."""
    course: tuple[Mapping[str, Any], ...] = ()
    """Earlier severities of the same alarm, each as ``course`` of an answer holds them."""

    def measure(self) -> dict[str, Any]:
        """Return severity, 90 % interval, detection limit and doubts, as JSON can hold them.

        Raises
        ------
        SwashTwinError
            A package is missing; the calibration is for another pump or operating point, or does
            not have the fault; or the samples were not kept.
        """
        # Only the child process loads these packages, which take memory.
        from swashtwin.calibration import estimate_severity, load_calibration

        assert self.machine.calibration is not None
        calibration = load_calibration(self.machine.calibration)
        _require_same_pump(calibration, self.machine)
        faults = _faults_of_class(self.label)
        if self.recording is None:
            raise DataError("the samples of the recording were not kept.")

        recording = self._load(self.recording, label=None)
        healthy_recordings = [self._load(path, label="normal") for path in self.healthy]
        _require_calibrated_point(calibration, recording)

        # Several kinds of fault may have one class; the one that fits best is reported.
        trends = {
            kind: estimate_severity(calibration, [recording], fault, healthy=healthy_recordings)
            for kind, fault in faults.items()
        }
        severity = _describe_best_fit(trends)
        return severity | self._follow(severity["sentence"], severity.pop("point"))

    def _follow(self, sentence: str, point: dict[str, Any]) -> dict[str, Any]:
        """Return the course of the severity with this point; and if a limit is configured, the
        remaining time, and the sentence with it.
        """
        from swashtwin.calibration import SeverityPoint, extrapolate_severities

        kind = point["kind"]
        time = self.time.isoformat()
        # the same recording may be measured again
        earlier = [before for before in self.course if before["time"] != time]
        course = [*earlier, {"time": time, **point}][-N_POINTS:]
        if kind not in self.machine.severity_limits:
            return {"course": course}

        limit = self.machine.severity_limits[kind]
        points = [
            SeverityPoint(
                datetime.fromisoformat(entry["time"]),
                entry["value"],
                tuple(entry["interval"]),
                entry["verdict"],
                entry["repeatability"],
            )
            for entry in course
            # another kind of fault has another dimension
            if entry["kind"] == kind
        ]
        life = extrapolate_severities(points, read_severity(kind, limit))
        return {
            "course": course,
            "remaining_life": life.to_dict(),
            "sentence": f"{sentence} Remaining time until {limit}: {life.text}.",
        }

    def _load(self, path: Path, label: str | None) -> Recording:
        recording = load_recordings(path)[0]
        return recording.replace(label=label, specimen=self.machine.name)


def measure_severity(
    request: SeverityRequest, child: ChildProcess, stop: threading.Event
) -> dict[str, Any]:
    """Return the result of `SeverityRequest.measure`, run in another process, with the class.

    If there is no result, a ``sentence`` states the reason.

    Parameters
    ----------
    child : process that measures.
    stop : is set before the process is ended on purpose, which is then no error.
    """
    try:
        severity = child.call(SeverityRequest.measure, request, timeout_s=MEASURE_TIMEOUT_S)
    except SwashTwinError as cause:
        severity = _unmeasured(str(cause))
    except Exception as cause:  # a severity is no reason to end the watch
        if not stop.is_set():
            _log.warning(
                "%s: the severity could not be measured", request.machine.name, exc_info=cause
            )
        severity = _unmeasured(
            f"an internal error ({type(cause).__name__}); see the log of the watch."
        )
    return {"label": request.label, **severity}


def _unmeasured(reason: str) -> dict[str, Any]:
    return {"sentence": f"Severity is not measured: {reason}", "notes": []}


def _require_same_pump(calibration: "Calibration", machine: Machine) -> None:
    pump = calibration.twin.pump
    is_another_design = machine.pump is not None and load_pump(machine.pump).name != pump.name
    if is_another_design or machine.piston_count != pump.rotating_group.piston_count:
        raise DataError(f"the calibration is for another pump, {pump.name}.")


def _faults_of_class(label: str) -> dict[str, Fault]:
    """Return the kinds of fault of a class; several kinds may have the same class."""
    faults = {}
    for kind, fault in FAULT_KINDS.items():
        if fault is not None and fault.label == label:
            faults[kind] = fault
    if not faults:
        raise DataError(f"the twin has no fault of the class {label!r}.")
    return faults


def _require_calibrated_point(calibration: "Calibration", recording: Recording) -> None:
    conditions = [fit.condition for fit in calibration.fits]
    condition = recording.condition
    if condition is None or any(condition.matches(calibrated) for calibrated in conditions):
        return

    names = [
        OperatingPoint(calibrated.speed, calibrated.discharge_pressure).name
        for calibrated in conditions
    ]
    raise DataError(
        f"the calibration is for {' and '.join(names)}, but the recording is at "
        f"{OperatingPoint.of(recording).name}."
    )


def _describe_best_fit(trends: Mapping[str, "SeverityTrend"]) -> dict[str, Any]:
    """Return the severity of the kind of fault that fits best, with the others as notes."""
    kinds = sorted(trends, key=lambda kind: trends[kind].estimates[0].misfit)
    best_kind, *other_kinds = kinds
    trend = trends[best_kind]
    (estimate,) = trend.estimates

    severity = estimate.severity
    dimension = severity.dimension
    unit_scale = dimension.per_unit
    limit = None
    limit_text = "none"
    if estimate.detection_limit is not None:
        limit = estimate.detection_limit / unit_scale
        limit_text = dimension.format_value(estimate.detection_limit)
    sentence = (
        f"Severity, if {describe_class(best_kind)}: {describe_class(dimension.name)} "
        f"{severity.text}, {severity.verdict}; detection limit {limit_text}."
    )
    notes: Sequence[str] = [
        *_compare_other_kinds(trends, other_kinds, estimate.misfit),
        *trend.notes,
        *estimate.notes,
    ]
    return {
        "sentence": sentence,
        "notes": list(notes),
        "verdict": severity.verdict,
        "dimension": dimension.name,
        "unit": dimension.unit,
        "value": severity.value / unit_scale,
        "interval": [end / unit_scale for end in severity.interval],
        "detection_limit": limit,
        "misfit": estimate.misfit,
        "point": {
            "kind": best_kind,
            "value": severity.value,
            "interval": list(severity.interval),
            "verdict": severity.verdict,
            "repeatability": estimate.repeatability,
        },
    }


def _compare_other_kinds(
    trends: Mapping[str, "SeverityTrend"], kinds: Sequence[str], best_misfit: float
) -> list[str]:
    notes = []
    for kind in kinds:
        (estimate,) = trends[kind].estimates
        notes.append(
            f"{describe_class(kind)} fits worse (misfit {estimate.misfit:.2g} instead of "
            f"{best_misfit:.2g}; 1 or less is expected): {estimate.severity.text}."
        )
    return notes
