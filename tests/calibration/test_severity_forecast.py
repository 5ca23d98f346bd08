"""Forecasts of a severity: a line through a trend, its band, and the date of a limit."""

import math

import numpy as np
import pytest

from swashtwin.calibration import Dimension, Severity, SeverityTrend
from swashtwin.calibration.severity.severity import DimensionEstimate
from swashtwin.foundation import InputError, mm, stream, um
from swashtwin.pump import OperatingCondition, PistonWear

QUANTILE = 1.6449
HOURS = (0.0, 200.0, 400.0, 600.0)


def _severity(value: float, at: OperatingCondition, repeatability: float = 0.05, law: float = 0.1) -> Severity:
    """An estimate whose interval holds its repeatability and an error that is common to all."""
    factor = math.exp(QUANTILE * math.hypot(repeatability, law))
    interval = (value / factor, value * factor) if value > 0 else (0.0, um(20))
    clearance = DimensionEstimate(Dimension("clearance", "µm", 1e-6), value, interval, law, "identified")
    scatter = repeatability if value > 0 else math.inf
    return Severity("worn", at, None, (clearance,), 9.0, 2.7, um(10), scatter, None, 1.0, 1, 1.0)


def _trend(values: "list[float]", at: OperatingCondition, law: float = 0.1) -> SeverityTrend:
    estimates = tuple(_severity(value, at, law=law) for value in values)
    return SeverityTrend(PistonWear(um(60)), estimates, (), (), {}, "0")


def test_a_steady_growth_goes_on(at_15: OperatingCondition) -> None:
    forecast = _trend([um(20), um(40), um(60), um(80)], at_15).forecast(HOURS, [800, 1000], limit=um(90))
    assert forecast.value == pytest.approx([um(100), um(120)])
    assert forecast.rate == pytest.approx(um(0.1))
    assert (forecast.low < forecast.value).all()
    assert (forecast.value < forecast.high).all()
    earliest, likely, latest = forecast.reached
    assert likely == pytest.approx(700, abs=1)
    assert earliest is not None
    assert latest is not None
    assert 600 <= earliest < 700 < latest
    assert repr(forecast).endswith("at 1000>")


def test_an_error_common_to_all_recordings_widens_the_band_as_a_whole(at_15: OperatingCondition) -> None:
    values = [um(20), um(40), um(60), um(80)]
    sure, unsure = (_trend(values, at_15, law=law).forecast(HOURS, [800]) for law in (0.0, 0.3))
    assert unsure.value == pytest.approx(sure.value)
    assert unsure.high[0] > 1.3 * sure.high[0]
    assert unsure.low[0] < sure.low[0] / 1.3


def test_the_band_holds_nine_of_ten_truths(at_15: OperatingCondition) -> None:
    random, hits = stream(0, "forecast"), []
    for _ in range(300):
        shared = math.exp(random.normal(0, 0.1))
        values = [shared * truth * math.exp(random.normal(0, 0.05)) for truth in (um(40), um(60), um(80), um(100))]
        forecast = _trend(values, at_15).forecast(HOURS, [800])
        hits.append(forecast.low[0] < um(120) < forecast.high[0])
    assert 0.85 <= np.mean(hits) <= 0.99


def test_what_was_not_detected_counts_as_small(at_15: OperatingCondition) -> None:
    forecast = _trend([0.0, 0.0, um(60), um(90)], at_15).forecast(HOURS, [800])
    assert forecast.value[0] > um(90)
    nothing = _trend([0.0, 0.0, 0.0], at_15).forecast(HOURS[:3], [800], limit=mm(1))
    assert nothing.value[0] == 0
    assert nothing.low[0] == 0
    assert nothing.high[0] > 0
    assert nothing.reached == (None, None, None)


def test_a_forecast_without_enough_recordings_or_sense_is_refused(at_15: OperatingCondition) -> None:
    trend = _trend([um(20), um(40), um(60)], at_15)
    with pytest.raises(InputError, match="2 times for 3 estimates"):
        trend.forecast([0, 1], [2])
    with pytest.raises(InputError, match="recordings at 3 different times, not at 2"):
        trend.forecast([0, 1, 1], [2])
    with pytest.raises(InputError, match="must be finite numbers"):
        trend.forecast([0, 1, math.nan], [2])
    with pytest.raises(InputError, match=r"limit \(0\) must be a severity above 0"):
        trend.forecast([0, 1, 2], [3], limit=0.0)
