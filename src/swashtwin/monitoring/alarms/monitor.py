"""When an alarm begins and ends: a sequential test that may be looked at after every recording, and
persistence.

The test is one of exchangeability, a conformal test martingale. Vovk and others, "Testing
randomness online", Statistical Science 36(4), 2021, DOI 10.1214/20-STS817. A gambler starts with a
capital of 1 and bets against the p-value of each recording. As long as recordings are exchangeable,
smoothed p-values are independent and uniform, no bet gains on average, and the chance that the
capital ever reaches 1/a is at most a (Ville's inequality).
"""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from jaxtyping import Float64

from swashtwin.diagnosis import BandPowerChange, band_power_changes
from swashtwin.foundation import DataError, InputError, from_table, plural, random_stream, to_table
from swashtwin.monitoring.alarms.baseline import (
    OperatingPointBaseline,
    band_names,
    choose_layout,
    read_baseline,
)
from swashtwin.monitoring.alarms.sensors import SensorFinding, check_against_baseline, check_sensors
from swashtwin.recordings import Recording, specified_shaft_frequency

PERSISTENCE = 2
"""Recordings that must speak for an alarm, of the last `RECENT`."""
RECENT = 3
"""Recordings that persistence looks at."""
QUIET = 5
"""Recordings in a row that do not speak for the alarm, until its condition is over."""

AlarmChange = Literal["raised", "cleared"]
"""What happened to an alarm condition at a recording."""


POWERS = (0.1, 0.3, 0.5)
"""Exponents e of the bets e p^(e - 1)."""
STAKES = (0.5, 0.8, 0.95)
"""Stakes g of the bets that the next recording is large: of b, the share of large ones so far with
the next counted among them, they pay g / b where p is at most b, and (1 - g) / (1 - b)
elsewhere.
"""
SHARING = 0.1
"""Share of the capital that is dealt out anew, evenly among the bets, before each of them: so a bet
that lost all comes back, and the best bet may change with time (Herbster and Warmuth, 1998, DOI
10.1023/A:1007424614876).
"""
_GRID = 0.02
"""Relative step of the grid that scores are kept on; scores of one step are ties."""
_LEAST_SCORE, _MOST_SCORE = 1e-3, 1e6
_LARGE = 100_000
"""Added to the step of a large recording's score: it ranks above all others."""
N_BETS = len(POWERS) + len(STAKES)


@dataclass(frozen=True)
class ConformalTest:
    """Scores so far, and the capital of each bet."""

    scores: Mapping[int, int]
    """How many recordings rank at each step: `rank_step`."""
    bets: tuple[float, ...] = (0.0,) * N_BETS
    """Capital that stands on each bet, of `POWERS`, then of `STAKES`."""
    steps: int = 0
    """Bets so far."""

    @classmethod
    def calibrated(cls, scores: Sequence[tuple[float, bool]]) -> "ConformalTest":
        """A test that has made no bet, with (score, whether it is large) of each recording of a
        baseline.
        """
        return cls(Counter(rank_step(score, is_large) for score, is_large in scores))

    @property
    def n_scores(self) -> int:
        """How many scores a new one is ranked among."""
        return sum(self.scores.values())

    @property
    def large_share(self) -> float:
        """Share of large recordings, a next large one counted: the chance of a p-value at most as
        high.
        """
        large = sum(count for step, count in self.scores.items() if step >= _LARGE // 2)
        return (large + 1) / (self.n_scores + 1)

    @property
    def capital(self) -> float:
        """Evidence against all recordings being alike: what stands on the bets, and what still
        sleeps.
        """
        return sum(self.bets) + 1 / (self.steps + 1)

    def p_value(self, score: float, is_large: bool, tie: float) -> float:
        """Smoothed conformal p-value of a recording: its rank from above among all, itself
        included.

        Parameters
        ----------
        score : nonconformity score, at least 0.
        is_large : whether the recording ranks above those that are not.
        tie : uniform in [0, 1), drawn for this score; it decides where among equal scores the score
            ranks.
        """
        step = rank_step(score, is_large)
        above = sum(count for other, count in self.scores.items() if other > step)
        return (above + (1 - tie) * (self.scores.get(step, 0) + 1)) / (self.n_scores + 1)

    def after(self, score: float, is_large: bool, p_value: float) -> "ConformalTest":
        """The test after a bet at `p_value`, with the recording among those that later ones are
        ranked among.

        Start t of the gambler wakes at bet t with a weight of 1 / (t (t + 1)), so that a change
        after a long healthy time meets bets that did not lose their capital in it.
        """
        steps = self.steps + 1
        bets = np.array(self.bets) + 1 / (steps * (steps + 1)) / N_BETS
        bets = (1 - SHARING) * bets + SHARING * bets.mean()
        scores = Counter(self.scores)
        scores[rank_step(score, is_large)] += 1
        return ConformalTest(
            scores, tuple((bets * payoffs(p_value, self.large_share)).tolist()), steps
        )


def rank_step(score: float, is_large: bool) -> int:
    """Rank of a recording: the step of a logarithmic grid, 2 % wide, that its score lies on; large
    ones are above.

    All scores below 0.001 are on one step. Scores on a grid are as exchangeable as the scores
    themselves, and the memory that they take is bounded.

    Examples
    --------
    >>> rank_step(1.0, False), rank_step(1.03, False), rank_step(0.1, True) > rank_step(9.0, False)
    (0, 1, True)
    """
    step = math.floor(math.log(min(max(score, _LEAST_SCORE), _MOST_SCORE)) / math.log1p(_GRID))
    return step + _LARGE if is_large else step


def payoffs(p_value: float, large_share: float) -> Float64[np.ndarray, " bet"]:
    """What one unit on each bet becomes; each is 1 on average over uniform p-values, and never
    rises with p.

    Parameters
    ----------
    large_share : `ConformalTest.large_share`; a bet whose stake is no higher is not made.

    Examples
    --------
    >>> payoffs(0.04, 0.05).round(2).tolist()
    [1.81, 2.86, 2.5, 10.0, 16.0, 19.0]
    >>> payoffs(1.0, 0.05).round(2).tolist()
    [0.1, 0.3, 0.5, 0.53, 0.21, 0.05]
    """
    power, stake = np.array(POWERS), np.array(STAKES)
    won = stake / large_share if p_value <= large_share else (1 - stake) / (1 - large_share)
    return np.concatenate([power * p_value ** (power - 1), np.where(stake > large_share, won, 1.0)])


@dataclass(frozen=True)
class AlarmState:
    """Whether an alarm condition holds, and what the last recordings said.

    That a raised alarm stands until a person acknowledged it is kept in the history.
    """

    is_active: bool = False
    """Whether it holds."""
    recent: tuple[bool, ...] = ()
    """Whether each of the last recordings spoke for it, the newest last, `RECENT` at most."""
    quiet: int = 0
    """Recordings in a row that did not speak for it, `QUIET` at most."""

    def after(
        self, is_large: bool, *, is_proven: bool = True
    ) -> tuple["AlarmState", AlarmChange | None]:
        """(the condition after one more recording, what changed).

        Parameters
        ----------
        is_large : whether the recording speaks for the alarm.
        is_proven : whether the evidence of all recordings so far suffices to raise it.
        """
        recent = (*self.recent, is_large)[-RECENT:]
        quiet = 0 if is_large else min(self.quiet + 1, QUIET)
        if not self.is_active and is_proven and sum(recent) >= PERSISTENCE:
            return AlarmState(True, recent, quiet), "raised"
        if self.is_active and quiet == QUIET:
            return AlarmState(False, recent, quiet), "cleared"
        return AlarmState(self.is_active, recent, quiet), None


LEAST_LEARNING = 5
"""Recordings of a baseline at least: of fewer, no scatter can be told."""
_LEAST_SAMPLES = 64
"""Samples of a recording at least: fewer have neither levels nor stretches."""


@dataclass(frozen=True)
class OperatingPointState:
    """What is known of a machine at one operating point."""

    baseline: OperatingPointBaseline
    """Levels of the healthy recordings; the same object where a recording did not change it."""
    test: ConformalTest
    """The sequential test."""
    pump: AlarmState
    """Condition of the pump's alarm."""
    sensor: AlarmState
    """Condition of the sensors' alarm."""

    @classmethod
    def from_tables(
        cls, baseline: Mapping[str, Any], rest: Mapping[str, Any]
    ) -> "OperatingPointState":
        """The state of two tables, which the history keeps apart: the large one changes rarely."""
        return cls(
            read_baseline(baseline),
            from_table(rest["test"], ConformalTest),
            from_table(rest["pump"], AlarmState),
            from_table(rest["sensor"], AlarmState),
        )

    def test_table(self) -> dict[str, Any]:
        """All but the baseline, as a table."""
        return {name: to_table(getattr(self, name)) for name in ("test", "pump", "sensor")}


@dataclass(frozen=True)
class OperatingPointJudgment:
    """What one recording says."""

    stage: Literal["learning", "watching", "sensor"]
    """``sensor``: a sensor is at fault, and the recording says nothing about the pump."""
    learned: int
    """Recordings that the baseline has learned from."""
    state: OperatingPointState = field(repr=False)
    """State for the next recording."""
    band_powers: Mapping[tuple[str, str], float] = field(repr=False, default_factory=dict)
    """Each level [dB of the squared unit] by its channel and name; empty where a channel is
    flat.
    """
    score: float | None = None
    """Nonconformity score; None unless watching."""
    p_value: float | None = None
    """Smoothed conformal p-value of the score; None unless watching."""
    capital: float | None = None
    """Evidence of all recordings so far, which an alarm needs 1 / (false-alarm rate) of; None
    unless watching.
    """
    is_large: bool = False
    """Whether levels changed far."""
    is_alarm: bool = False
    """Whether the condition of the pump's alarm holds."""
    moved: tuple[BandPowerChange, ...] = ()
    """Levels that moved, furthest first; also without an alarm."""
    reasons: tuple[str, ...] = ()
    """Channels that moved as a whole, and levels that moved, in words; what is wrong with the
    sensors.
    """
    findings: tuple[SensorFinding, ...] = ()
    """What is wrong with the sensors."""
    pump: AlarmChange | None = None
    """Change of the condition of the pump's alarm."""
    sensor: AlarmChange | None = None
    """Change of the condition of the sensors' alarm."""
    notes: tuple[str, ...] = ()
    """What was not learned from, and why."""

    def to_dict(self) -> dict[str, Any]:
        """The evidence, in numbers and words that JSON can hold."""
        hidden = ("state", "band_powers", "pump", "sensor")
        return {name: to_table(value) for name, value in vars(self).items() if name not in hidden}


@dataclass(frozen=True)
class OperatingPointMonitor:
    """The rule of alarms for one machine; it holds no state. docs/how-to/alarms.md has the
    method.
    """

    machine: str
    """Name of the machine; with point and count it seeds the draws that decide ties."""
    false_alarm_rate: float = 0.01
    """Chance that a healthy machine that does not change ever raises an alarm at one operating
    point, at most.
    """
    baseline_recordings: int = 20
    """Recordings that a baseline learns from."""
    pistons: int | None = None
    """Pistons of the machine, where they are known: what a pump prior compares is then learned
    too.
    """

    def __post_init__(self) -> None:
        if not 0 < self.false_alarm_rate < 1:
            raise InputError(
                f"false_alarm_rate ({self.false_alarm_rate:g}) must lie between 0 and 1, such as 0.01."
            )
        if self.baseline_recordings < LEAST_LEARNING:
            raise InputError(
                f"baseline_recordings ({self.baseline_recordings}) must be {LEAST_LEARNING} recordings at least."
            )

    def judge(
        self, recording: Recording, state: OperatingPointState | None, *, point: str = "any"
    ) -> OperatingPointJudgment:
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
            sensor = AlarmState() if state is None else state.sensor
            state = OperatingPointState(
                OperatingPointBaseline.empty(choose_layout(recording)),
                ConformalTest({}),
                AlarmState(),
                sensor,
            )
        findings = check_sensors(recording)
        if any(finding.kind == "flat" for finding in findings):
            return _at_fault(state, findings, {})
        band_powers = state.baseline.measure(recording)
        named = dict(zip(band_names(state.baseline.layout), band_powers.tolist(), strict=True))
        if not findings and state.baseline.is_complete:
            findings = check_against_baseline(state.baseline, band_powers)
        if findings:
            return _at_fault(state, findings, named)
        sensor, sensor_change = state.sensor.after(False)
        state = replace(state, sensor=sensor)
        if state.baseline.is_complete:
            judgment = self._watched(state, band_powers, recording, point)
        else:
            baseline, notes = state.baseline.learn(
                band_powers, recording, self.baseline_recordings, self.pistons
            )
            test = (
                ConformalTest.calibrated(baseline.held_out_scores())
                if baseline.is_complete
                else state.test
            )
            state = replace(state, baseline=baseline, test=test)
            judgment = OperatingPointJudgment("learning", len(baseline.rows), state, notes=notes)
        return replace(judgment, band_powers=named, sensor=sensor_change)

    def _watched(
        self,
        state: OperatingPointState,
        band_powers: Float64[np.ndarray, " level"],
        recording: Recording,
        point: str,
    ) -> OperatingPointJudgment:
        baseline, test = state.baseline, state.test
        score, is_large = baseline.score(band_powers), baseline.is_large(band_powers)
        tie = random_stream(0, "alarm", self.machine, point, test.n_scores).random()
        p_value = test.p_value(score, is_large, tie)
        if not state.pump.is_active:
            test = test.after(score, is_large, p_value if is_large else 1.0)
        capital = test.capital
        pump, change = state.pump.after(is_large, is_proven=capital * self.false_alarm_rate >= 1)
        if change == "cleared":
            test = ConformalTest(test.scores)  # which has made no bet
        shifts, moved = band_power_changes(
            baseline.deviation(band_powers, p_value),
            baseline.layout.band_powers,
            specified_shaft_frequency(recording),
        )
        return OperatingPointJudgment(
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
    state: OperatingPointState,
    findings: tuple[SensorFinding, ...],
    band_powers: Mapping[tuple[str, str], float],
) -> OperatingPointJudgment:
    """What a recording says with a sensor at fault: nothing is learned, nothing is bet."""
    sensor, change = state.sensor.after(True)
    return OperatingPointJudgment(
        "sensor",
        len(state.baseline.rows),
        replace(state, sensor=sensor),
        band_powers=band_powers,
        is_alarm=state.pump.is_active,
        reasons=tuple(finding.sentence for finding in findings),
        findings=findings,
        sensor=change,
    )
