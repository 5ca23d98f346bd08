"""`PointMonitor`: what one recording says about a machine at an operating point, given all before it."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from jaxtyping import Float64

from swashtwin.diagnosis import LevelChange, level_changes
from swashtwin.foundation import DataError, InputError, from_table, plural, stream, to_table
from swashtwin.monitoring.alarms.baseline import PointBaseline, level_names, read_baseline
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
    """What is known of a machine at one operating point."""

    baseline: PointBaseline
    """Levels of the healthy recordings; the same object where a recording did not change it."""
    test: ConformalTest
    """The sequential test."""
    pump: Condition
    """Condition of the pump's alarm."""
    sensor: Condition
    """Condition of the sensors' alarm."""

    @classmethod
    def start(cls, recording: Recording, sensor: Condition) -> "PointState":
        """Nothing is known, and the first recording says which levels there are."""
        return cls(PointBaseline.empty(point_layout(recording)), ConformalTest({}), Condition(), sensor)

    @classmethod
    def read(cls, baseline: Mapping[str, Any], rest: Mapping[str, Any]) -> "PointState":
        """The state of two tables, which the history keeps apart: the large one changes rarely."""
        return cls(
            read_baseline(baseline),
            from_table(rest["test"], ConformalTest),
            from_table(rest["pump"], Condition),
            from_table(rest["sensor"], Condition),
        )

    def rest(self) -> dict[str, Any]:
        """All but the baseline, as a table."""
        return {name: to_table(getattr(self, name)) for name in ("test", "pump", "sensor")}


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
        hidden = ("state", "levels", "pump", "sensor")
        return {name: to_table(value) for name, value in vars(self).items() if name not in hidden}


@dataclass(frozen=True)
class PointMonitor:
    """The rule of alarms for one machine; it holds no state. docs/how-to/alarms.md has the method."""

    machine: str
    """Name of the machine; with point and count it seeds the draws that decide ties."""
    false_alarm_rate: float = 0.01
    """Chance that a healthy machine that does not change ever raises an alarm at one operating point, at most."""
    learning: int = 20
    """Recordings that a baseline learns from."""
    pistons: int | None = None
    """Pistons of the machine, where they are known: what a pump prior compares is then learned too."""

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
        state : of the judgment before, or None where a baseline starts.
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
        if state is None or not len(state.baseline.rows):
            state = PointState.start(recording, Condition() if state is None else state.sensor)
        findings = sensor_findings(recording)
        if any(finding.kind == "flat" for finding in findings):
            return _at_fault(state, findings, {})
        levels = state.baseline.measure(recording)
        named = dict(zip(level_names(state.baseline.layout), levels.tolist(), strict=True))
        if not findings and state.baseline.is_complete:
            findings = baseline_findings(state.baseline, levels)
        if findings:
            return _at_fault(state, findings, named)
        sensor, sensor_change = state.sensor.after(False)
        state = replace(state, sensor=sensor)
        if state.baseline.is_complete:
            judgment = self._watched(state, levels, recording, point)
        else:
            judgment = self._learned(state, levels, recording)
        return replace(judgment, levels=named, sensor=sensor_change)

    def _learned(self, state: PointState, levels: Float64[np.ndarray, " level"], recording: Recording) -> PointJudgment:
        """What a recording says that the baseline learns from."""
        baseline, notes = state.baseline.learned_from(levels, recording, self.learning, self.pistons)
        test = ConformalTest.calibrated(baseline.left_out_scores()) if baseline.is_complete else state.test
        state = replace(state, baseline=baseline, test=test)
        return PointJudgment("learning", len(baseline.rows), state, notes=notes)

    def _watched(
        self, state: PointState, levels: Float64[np.ndarray, " level"], recording: Recording, point: str
    ) -> PointJudgment:
        """What a recording says that is compared with the baseline."""
        baseline, test = state.baseline, state.test
        score, is_large = baseline.score(levels), baseline.is_large(levels)
        tie = stream(0, "alarm", self.machine, point, test.n_scores).random()
        p_value = test.p_value(score, is_large, tie)
        if not state.pump.is_active:
            test = test.after(score, is_large, p_value if is_large else 1.0)
        capital = test.capital
        pump, change = state.pump.after(is_large, is_proven=capital * self.false_alarm_rate >= 1)
        if change == "cleared":
            test = test.restarted()
        shifts, moved = level_changes(
            baseline.deviation(levels, p_value), baseline.layout.levels, stated_speed(recording)
        )
        return PointJudgment(
            "watching",
            len(baseline.rows),
            replace(state, test=test, pump=pump),
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
    state: PointState, findings: tuple[SensorFinding, ...], levels: Mapping[tuple[str, str], float]
) -> PointJudgment:
    """What a recording says with a sensor at fault: nothing is learned, nothing is bet."""
    sensor, change = state.sensor.after(True)
    return PointJudgment(
        "sensor",
        len(state.baseline.rows),
        replace(state, sensor=sensor),
        levels=levels,
        is_alarm=state.pump.is_active,
        reasons=tuple(finding.sentence for finding in findings),
        findings=findings,
        sensor=change,
    )
