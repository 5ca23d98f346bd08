"""The sequential test and the state of an alarm: known values, and what both guarantee."""

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

FALSE_ALARM_RATE = 0.05
N_LEARNED = 20


def capitals_after_learning(
    scores: np.ndarray, is_large: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """Return the capital after each recording that follows the `N_LEARNED` first ones.

    Recordings that are not large are bet on at a p-value of 1, as the monitor does.
    """
    pairs = list(zip(scores.tolist(), is_large.tolist(), strict=True))
    test = ConformalTest.calibrated(pairs[:N_LEARNED])

    capitals = []
    for score, large in pairs[N_LEARNED:]:
        p_value = test.p_value(score, large, rng.random())
        test = test.bet(score, large, p_value if large else 1.0)
        capitals.append(test.capital)
    return np.array(capitals)


@pytest.mark.parametrize("large_share", [0.01, 0.05, 0.3, 0.6])
def test_each_bet_pays_one_on_average_over_uniform_p_values(large_share: float) -> None:
    # Midpoints, since the bets with exponents have a pole at zero.
    p_values = (np.arange(40_000) + 0.5) / 40_000
    payoffs_of_all = [payoffs(p_value, large_share) for p_value in p_values.tolist()]
    steepest_mean, *means = np.mean(payoffs_of_all, axis=0)

    assert means == pytest.approx([1.0] * (N_BETS - 1), abs=0.03)
    # The sum misses most of the pole: what lies below the first step of 1 / 40,000.
    assert steepest_mean == pytest.approx(1 - 2.5e-5 ** POWERS[0], abs=0.2)


def test_bets_at_a_p_value_of_one_percent_have_the_values_of_a_hand_calculation() -> None:
    # e p^(e - 1) for each exponent, then g / b for each stake, since 0.01 is below the share 0.1
    powers = [0.1 * 0.01**-0.9, 0.3 * 0.01**-0.7, 0.5 * 0.01**-0.5]
    stakes = [5, 8, 9.5]

    assert payoffs(0.01, 0.1).tolist() == pytest.approx([*powers, *stakes])


def test_stakes_lose_at_a_p_value_above_the_share_of_large_recordings() -> None:
    # (1 - g) / (1 - b) for each stake
    lost_stakes = [0.5 / 0.9, 0.2 / 0.9, 0.05 / 0.9]

    assert payoffs(0.2, 0.1).tolist()[3:] == pytest.approx(lost_stakes)


def test_the_first_bet_stakes_half_of_the_capital() -> None:
    test = ConformalTest.calibrated([(1.0, False)])
    test = test.bet(5.0, True, 0.01)

    # One of two recordings is large.
    mean_payoff = payoffs(0.01, 0.5).mean()
    assert test.capital == pytest.approx(0.5 + 0.5 * mean_payoff)


def test_smoothed_p_values_of_exchangeable_scores_are_uniform_even_with_many_ties() -> None:
    rng = np.random.default_rng(1)
    p_values = []
    for _ in range(4000):
        # Four values among twelve recordings, so that nearly each score has ties.
        scores = rng.integers(0, 4, 12) / 2
        pairs = [(float(score), bool(score > 1)) for score in scores]
        test = ConformalTest.calibrated(pairs[:-1])
        p_values.append(test.p_value(*pairs[-1], rng.random()))

    counts, _ = np.histogram(p_values, bins=10, range=(0, 1))
    # Four standard deviations of a tenth of 4,000 draws are 0.019.
    assert counts / len(p_values) == pytest.approx([0.1] * 10, abs=0.02)


@pytest.mark.parametrize("large_share", [0.03, 0.3, 1.0])
def test_exchangeable_recordings_reach_the_limit_at_most_as_often_as_promised(
    large_share: float,
) -> None:
    rng = np.random.default_rng(2)
    has_reached_limit = []
    # 200 machines, each watched for 150 recordings
    for _ in range(200):
        scores = rng.exponential(size=N_LEARNED + 150)
        is_large = scores > -np.log(large_share)
        capitals = capitals_after_learning(scores, is_large, rng)
        has_reached_limit.append(capitals.max() >= 1 / FALSE_ALARM_RATE)

    # The upper end of the 95 % interval, so that luck with the seed does not pass.
    _, upper_rate = wilson_interval(float(np.mean(has_reached_limit)), len(has_reached_limit))
    assert upper_rate <= FALSE_ALARM_RATE


# A test that bet long in vain must not need longer: new starts begin at each recording.
@pytest.mark.parametrize("n_healthy", [30, 300, 2000])
def test_a_lasting_change_is_noticed_within_six_recordings_early_and_late(n_healthy: int) -> None:
    rng = np.random.default_rng(3)
    for _ in range(5):
        scores = rng.exponential(size=n_healthy + 6)
        scores[n_healthy:] += 20
        is_large = np.arange(len(scores)) >= n_healthy

        capitals = capitals_after_learning(scores, is_large, rng)

        assert capitals.max() >= 100
        assert capitals[: n_healthy - N_LEARNED].max() < 100


SCORES = some.floats(0, 1e7)
P_VALUES = some.floats(0.001, 1)


@given(some.lists(some.tuples(SCORES, some.booleans(), P_VALUES), max_size=30))
def test_a_test_that_went_through_json_goes_on_as_if_it_had_not(
    steps: list[tuple[float, bool, float]],
) -> None:
    test = ConformalTest.calibrated([(0.5, False), (0.0, False), (2.0, True)])
    stored_test = test
    for step in steps:
        test = test.bet(*step)
        text = json.dumps(to_table(stored_test.bet(*step)))
        stored_test = from_table(json.loads(text), ConformalTest)

    # Exactly equal: the history must not depend on when a watch was restarted.
    assert stored_test.capital == test.capital
    assert stored_test.n_scores == 3 + len(steps)
    assert stored_test.p_value(1.0, True, 0.3) == test.p_value(1.0, True, 0.3)


@given(some.lists(some.tuples(some.booleans(), P_VALUES), min_size=1, max_size=40))
def test_a_bet_at_one_in_place_of_a_p_value_never_raises_the_capital(
    steps: list[tuple[bool, float]],
) -> None:
    # The guard against drift bets so. It keeps the promise of the test without the guard, since
    # its capital stays below.
    test = ConformalTest.calibrated([(1.0, False)])
    guarded_test = test
    for is_large, p_value in steps:
        test = test.bet(1.0, is_large, p_value)
        guarded_test = guarded_test.bet(1.0, is_large, p_value if is_large else 1.0)

        assert guarded_test.capital <= test.capital * (1 + 1e-12)


@given(some.floats(0, 1e9), some.floats(0, 1e9))
def test_the_grid_keeps_the_order_of_scores(first: float, second: float) -> None:
    low, high = sorted([first, second])

    assert rank_step(low, False) <= rank_step(high, False)
    # Any large recording ranks above all that are not.
    assert rank_step(high, False) < rank_step(low, True)
    assert rank_step(low, True) <= rank_step(high, True)


@given(some.lists(some.tuples(some.booleans(), some.booleans()), max_size=60))
def test_an_alarm_is_raised_by_persistence_with_evidence_and_cleared_by_quiet(
    recordings: list[tuple[bool, bool]],
) -> None:
    state = AlarmState()
    large_so_far = []
    changes = []
    for is_large, is_proven in recordings:
        was_active = state.is_active
        state, change = state.update(is_large, is_proven=is_proven)
        large_so_far.append(is_large)

        is_quiet = len(large_so_far) >= N_QUIET and not any(large_so_far[-N_QUIET:])
        assert (change == "cleared") == (was_active and is_quiet)

        if change == "raised":
            assert is_proven
            assert sum(large_so_far[-N_RECENT:]) >= N_PERSISTENT
        if change:
            changes.append(change)

    # An alarm is neither raised twice nor cleared before it was raised.
    expected_changes = ["raised", "cleared"] * len(changes)
    assert changes == expected_changes[: len(changes)]
