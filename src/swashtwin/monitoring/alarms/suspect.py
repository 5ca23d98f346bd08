"""The suspect of an alarm: the fault of a pump prior that a recording resembles, against what the
watch learned; and the severity of that fault by a calibrated twin.

Another process adapts the prior and measures the severity, since that takes seconds, and memory
that would not be given back.
"""

import logging
import math
import os
import pickle
import signal
import subprocess
import sys
import time
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from hashlib import sha256
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float64

from swashtwin.diagnosis import Diagnosis, PriorClassifier, order_band_powers
from swashtwin.foundation import DataError, SwashTwinError, exit_with_parent
from swashtwin.monitoring.alarms.baseline import OperatingPoint, OperatingPointBaseline
from swashtwin.monitoring.config.settings import Machine
from swashtwin.pump import FAULT_KINDS, is_healthy, load_pump
from swashtwin.recordings import Recording, load_recordings
from swashtwin.signals import OrderBands

SURE = 0.8
"""Probability from which a suspect is named without the one after it."""
_KEPT = 128
"""Adapted priors that are kept; one takes 0.2 MB."""
_PATIENCE = 120.0
"""Time [s] that adapting a prior may take; measuring a severity may take ten times as long."""
_RETRY = 3600.0
"""Time [s] after which adapting is tried again where it failed."""
_COMMAND = "from swashtwin.monitoring.alarms.suspect import serve; serve()"
_log = logging.getLogger("swashtwin.watch")


@dataclass(frozen=True)
class Suspect:
    """What a pump prior says of a recording that moved far."""

    certainty: Literal["sure", "unsure", "unknown", "none"]
    """``unknown``: it is unlike all that the prior holds; ``none``: the prior cannot be asked."""
    sentence: str
    """Which fault it is and how sure, or why none is named."""
    label: str | None = None
    """Fault that it resembles most; a guess where it is not ``sure``."""
    probabilities: Mapping[str, float] = field(default_factory=dict)
    """Probability of each class of the prior, calibrated on virtual pumps."""
    p_value: float | None = None
    """Share of the prior's own recordings that are as unlike its classes."""

    @classmethod
    def of(cls, verdict: Diagnosis) -> "Suspect":
        """The suspect of an adapted prior's answer."""
        if verdict.label is None:
            return cls("none", f"No suspect is named: {verdict.no_verdict}")
        facts = (verdict.label, verdict.probabilities, verdict.p_value)
        if verdict.unknown:
            return cls("unknown", f"Suspect unknown. {verdict.reasons[0]}", *facts)
        ranked = sorted(verdict.probabilities.items(), key=lambda item: -item[1])
        first, second = (
            f"{_class_words(name)} ({100 * share:.0f} %)" for name, share in ranked[:2]
        )
        if is_healthy(verdict.label):
            return cls(
                "unsure",
                f"Suspect, unsure: {second}; the prior sees {first} still.",
                ranked[1][0],
                *facts[1:],
            )
        if ranked[0][1] >= SURE:
            return cls("sure", f"Suspect: {first}.", *facts)
        return cls("unsure", f"Suspect, unsure: {first}, or {second}.", *facts)


@dataclass(frozen=True, eq=False)
class PriorAdaptation:
    """What adapts a prior to a machine at an operating point."""

    machine: Machine
    channels: tuple[str, ...]
    unit: str
    point: OperatingPoint
    rows: Float64[np.ndarray, "recording order_level"]
    """Of `measure_orders`."""

    @property
    def key(self) -> str:
        """Digest of all that decides the adapted prior."""
        facts = (self.machine, self.channels, self.unit, self.point)
        return sha256(repr(facts).encode() + self.rows.tobytes()).hexdigest()

    def answer(self) -> PriorClassifier:
        """The prior of the machine, adapted to it.

        Raises
        ------
        SwashTwinError
            The prior cannot be read, or its virtual pumps lack a channel of the machine.
        """
        prior = PriorClassifier.load(self.machine.prior)
        is_own = self.machine.pump is not None and load_pump(self.machine.pump).name == prior.pump
        prior = prior.narrowed(
            self.channels, self.unit, None if is_own else self.machine.piston_count
        )
        count = len(self.rows)
        speed, pressure = (
            math.nan if value is None else value
            for value in (self.point.speed, self.point.pressure)
        )
        return replace(
            prior,
            band_powers=self.rows.reshape(count, len(self.channels), -1),
            specimen=(self.machine.name,) * count,
            point_speed=np.full(count, speed),
            point_pressure=np.full(count, pressure),
        ).fit_band_powers()


@dataclass(frozen=True)
class SeverityRequest:
    """A recording in which a machine has a fault, whose severity its calibrated twin measures."""

    machine: Machine
    """With a calibration."""
    label: str
    """Class of the fault."""
    recording: Path | None
    """File of the recording; None where its samples are not kept."""
    healthy: tuple[Path, ...] = ()
    """Files of healthy recordings of the machine at the same operating point."""

    def answer(self) -> dict[str, Any]:
        """The severity with its interval of 90 %, detection limit and doubts, as JSON can hold it.

        Raises
        ------
        SwashTwinError
            A package is missing, or the calibration is of another pump or operating point, or has
            no such fault.
        """
        from swashtwin.calibration import estimate_severity, load_calibration

        assert self.machine.calibration is not None
        calibration = load_calibration(self.machine.calibration)
        pump, name = calibration.twin.pump, self.machine.pump
        own = pump.name if name is None else load_pump(name).name
        if (own, self.machine.piston_count) != (pump.name, pump.rotating_group.piston_count):
            raise DataError(f"the calibration is of another pump, {pump.name}.")
        kinds = {
            name: fault
            for name, fault in FAULT_KINDS.items()
            if fault is not None and fault.label == self.label
        }
        if not kinds:
            raise DataError("the twin has no such fault.")
        if self.recording is None:
            raise DataError("the samples of the recording are not kept any more.")
        worn, *healthy = (
            load_recordings(path)[0].replace(label=label, specimen=self.machine.name)
            for path, label in [
                (self.recording, None),
                *((path, "normal") for path in self.healthy),
            ]
        )
        points = [fit.condition for fit in calibration.fits]
        if worn.condition is not None and not any(
            worn.condition.matches(point) for point in points
        ):
            at = " and ".join(
                OperatingPoint(point.speed, point.discharge_pressure).name for point in points
            )
            raise DataError(
                f"the calibration is at {at}, the recording at {OperatingPoint.of(worn).name}."
            )
        trends = [
            (_class_words(name), estimate_severity(calibration, [worn], fault, healthy=healthy))
            for name, fault in kinds.items()
        ]
        trends.sort(key=lambda item: item[1].estimates[0].misfit)
        kind, trend = trends[0]
        (estimate,) = trend.estimates
        severity, limit = estimate.severity, estimate.detection_limit
        others = [
            f"{name} fits worse ({other.misfit:.2g} instead of {estimate.misfit:.2g}): {other.severity.words}."
            for name, (other,) in ((name, item.estimates) for name, item in trends[1:])
        ]
        unit, least = (
            severity.dimension.per_unit,
            "none" if limit is None else severity.dimension.words(limit),
        )
        return {
            "sentence": f"Severity, if {kind}: {_class_words(severity.dimension.name)} {severity.words}, "
            f"{severity.verdict}; detection limit {least}.",
            "notes": [*others, *trend.notes, *estimate.notes],
            "verdict": severity.verdict,
            "dimension": severity.dimension.name,
            "unit": severity.dimension.unit,
            "value": severity.value / unit,
            "interval": [end / unit for end in severity.interval],
            "detection_limit": None if limit is None else limit / unit,
            "misfit": estimate.misfit,
        }


class PriorNotAdaptedError(Exception):
    """No prior is adapted to these yet: `Suspects.adapt` does that, outside of any transaction."""

    def __init__(self, healthy: PriorAdaptation) -> None:
        super().__init__()
        self.request = healthy


class Suspects:
    """Names suspects by priors that it adapts when they are first needed."""

    def __init__(self) -> None:
        self._adapted: OrderedDict[str, tuple[PriorClassifier | str, float]] = OrderedDict()
        """Priors, or why there is none, and when [s] adapting failed; infinite where it did not."""

    def name(
        self,
        machine: Machine,
        point: OperatingPoint,
        baseline: OperatingPointBaseline,
        recording: Recording,
    ) -> Suspect:
        """The suspect of a recording that moved far from a complete baseline.

        Raises
        ------
        UnadaptedError
            The prior has to be adapted first.
        """
        if machine.piston_count is None:
            return _none(
                "whether it is a swash-plate pump, and of how many pistons, is not known; add pump or pistons to its "
                "[[machine]], then note a maintenance."
            )
        if point.speed is None:
            return _none("its speed is not known, and a prior compares orders of the shaft.")
        rows = baseline.orders[np.isfinite(baseline.orders).any(axis=1)]
        if baseline.pistons != machine.piston_count or not len(rows):
            reason = "its healthy recordings were learned without its pistons; note a maintenance to learn them anew."
            try:
                order_band_powers(recording, OrderBands(machine.piston_count))
            except DataError as cause:
                reason = str(cause)
            return _none(reason)
        healthy = PriorAdaptation(machine, recording.channels, recording.unit, point, rows)
        prior, failed = self._adapted.get(healthy.key, ("", -math.inf))
        if time.monotonic() - failed > _RETRY:
            raise PriorNotAdaptedError(healthy)
        if isinstance(prior, str):
            return _none(prior)
        return Suspect.of(prior.diagnose(recording.replace(specimen=machine.name)))

    def adapt(self, healthy: PriorAdaptation) -> None:
        """Adapt a prior in another process, and keep it, or why it cannot be adapted."""
        answer, has_failed = _answered(healthy, "its prior could not be adapted", _PATIENCE)
        self._adapted[healthy.key] = answer, time.monotonic() if has_failed else math.inf
        while len(self._adapted) > _KEPT:
            self._adapted.popitem(last=False)


def measure_severity(question: SeverityRequest) -> dict[str, Any]:
    """`SeverityRequest.answer` of another process, with its class; only a ``sentence`` that says why
    where there is none.
    """
    answer, _ = _answered(question, "an error", 10 * _PATIENCE)
    severity = (
        answer
        if isinstance(answer, dict)
        else {"sentence": f"Severity is not measured: {answer}", "notes": []}
    )
    return {"label": question.label, **severity}


def _answered(
    question: PriorAdaptation | SeverityRequest, failure: str, patience: float
) -> tuple[Any, bool]:
    """(a question's answer by another process or why there is none, whether the process failed)."""
    try:
        process = subprocess.run(
            [
                sys.executable,
                "-P",
                "-c",
                _COMMAND,
            ],  # -P: nothing is imported from the current folder
            input=pickle.dumps(question),
            capture_output=True,
            timeout=patience,
            check=True,
            env={
                **os.environ,
                "PYTHONPATH": os.pathsep.join(path for path in sys.path if path),
                "OMP_NUM_THREADS": "1",
                "OPENBLAS_NUM_THREADS": "1",
            },
        )
        return pickle.loads(process.stdout), False
    except Exception as cause:  # neither suspect nor severity is a reason to lose a judgment
        said = getattr(cause, "stderr", None) or b""
        _log.warning(
            "%s: %s: %s %s",
            question.machine.name,
            failure,
            cause,
            said[-2000:].decode(errors="replace"),
        )
        return f"{failure} ({type(cause).__name__}); the watch's log says more.", True


def serve() -> None:
    """Answer the question of the standard input; what another process runs."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # an interrupt is for the watch
    exit_with_parent(os.getppid())
    question: PriorAdaptation | SeverityRequest = pickle.load(sys.stdin.buffer)
    try:
        answer: PriorClassifier | dict[str, Any] | str = question.answer()
    except SwashTwinError as cause:
        answer = str(cause)
    pickle.dump(answer, sys.stdout.buffer)


def _class_words(name: str) -> str:
    return "another fault" if name == "other" else name.replace("_", " ")


def _none(reason: str) -> Suspect:
    return Suspect("none", f"No suspect is named: {reason}")
