"""When an alarm begins and ends: a sequential test that may be evaluated after every recording, and
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
    load_baseline,
)
from swashtwin.monitoring.alarms.sensors import SensorFinding, check_against_baseline, check_sensors
from swashtwin.recordings import Recording, specified_shaft_frequency

N_PERSISTENT = 2
"""Recordings of the last `N_RECENT` that must support an alarm: one alone may be a disturbance."""
N_RECENT = 3
"""Recordings that persistence looks at."""
N_QUIET = 5
"""Recordings in a row that do not support the alarm, after which its cause is gone."""

AlarmChange = Literal["raised", "cleared"]
"""What happened to the state of an alarm at a recording."""


POWERS = (0.1, 0.3, 0.5)
"""Exponents e of the bets e p^(e - 1)."""
STAKES = (0.5, 0.8, 0.95)
"""Stakes g of the bets that the next recording is large.

Let b be the share of large recordings so far, the next one counted among them. A bet pays g / b if
p is at most b, and (1 - g) / (1 - b) otherwise.
"""
SHARED_PART = 0.1
"""Share of the capital that is redistributed evenly among the bets before each recording.

A bet that lost everything comes back, and the best bet may change with time (Herbster and Warmuth,
1998, DOI 10.1023/A:1007424614876).
"""
N_BETS = len(POWERS) + len(STAKES)

# Relative step of the grid on which scores are stored; scores of one step are ties.
_GRID_STEP = 0.02

_MIN_SCORE = 1e-3

# Scores beyond these limits are on the first and the last step, so that the grid is finite.
_MAX_SCORE = 1e6

# Added to the step of a large recording, so that it ranks above all that are not large.
_LARGE_OFFSET = 100_000


@dataclass(frozen=True)
class ConformalTest:
    """Scores so far, and the capital of each bet."""

    scores: Mapping[int, int]
    """How many recordings rank at each step: `rank_step`."""
    bets: tuple[float, ...] = (0.0,) * N_BETS
    """Capital on each bet, of `POWERS`, then of `STAKES`."""
    steps: int = 0
    """Number of recordings that were bet on."""

    @classmethod
    def calibrated(cls, scores: Sequence[tuple[float, bool]]) -> "ConformalTest":
        """Return a test without bets, for the (score, whether it is large) of a baseline."""
        return cls(Counter(rank_step(score, is_large) for score, is_large in scores))

    @property
    def n_scores(self) -> int:
        """Number of scores among which a new one is ranked."""
        return sum(self.scores.values())

    @property
    def large_share(self) -> float:
        """Share of large recordings, if the next one is large too.

        It is the chance of a p-value that is at most as high.
        """
        # No step of a score that is not large comes near the offset.
        n_large = sum(count for step, count in self.scores.items() if step >= _LARGE_OFFSET // 2)
        return (n_large + 1) / (self.n_scores + 1)

    @property
    def capital(self) -> float:
        """Evidence against the exchangeability of all recordings.

        It is the capital on the bets, and that of the starts which have not begun.
        """
        return sum(self.bets) + 1 / (self.steps + 1)

    def p_value(self, score: float, is_large: bool, tie: float) -> float:
        """Return the smoothed conformal p-value of a recording.

        It is the rank of the recording from above among all recordings and itself.

        Parameters
        ----------
        score : nonconformity score, at least 0.
        is_large : whether the recording ranks above those that are not large.
        tie : uniform in [0, 1), drawn for this score; it decides the rank among equal scores.
        """
        step = rank_step(score, is_large)
        n_above = sum(count for stored, count in self.scores.items() if stored > step)
        n_equal = self.scores.get(step, 0) + 1
        return (n_above + (1 - tie) * n_equal) / (self.n_scores + 1)

    def bet(self, score: float, is_large: bool, p_value: float) -> "ConformalTest":
        """Return the test after a bet at `p_value`, with the recording among its scores.

        Start t of the gambler begins at bet t with a weight of 1 / (t (t + 1)), so that a change
        after a long healthy time meets bets that did not lose their capital in it.
        """
        steps = self.steps + 1
        bets = np.array(self.bets) + 1 / (steps * (steps + 1)) / N_BETS
        # This does not depend on p, so no bet gains on average by it.
        bets = (1 - SHARED_PART) * bets + SHARED_PART * bets.mean()
        bets = bets * payoffs(p_value, self.large_share)

        scores = Counter(self.scores)
        scores[rank_step(score, is_large)] += 1
        return ConformalTest(scores, tuple(bets.tolist()), steps)


def rank_step(score: float, is_large: bool) -> int:
    """Return the rank of a recording: the step of a logarithmic grid on which its score lies.

    The steps are 2 % wide, and those of large recordings are above all others. All scores below
    0.001 are on one step. Scores on a grid are as exchangeable as the scores themselves, and the
    memory that they take is bounded.

    Examples
    --------
    >>> rank_step(1.0, False), rank_step(1.03, False), rank_step(0.1, True) > rank_step(9.0, False)
    (0, 1, True)
    """
    limited_score = min(max(score, _MIN_SCORE), _MAX_SCORE)
    step = math.floor(math.log(limited_score) / math.log1p(_GRID_STEP))
    if is_large:
        step += _LARGE_OFFSET
    return step


def payoffs(p_value: float, large_share: float) -> Float64[np.ndarray, " bet"]:
    """Return what one unit on each bet becomes.

    Each payoff is 1 on average over uniform p-values, and never rises with p.

    Parameters
    ----------
    large_share : `ConformalTest.large_share`; a bet whose stake is not higher is not made.

    Examples
    --------
    >>> payoffs(0.04, 0.05).round(2).tolist()
    [1.81, 2.86, 2.5, 10.0, 16.0, 19.0]
    >>> payoffs(1.0, 0.05).round(2).tolist()
    [0.1, 0.3, 0.5, 0.53, 0.21, 0.05]
    """
    powers = np.array(POWERS)
    stakes = np.array(STAKES)

    power_payoffs = powers * p_value ** (powers - 1)
    if p_value <= large_share:
        stake_payoffs = stakes / large_share
    else:
        stake_payoffs = (1 - stakes) / (1 - large_share)
    # A lower stake would pay more if the recording is not large.
    is_made = stakes > large_share
    return np.concatenate([power_payoffs, np.where(is_made, stake_payoffs, 1.0)])


@dataclass(frozen=True)
class AlarmState:
    """State of an alarm: whether its cause is present, and what the last recordings showed.

    That a raised alarm is kept until a person acknowledges it is a matter of the history.
    """

    is_active: bool = False
    """Whether the cause of the alarm is present."""
    recent: tuple[bool, ...] = ()
    """Whether each of the last recordings supported the alarm, the newest last, at most
    `N_RECENT`.
    """
    quiet: int = 0
    """Recordings in a row that did not support the alarm, at most `N_QUIET`."""

    def update(
        self, is_large: bool, *, is_proven: bool = True
    ) -> tuple["AlarmState", AlarmChange | None]:
        """Return the state after one more recording, and what changed.

        Parameters
        ----------
        is_large : whether the recording supports the alarm.
        is_proven : whether the evidence of all recordings so far suffices to raise the alarm.
        """
        recent = (*self.recent, is_large)[-N_RECENT:]
        quiet = min(self.quiet + 1, N_QUIET)
        if is_large:
            quiet = 0

        if not self.is_active and is_proven and sum(recent) >= N_PERSISTENT:
            return AlarmState(True, recent, quiet), "raised"
        if self.is_active and quiet == N_QUIET:
            return AlarmState(False, recent, quiet), "cleared"
        return AlarmState(self.is_active, recent, quiet), None


MIN_BASELINE_RECORDINGS = 5
"""Minimum number of recordings of a baseline: fewer show no scatter."""
MIN_SAMPLES = 64
"""Minimum number of samples of a recording: fewer have neither band powers nor stretches."""


@dataclass(frozen=True)
class OperatingPointState:
    """What is known of a machine at one operating point."""

    baseline: OperatingPointBaseline
    """Band powers of the healthy recordings; the same object if a recording did not change it."""
    test: ConformalTest
    """The sequential test."""
    pump: AlarmState
    """State of the pump's alarm."""
    sensor: AlarmState
    """State of the sensors' alarm."""

    @classmethod
    def from_tables(
        cls, baseline: Mapping[str, Any], test: Mapping[str, Any]
    ) -> "OperatingPointState":
        """Return the state of two tables of the history.

        The history keeps them apart because the baseline is large and changes rarely.

        Raises
        ------
        InputError
            Another version of swashtwin wrote them.
        """
        return from_table({**test, "baseline": load_baseline(baseline)}, cls, complete=True)

    @classmethod
    def initial(cls, recording: Recording, sensor: AlarmState) -> "OperatingPointState":
        """Return the state before the first recording of a baseline."""
        baseline = OperatingPointBaseline.empty(choose_layout(recording))
        return cls(baseline, ConformalTest({}), AlarmState(), sensor)

    def test_table(self) -> dict[str, Any]:
        """Return everything but the baseline, as a table."""
        return {name: to_table(getattr(self, name)) for name in ("test", "pump", "sensor")}


@dataclass(frozen=True)
class OperatingPointJudgment:
    """Result of one recording at its operating point."""

    stage: Literal["learning", "watching", "sensor"]
    """``sensor``: a sensor is faulty, and the recording shows nothing about the pump."""
    learned: int
    """Number of recordings that the baseline has learned from."""
    state: OperatingPointState = field(repr=False)
    """State for the next recording."""
    band_powers: Mapping[tuple[str, str], float] = field(repr=False, default_factory=dict)
    """Each band power [dB of the squared unit] by its channel and name; empty if a channel is
    flat.
    """
    score: float | None = None
    """Nonconformity score; None unless watching."""
    p_value: float | None = None
    """Smoothed conformal p-value of the score; None unless watching."""
    capital: float | None = None
    """Evidence of all recordings so far; an alarm needs 1 / (false-alarm rate). None unless
    watching.
    """
    is_large: bool = False
    """Whether the recording deviates far from the baseline."""
    is_alarm: bool = False
    """Whether the cause of the pump's alarm is present."""
    moved: tuple[BandPowerChange, ...] = ()
    """Band powers that changed, largest change first; also without an alarm."""
    reasons: tuple[str, ...] = ()
    """Sentences: channels that changed as a whole, and band powers that changed; or what is wrong
    with the sensors.
    """
    findings: tuple[SensorFinding, ...] = ()
    """What is wrong with the sensors."""
    pump: AlarmChange | None = None
    """Change of the pump's alarm."""
    sensor: AlarmChange | None = None
    """Change of the sensors' alarm."""
    notes: tuple[str, ...] = ()
    """What was not learned from, and why."""

    def to_dict(self) -> dict[str, Any]:
        """Return the evidence, in numbers and sentences that JSON can hold."""
        hidden = ("state", "band_powers", "pump", "sensor")
        return {name: to_table(value) for name, value in vars(self).items() if name not in hidden}


@dataclass(frozen=True)
class OperatingPointMonitor:
    """The rule of alarms for one machine, without any state.

    docs/explanation/alarms.md describes the method.
    """

    machine: str
    """Name of the machine; with operating point and count it seeds the draws that decide ties."""
    false_alarm_rate: float = 0.01
    """Maximum chance that a healthy machine that does not change ever raises an alarm at one
    operating point.
    """
    baseline_recordings: int = 20
    """Number of recordings that a baseline learns from."""
    pistons: int | None = None
    """Piston count of the machine, if it is known; what a pump prior compares is then learned
    too.
    """

    def __post_init__(self) -> None:
        if not 0 < self.false_alarm_rate < 1:
            raise InputError(
                f"false_alarm_rate ({self.false_alarm_rate:g}) must lie between 0 and 1, "
                "such as 0.01."
            )
        if self.baseline_recordings < MIN_BASELINE_RECORDINGS:
            raise InputError(
                f"baseline_recordings ({self.baseline_recordings}) must be at least "
                f"{MIN_BASELINE_RECORDINGS}."
            )

    def judge(
        self, recording: Recording, state: OperatingPointState | None, *, point: str = "any"
    ) -> OperatingPointJudgment:
        """Return the result of a recording, with the state for the next one.

        Parameters
        ----------
        recording : the next recording of the machine at the operating point, in order of time.
        state : state of the previous judgment, or None if a baseline starts.
        point : name of the operating point.

        Raises
        ------
        DataError
            The recording is unfit, or does not fit the baseline. The state remains valid.
        """
        if recording.n_samples < MIN_SAMPLES:
            raise DataError(
                f"{recording.recording_id} has {plural(recording.n_samples, 'sample')}; record at "
                f"least {MIN_SAMPLES}, better a second."
            )

        # A state without rows may have the layout of a recording with a faulty sensor.
        if state is None or not len(state.baseline.rows):
            sensor = AlarmState()
            if state is not None:
                sensor = state.sensor
            state = OperatingPointState.initial(recording, sensor)

        findings = check_sensors(recording)
        if any(finding.kind in ("flat", "spikes") for finding in findings):
            # A flat channel has no band powers, and those of one with marks of missing values are
            # refused.
            return _judge_faulty_sensor(state, findings, {})

        band_powers = state.baseline.measure(recording)
        named_band_powers = dict(
            zip(band_names(state.baseline.layout), band_powers.tolist(), strict=True)
        )

        if not findings and state.baseline.is_complete:
            findings = check_against_baseline(state.baseline, band_powers)
        if findings:
            return _judge_faulty_sensor(state, findings, named_band_powers)

        sensor, sensor_change = state.sensor.update(False)
        state = replace(state, sensor=sensor)
        if state.baseline.is_complete:
            judgment = self._watch(state, band_powers, recording, point)
        else:
            judgment = self._learn(state, band_powers, recording)
        return replace(judgment, band_powers=named_band_powers, sensor=sensor_change)

    def _learn(
        self,
        state: OperatingPointState,
        band_powers: Float64[np.ndarray, " band"],
        recording: Recording,
    ) -> OperatingPointJudgment:
        baseline, notes = state.baseline.learn(
            band_powers, recording, self.baseline_recordings, self.pistons
        )

        # The baseline is complete now, and the next recording is the first that is bet on.
        test = state.test
        if baseline.is_complete:
            test = ConformalTest.calibrated(baseline.held_out_scores())
        next_state = replace(state, baseline=baseline, test=test)
        return OperatingPointJudgment("learning", len(baseline.rows), next_state, notes=notes)

    def _watch(
        self,
        state: OperatingPointState,
        band_powers: Float64[np.ndarray, " band"],
        recording: Recording,
        point: str,
    ) -> OperatingPointJudgment:
        baseline = state.baseline
        score = baseline.score(band_powers)
        is_large = baseline.is_large(band_powers)

        test = state.test
        # Seeded draws: a restart or a repetition gets the same p-value.
        tie = random_stream(0, "alarm", self.machine, point, test.n_scores).random()
        p_value = test.p_value(score, is_large, tie)
        if not state.pump.is_active:
            # A p-value of 1 lowers every bet, so the promise holds, and small changes gain nothing.
            bet_p_value = 1.0
            if is_large:
                bet_p_value = p_value
            test = test.bet(score, is_large, bet_p_value)
        capital = test.capital

        is_proven = capital * self.false_alarm_rate >= 1
        pump, pump_change = state.pump.update(is_large, is_proven=is_proven)
        if pump_change == "cleared":
            # The next alarm requires new evidence: the test starts without bets.
            test = ConformalTest(test.scores)

        channel_shifts, changes = band_power_changes(
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
            moved=changes,
            reasons=(*channel_shifts, *(change.sentence for change in changes)),
            pump=pump_change,
        )


def _judge_faulty_sensor(
    state: OperatingPointState,
    findings: tuple[SensorFinding, ...],
    band_powers: Mapping[tuple[str, str], float],
) -> OperatingPointJudgment:
    """Return the result of a recording with a faulty sensor: nothing is learned, nothing is bet."""
    sensor, sensor_change = state.sensor.update(True)
    return OperatingPointJudgment(
        "sensor",
        len(state.baseline.rows),
        replace(state, sensor=sensor),
        band_powers=band_powers,
        is_alarm=state.pump.is_active,
        reasons=tuple(finding.sentence for finding in findings),
        findings=findings,
        sensor=sensor_change,
    )
