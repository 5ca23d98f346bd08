"""`PointMonitor`: what one recording says about a machine at an operating point, given all before it."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal

import numpy as np
from jaxtyping import Float64

from swashtwin.diagnosis import LevelChange, level_changes
from swashtwin.foundation import DataError, InputError, plural, stream
from swashtwin.monitoring.alarms.baseline import PointBaseline, level_names
from swashtwin.monitoring.alarms.points import point_layout
from swashtwin.monitoring.alarms.sensors import SensorFinding, baseline_findings, sensor_findings
from swashtwin.monitoring.alarms.testing import Change, Condition, ConformalTest
from swashtwin.recordings import Recording, stated_speed

LEAST_LEARNING = 5
"""Recordings of a baseline at least: of fewer, no scatter can be told."""
_LEAST_SAMPLES = 64
"""Samples of a recording at least: fewer have neither levels nor stretches."""


@dataclass(frozen=True)
class PointState:
    """What is known of a machine at one operating point; JSON can hold both parts."""

    baseline: Mapping[str, Any]
    """Levels of the healthy recordings; the same object where a recording did not change it."""
    test: Mapping[str, Any]
    """The sequential test, and the conditions of the pump's and the sensors' alarms."""


@dataclass(frozen=True)
class PointJudgment:
    """What one recording says."""

    stage: Literal["learning", "watching", "sensor"]
    """``sensor``: a sensor is at fault, and the recording says nothing about the pump."""
    learned: int
    """Recordings that the baseline has learned from."""
    state: PointState = field(repr=False)
    """State for the next recording."""
    levels: Mapping[tuple[str, str], float] = field(repr=False, default_factory=dict)
    """Each level [dB of the squared unit] by its channel and name; empty where a channel is flat."""
    score: float | None = None
    """Nonconformity score; None unless watching."""
    p_value: float | None = None
    """Smoothed conformal p-value of the score; None unless watching."""
    capital: float | None = None
    """Evidence of all recordings so far, which an alarm needs 1 / (false-alarm rate) of; None unless watching."""
    is_large: bool = False
    """Whether levels changed far."""
    is_alarm: bool = False
    """Whether the condition of the pump's alarm holds."""
    moved: tuple[LevelChange, ...] = ()
    """Levels that moved, furthest first; also without an alarm."""
    reasons: tuple[str, ...] = ()
    """Channels that moved as a whole, and levels that moved, in words; what is wrong with the sensors."""
    findings: tuple[SensorFinding, ...] = ()
    """What is wrong with the sensors."""
    pump: Change | None = None
    """Change of the condition of the pump's alarm."""
    sensor: Change | None = None
    """Change of the condition of the sensors' alarm."""
    notes: tuple[str, ...] = ()
    """What was not learned from, and why."""

    def to_dict(self) -> dict[str, Any]:
        """The evidence, in numbers and words that JSON can hold."""
        words = {name: value for name, value in vars(self).items() if name not in ("state", "levels", "pump", "sensor")}
        moved = [change.to_dict() for change in self.moved]
        return {**words, "moved": moved, "findings": [finding.to_dict() for finding in self.findings]}


@dataclass(frozen=True)
class _Memory:
    """A `PointState` as objects."""

    baseline: PointBaseline
    test: ConformalTest
    pump: Condition
    sensor: Condition

    @classmethod
    def start(cls, recording: Recording) -> "_Memory":
        """Nothing is known, and the first recording says which levels there are."""
        baseline = PointBaseline.empty(point_layout(recording))
        return cls(baseline, ConformalTest({}), Condition(), Condition())

    @classmethod
    def read(cls, state: PointState) -> "_Memory":
        parts = state.test
        return cls(
            PointBaseline.from_dict(state.baseline),
            ConformalTest.from_dict(parts["test"]),
            Condition(**parts["pump"]),
            Condition(**parts["sensor"]),
        )

    def state(self, before: PointState | None = None) -> PointState:
        """The state to store; the baseline is described as `before`, if given."""
        description = self.baseline.to_dict() if before is None else before.baseline
        parts = {"test": self.test.to_dict(), "pump": asdict(self.pump), "sensor": asdict(self.sensor)}
        return PointState(description, parts)


@dataclass(frozen=True)
class PointMonitor:
    """The rule of alarms for one machine; it holds no state. docs/how-to/alarms.md has the method."""

    machine: str
    """Name of the machine; with point and count it seeds the draws that decide ties."""
    false_alarm_rate: float = 0.01
    """Chance that a healthy machine that does not change ever raises an alarm at one operating point, at most."""
    learning: int = 20
    """Recordings that a baseline learns from."""

    def __post_init__(self) -> None:
        if not 0 < self.false_alarm_rate < 1:
            raise InputError(f"false_alarm_rate ({self.false_alarm_rate:g}) must lie between 0 and 1, such as 0.01.")
        if self.learning < LEAST_LEARNING:
            raise InputError(f"learning ({self.learning}) must be {LEAST_LEARNING} recordings at least.")

    def judge(self, recording: Recording, state: PointState | None, *, point: str = "any") -> PointJudgment:
        """What a recording says, and the state for the next one.

        Parameters
        ----------
        recording : the next recording of the machine at the operating point, in order of time.
        state : of the point_judgment before, or None where a baseline starts.
        point : name of the operating point.

        Raises
        ------
        DataError
            The recording is unfit, or does not fit the baseline. The state is as it was.
        """
        if recording.n_samples < _LEAST_SAMPLES:
            samples = plural(recording.n_samples, "sample")
            raise DataError(
                f"{recording.recording_id} has {samples}; record {_LEAST_SAMPLES} at least, better a second."
            )
        memory = _Memory.start(recording) if state is None else _Memory.read(state)
        if not len(memory.baseline.rows):
            state, memory = None, replace(_Memory.start(recording), sensor=memory.sensor)
        findings = sensor_findings(recording)
        if any(finding.kind == "flat" for finding in findings):
            return _at_fault(memory, state, findings, {})
        levels = memory.baseline.measure(recording)
        named = dict(zip(level_names(memory.baseline.layout), levels.tolist(), strict=True))
        if not findings and memory.baseline.is_complete:
            findings = baseline_findings(memory.baseline, levels)
        if findings:
            return _at_fault(memory, state, findings, named)
        sensor, sensor_change = memory.sensor.after(False)
        memory = replace(memory, sensor=sensor)
        if state is not None and memory.baseline.is_complete:
            point_judgment = self._watched(memory, state, levels, recording, point)
        else:
            point_judgment = self._learned(memory, levels, recording)
        return replace(point_judgment, levels=named, sensor=sensor_change)

    def _learned(self, memory: _Memory, levels: Float64[np.ndarray, " level"], recording: Recording) -> PointJudgment:
        """PointJudgment on a recording that the baseline learns from."""
        baseline, notes = memory.baseline.learned_from(levels, recording.n_samples, self.learning)
        test = ConformalTest.calibrated(baseline.left_out_scores()) if baseline.is_complete else memory.test
        state = replace(memory, baseline=baseline, test=test).state()
        return PointJudgment("learning", len(baseline.rows), state, notes=notes)

    def _watched(
        self,
        memory: _Memory,
        state: PointState,
        levels: Float64[np.ndarray, " level"],
        recording: Recording,
        point: str,
    ) -> PointJudgment:
        """PointJudgment on a recording that is compared with the baseline."""
        baseline, test = memory.baseline, memory.test
        score, is_large = baseline.score(levels), baseline.is_large(levels)
        tie = stream(0, "alarm", self.machine, point, test.n_scores).random()
        p_value = test.p_value(score, is_large, tie)
        if not memory.pump.is_active:
            test = test.after(score, is_large, p_value if is_large else 1.0)
        capital = test.capital
        is_proven = capital * self.false_alarm_rate >= 1
        pump, change = memory.pump.after(is_large, is_proven=is_proven)
        if change == "cleared":
            test = test.restarted()
        shifts, moved = level_changes(
            baseline.deviation(levels, p_value), baseline.layout.levels, stated_speed(recording)
        )
        return PointJudgment(
            "watching",
            len(baseline.rows),
            replace(memory, test=test, pump=pump).state(state),
            score=score,
            p_value=p_value,
            capital=capital,
            is_large=is_large,
            is_alarm=pump.is_active,
            moved=moved,
            reasons=(*shifts, *(item.sentence for item in moved)),
            pump=change,
        )


def _at_fault(
    memory: _Memory,
    state: PointState | None,
    findings: tuple[SensorFinding, ...],
    levels: Mapping[tuple[str, str], float],
) -> PointJudgment:
    """PointJudgment on a recording with a sensor at fault: nothing is learned, nothing is bet."""
    sensor, change = memory.sensor.after(True)
    return PointJudgment(
        "sensor",
        len(memory.baseline.rows),
        replace(memory, sensor=sensor).state(state),
        levels=levels,
        is_alarm=memory.pump.is_active,
        reasons=tuple(finding.sentence for finding in findings),
        findings=findings,
        sensor=change,
    )
