"""The time until a fault reaches a limit: known courses, too short ones, and dates of recordings."""

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from swashtwin import estimate_remaining_life
from swashtwin.calibration import Dimension, Severity, SeverityTrend
from swashtwin.calibration.severity.remaining_life import life_quantiles
from swashtwin.calibration.severity.severity_result import DimensionEstimate, SeverityVerdict
from swashtwin.cli.twin import _dates_of
from swashtwin.foundation import DataError, InputError, um
from swashtwin.pump import OperatingCondition, PistonWear
from swashtwin.recordings import Recording

START = datetime(2026, 3, 1, tzinfo=UTC)
DAYS = np.arange(0.0, 50.0, 7.0)
SCATTER = 0.04


def make_trend(
    values: Sequence[float],
    verdict: SeverityVerdict = "identified",
    half_width: float = 1.1,
    last_verdict: SeverityVerdict | None = None,
) -> SeverityTrend:
    """Return a trend of clearances [m]."""
    condition = OperatingCondition(speed=90.0, discharge_pressure=15e6)
    clearance = Dimension("clearance", "µm", 1e-6)
    estimates = [
        Severity(
            recording_id=f"week {number}",
            condition=condition,
            fault=PistonWear(value),
            dimensions=(
                DimensionEstimate(
                    clearance,
                    value,
                    (value / half_width, half_width * value),
                    # what it would be without the error of the law, which the interval includes
                    log_std=0.01,
                    verdict=last_verdict if last_verdict and number == len(values) - 1 else verdict,
                ),
            ),
            evidence=100.0,
            threshold=4.0,
            detection_limit=um(18),
            repeatability=SCATTER,
            correlated_with=None,
            misfit=0.5,
            simulations=1,
            wall_s=0.0,
        )
        for number, value in enumerate(values)
    ]
    return SeverityTrend(PistonWear(um(60)), tuple(estimates), (), (), {}, "0")


def dates_after(days: Sequence[float] | np.ndarray) -> list[datetime]:
    return [START + timedelta(days=float(day)) for day in days]


def scattered(course: np.ndarray) -> list[float]:
    noise = np.random.default_rng(3).normal(size=len(course))
    return [float(value) for value in course * np.exp(SCATTER * noise)]


@pytest.mark.parametrize("law", ["linear", "exponential"])
def test_the_remaining_time_of_a_known_growth_lies_in_its_interval(law: str) -> None:
    if law == "linear":
        course, true_days = um(30) + um(2) * DAYS, 85 - DAYS[-1]
    else:
        course, true_days = um(30) * np.exp(0.03 * DAYS), np.log(200 / 30) / 0.03 - DAYS[-1]

    life = estimate_remaining_life(make_trend(scattered(course)), dates_after(DAYS), um(200))
    assert life.interval is not None
    assert life.interval[0] < true_days < life.interval[1]
    assert life.interval[1] / life.interval[0] < 5
    assert life.as_of == START + timedelta(days=49)
    assert " days (90 %: " in life.text


def test_intervals_hold_for_growths_between_linear_and_exponential() -> None:
    # scatter and the common error of the law are those that are stated; nothing else is wrong
    rng = np.random.default_rng(0)
    n_courses = 16
    hits = 0
    for _ in range(n_courses):
        power = rng.uniform(0.05, 1)
        progress = np.linspace(0, 0.7, 8)
        transformed = 0.3**power + (2.5**power - 0.3**power) * progress
        errors = SCATTER * rng.normal(size=8) + 0.08 * rng.normal()
        values = transformed ** (1 / power) * np.exp(errors)
        low, _, high = life_quantiles(
            progress - progress[-1], values, np.full(8, SCATTER), 0.08, 2.5
        )
        hits += low <= 0.3 <= high
    # 0.9 for courses without change of rate, whose intervals are widened by such changes
    assert hits >= 0.9 * n_courses


def test_a_limit_that_is_perhaps_exceeded_leaves_no_long_life() -> None:
    # 0.1 in a day, now at 1.0; all severities have an error of 30 % in common
    days = np.arange(-5.0, 1.0)
    growing = np.linspace(0.5, 1.0, 6)
    scatter = np.full(6, 0.02)
    low, _, high = life_quantiles(days, growing, scatter, 0.3, 1.05)
    assert low < 0.02
    # the limit lies at most at 1.05 times e^0.5
    assert 2 < high < 12


def test_a_probability_at_the_end_of_the_grid_is_counted_once() -> None:
    days = np.arange(-5.0, 1.0)
    growing = np.linspace(0.5, 1.0, 6)
    scatter = np.full(6, 0.02)
    # the two errors at which the limit is exceeded have a probability of 0.23 together
    without = life_quantiles(days, growing, scatter, 0.0, 1.2)[1]
    median = life_quantiles(days, growing, scatter, 0.3, 1.2)[1]
    assert median > 0.3 * without


def test_the_order_of_recordings_does_not_matter() -> None:
    course = scattered(um(30) + um(2) * DAYS)
    life = estimate_remaining_life(make_trend(course), dates_after(DAYS), um(200))
    turned = estimate_remaining_life(make_trend(course[::-1]), dates_after(DAYS)[::-1], um(200))
    assert turned.days == life.days


def test_a_severity_that_does_not_grow_determines_no_time() -> None:
    steady = scattered(np.full(8, um(60)))
    life = estimate_remaining_life(make_trend(steady), dates_after(DAYS), um(200))
    assert life.days is None
    assert life.interval is None
    assert "does not exclude a remaining time of more than 10 times as long" in life.text
    assert life.to_dict()["days"] is None


def test_a_limit_that_is_reached_is_reported() -> None:
    course = scattered(um(30) + um(2) * DAYS)
    life = estimate_remaining_life(make_trend(course), dates_after(DAYS), um(100))
    assert (life.days, life.text) == (0.0, "reached")

    # the interval of the newest severity reaches below the limit: perhaps it is reached
    unsure = estimate_remaining_life(
        make_trend(course, half_width=1.5), dates_after(DAYS), course[-1] / 1.1
    )
    assert unsure.interval is not None
    assert unsure.interval[0] < 1


def test_the_error_of_the_law_widens_the_interval() -> None:
    course = scattered(um(30) + um(2) * DAYS)
    ratios = []
    for half_width in (1.05, 1.15, 1.4):
        trend = make_trend(course, half_width=half_width)
        life = estimate_remaining_life(trend, dates_after(DAYS), um(200))
        assert life.interval is not None
        ratios.append(life.interval[1] / life.interval[0])
    assert ratios == sorted(ratios)
    assert ratios[-1] > 1.5 * ratios[0]


@pytest.mark.parametrize("verdict", ["at bound", "in doubt", "not detected"])
def test_a_newest_severity_that_is_not_used_is_no_reason_for_silence(
    verdict: SeverityVerdict,
) -> None:
    course = scattered(um(30) + um(2) * DAYS)
    life = estimate_remaining_life(
        make_trend(course, last_verdict=verdict), dates_after(DAYS), um(200)
    )
    assert life.text == f"not yet known: the newest severity is {verdict}"


def test_a_severity_beyond_the_search_exceeds_a_limit() -> None:
    course = [*scattered(um(30) + um(2) * DAYS[:-1]), um(400)]
    trend = make_trend(course, last_verdict="at bound")
    assert estimate_remaining_life(trend, dates_after(DAYS), um(200)).text == "reached"

    # also if it is the first severity of all
    first = make_trend([um(400)], "at bound")
    assert estimate_remaining_life(first, dates_after([0.0]), um(200)).text == "reached"
    # but not in doubt, where nothing limits it
    doubtful = make_trend([um(400)], "in doubt")
    assert estimate_remaining_life(doubtful, dates_after([0.0]), um(200)).days is None


@pytest.mark.parametrize(
    ("verdict", "number", "reason"),
    [
        (
            "identified",
            3,
            "4 severities at different times are needed, and there are 3, of 14 days",
        ),
        ("not detected", 8, "no severity is identified"),
        ("in doubt", 8, "no severity is identified"),
    ],
)
def test_too_little_is_not_extrapolated(verdict: SeverityVerdict, number: int, reason: str) -> None:
    course = (um(30) + um(2) * DAYS)[:number]
    life = estimate_remaining_life(
        make_trend(list(course), verdict), dates_after(DAYS[:number]), um(200)
    )
    assert life.text == f"not yet known: {reason}"


def test_recordings_of_one_moment_determine_no_growth() -> None:
    life = estimate_remaining_life(make_trend([um(60)] * 8), [START] * 8, um(200))
    assert "there are 8, of 0 days" in life.text


def test_bad_limits_and_dates_are_reported() -> None:
    trend = make_trend([um(60)] * 4)
    with pytest.raises(InputError, match="must be a positive number"):
        estimate_remaining_life(trend, dates_after(range(4)), float("nan"))
    with pytest.raises(InputError, match="3 dates for 4 severities"):
        estimate_remaining_life(trend, dates_after(range(3)), um(100))
    mixed = [
        date.replace(tzinfo=None if number else UTC) for number, date in enumerate([START] * 4)
    ]
    with pytest.raises(InputError, match="some dates have a time zone"):
        estimate_remaining_life(trend, mixed, um(100))


def test_a_recording_without_a_date_is_named() -> None:
    samples = np.ones((1, 8))
    dated = Recording(samples, 1.0, "a", attributes={"date": "2026-03-01 08:30"})
    assert _dates_of([dated]) == {"a": datetime(2026, 3, 1, 8, 30, tzinfo=UTC)}

    with pytest.raises(DataError, match=r"b has no date\. --limit needs the date"):
        _dates_of([dated, Recording(samples, 1.0, "b")])
    with pytest.raises(DataError, match="the date 'spring', which is not like 2024-05-31"):
        _dates_of([Recording(samples, 1.0, "c", attributes={"date": "spring"})])
