"""The sequential test and the alarm's condition: known values, the promise, evidence after a
change, their state.
"""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as some

from swashtwin.foundation import from_table, to_table
from swashtwin.learning import wilson_interval
from swashtwin.monitoring.alarms.monitor import (
    N_BETS,
    N_PERSISTENT,
    N_QUIET,
    N_RECENT,
    POWERS,
    AlarmState,
    ConformalTest,
    payoffs,
    rank_step,
)

LIMIT = 0.05


def run(
    scores: np.ndarray, is_large: np.ndarray, learning: int, rng: np.random.Generator
) -> np.ndarray:
    """Capital after each recording that follows the first `learning` ones; those that are not large
    are bet on at 1.
    """
    pairs = list(zip(scores.tolist(), is_large.tolist(), strict=True))
    test = ConformalTest.calibrated(pairs[:learning])
    capital = []
    for score, large in pairs[learning:]:
        p_value = test.p_value(score, large, rng.random())
        test = test.bet(score, large, p_value if large else 1.0)
        capital.append(test.capital)
    return np.array(capital)


@pytest.mark.parametrize("large_share", [0.01, 0.05, 0.3, 0.6])
def test_each_bet_pays_one_on_average_over_uniform_p_values(large_share: float) -> None:
    p_values = (np.arange(40_000) + 0.5) / 40_000
    mean = np.mean([payoffs(p_value, large_share) for p_value in p_values.tolist()], axis=0)
    assert mean[1:] == pytest.approx([1.0] * (N_BETS - 1), abs=0.03)
    assert mean[0] == pytest.approx(
        1 - 2.5e-5 ** POWERS[0], abs=0.2
    )  # the sum misses most of the pole at 0


def test_bets_at_a_p_value_of_one_percent_have_the_values_of_a_hand_calculation() -> None:
    powers = [0.1 * 0.01**-0.9, 0.3 * 0.01**-0.7, 0.5 * 0.01**-0.5]
    assert payoffs(0.01, 0.1).tolist() == pytest.approx([*powers, 5, 8, 9.5])
    assert payoffs(0.2, 0.1).tolist()[3:] == pytest.approx([0.5 / 0.9, 0.2 / 0.9, 0.05 / 0.9])


def test_the_first_bet_stakes_half_of_the_capital() -> None:
    test = ConformalTest.calibrated([(1.0, False)]).bet(5.0, True, 0.01)
    assert test.capital == pytest.approx(0.5 + 0.5 * payoffs(0.01, 0.5).mean())


def test_smoothed_p_values_of_exchangeable_scores_are_uniform_even_with_many_ties() -> None:
    rng = np.random.default_rng(1)
    p_values = []
    for _ in range(4000):
        scores = rng.integers(0, 4, 12) / 2
        pairs = [(float(score), bool(score > 1)) for score in scores]
        test = ConformalTest.calibrated(pairs[:-1])
        p_values.append(test.p_value(*pairs[-1], rng.random()))
    share = np.histogram(p_values, bins=10, range=(0, 1))[0] / len(p_values)
    assert share == pytest.approx([0.1] * 10, abs=0.02)


@pytest.mark.parametrize("share", [0.03, 0.3, 1.0])
def test_exchangeable_recordings_reach_the_limit_at_most_as_often_as_promised(share: float) -> None:
    """200 machines of 150 recordings, this share of them large; the upper end of the 95 % interval
    counts.
    """
    rng = np.random.default_rng(2)
    ever = []
    for _ in range(200):
        scores = rng.exponential(size=170)
        ever.append(run(scores, scores > -np.log(share), 20, rng).max() >= 1 / LIMIT)
    _, high = wilson_interval(float(np.mean(ever)), len(ever))
    assert high <= LIMIT


@pytest.mark.parametrize(("change", "recordings"), [(30, 6), (300, 6), (2000, 6)])
def test_a_lasting_change_is_noticed_within_six_recordings_early_and_late(
    change: int, recordings: int
) -> None:
    rng = np.random.default_rng(3)
    for _ in range(5):
        scores = rng.exponential(size=change + recordings)
        scores[change:] += 20
        capital = run(scores, np.arange(len(scores)) >= change, 20, rng)
        assert capital.max() >= 100
        assert capital[: change - 20].max() < 100


@given(
    some.lists(
        some.tuples(some.floats(0, 1e7), some.booleans(), some.floats(0.001, 1)), max_size=30
    )
)
def test_a_test_that_went_through_json_goes_on_as_if_it_had_not(
    steps: list[tuple[float, bool, float]],
) -> None:
    test = stored_test = ConformalTest.calibrated([(0.5, False), (0.0, False), (2.0, True)])
    for step in steps:
        test = test.bet(*step)
        stored_test = from_table(
            json.loads(json.dumps(to_table(stored_test.bet(*step)))), ConformalTest
        )
    assert stored_test.capital == test.capital
    assert stored_test.n_scores == 3 + len(steps)
    assert stored_test.p_value(1.0, True, 0.3) == test.p_value(1.0, True, 0.3)


@given(some.lists(some.tuples(some.booleans(), some.floats(0.001, 1)), min_size=1, max_size=40))
def test_a_bet_at_one_in_place_of_a_p_value_never_raises_the_capital(
    steps: list[tuple[bool, float]],
) -> None:
    """What the guard against drift does: its capital stays below that of the test which keeps the
    promise.
    """
    test = guarded = ConformalTest.calibrated([(1.0, False)])
    for is_large, p_value in steps:
        test = test.bet(1.0, is_large, p_value)
        guarded = guarded.bet(1.0, is_large, p_value if is_large else 1.0)
        assert guarded.capital <= test.capital * (1 + 1e-12)


@given(some.floats(0, 1e9), some.floats(0, 1e9))
def test_the_grid_keeps_the_order_of_scores(first: float, second: float) -> None:
    low, high = sorted([first, second])
    assert (
        rank_step(low, False)
        <= rank_step(high, False)
        < rank_step(low, True)
        <= rank_step(high, True)
    )


@given(some.lists(some.tuples(some.booleans(), some.booleans()), max_size=60))
def test_an_alarm_is_raised_by_persistence_with_evidence_and_cleared_by_quiet(
    course: list[tuple[bool, bool]],
) -> None:
    state = AlarmState()
    events = []
    for number, (is_large, is_proven) in enumerate(course):
        was_active = state.is_active
        state, change = state.update(is_large, is_proven=is_proven)
        supports = [large for large, _ in course[: number + 1]]
        is_quiet = len(supports) >= N_QUIET and not any(supports[-N_QUIET:])
        assert (change == "cleared") == (was_active and is_quiet)
        assert change != "raised" or (is_proven and sum(supports[-N_RECENT:]) >= N_PERSISTENT)
        events += [change] if change else []
    assert events == [("raised", "cleared")[n % 2] for n in range(len(events))]
