"""Remaining life from severities, compared with the true course of wear on the virtual rig."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime, timedelta
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from swashtwin.calibration import (
    SeveritySettings,
    calibrate,
    estimate_remaining_life,
    estimate_severity,
)
from swashtwin.foundation import from_table, mm, random_stream
from swashtwin.physics import Twin
from swashtwin.pump import FAULT_KINDS, SwashPlateDefect, load_pump
from swashtwin_bench.results.runs import Task, Work
from swashtwin_bench.results.table import StudyTable, Trial, describe_origin
from swashtwin_bench.rigs.courses import TRENDS, PlantCourse, plant_course
from swashtwin_bench.rigs.writing import RIG_VERSION

METRICS = {
    "known": "share of courses whose remaining life is stated",
    "coverage": "share of stated 90 % intervals that hold the truth",
    "width": "median upper over lower end",
    "error": "median |ln(median / truth)|",
    "line_coverage": "the same share for a straight line",
    "line_error": "the same error for a straight line",
}

PUMP = "A"
"""Pump of each fleet that wears."""

START = mm(36)
"""Length of a recess from which the search starts; the rig's are 30 mm."""

LIFE_DAYS = 100.0
"""Time from the first worn recording to the limit [day]; an interval does not depend on it."""

_FIRST_DATE = datetime(2026, 1, 1, tzinfo=UTC)

# Steps of the integration of a course, for each unit of time.
_N_STEPS = 4000

# Rate of wear without its wander: a linear course then lasts about one unit of time.
_RATE = 2.0

# Time in which the rate forgets its value.
_RATE_MEMORY = 0.25


@dataclass(frozen=True)
class LifeStudySettings:
    """Courses of wear, and when the remaining life is estimated."""

    kinds: tuple[str, ...] = tuple(TRENDS)
    """Faults that grow, names in `TRENDS`."""
    first: float = 0.4
    """Severity of the first worn recording over the typical one."""
    limit: float = 2.5
    """Severity at which the life ends, over the typical one."""
    worn: int = 9
    """Worn recordings, evenly over three quarters of the life."""
    healthy: int = 4
    """Healthy recordings before, on which the twin is calibrated."""
    at: tuple[int, ...] = (6, 9)
    """Worn recordings after which the remaining life is estimated."""
    wander: float = 0.25
    """Standard deviation of the logarithm of the rate of wear, which forgets its value in a
    quarter of the life [our choice].
    """
    rig: str = RIG_VERSION
    """Version of the virtual rig, 1 or 2."""


@dataclass(frozen=True)
class _Forecast:
    """What is said of the remaining life at one time of a course, and what is true [day]."""

    seed: int
    kind: str
    recordings: int
    truth: float
    days: float | None
    interval: tuple[float, float] | None
    reason: str
    line: tuple[float, float, float]
    """Lower end, median and upper end of a straight line."""
    severities: tuple[float, ...]
    """Estimates over the limit."""
    verdicts: tuple[str, ...]

    def values(self) -> dict[str, float]:
        """Return the metrics."""
        low, middle, high = self.line
        values = {
            "known": float(self.days is not None),
            "line_coverage": float(low <= self.truth <= high),
            "line_error": abs(math.log(middle / self.truth)) if middle > 0 else math.inf,
        }
        if self.days is None:
            return values
        if self.interval is None:
            # the limit is said to be reached, and is not
            return {**values, "coverage": 0.0}

        low, high = self.interval
        return {
            **values,
            "coverage": float(low <= self.truth <= high),
            "width": high / low,
            "error": abs(math.log(self.days / self.truth)),
        }


def life(work: Work, settings: LifeStudySettings) -> StudyTable:
    """Return how often the intervals of the remaining life hold, and how wide they are.

    The severity x of each course grows by dx/dt = r x^p, with p between 0 and 1, and a rate r that
    wanders; both are drawn for each course. The pump is not taken apart between recordings.

    Parameters
    ----------
    work : its seeds are fleets of the rig; one pump of each wears once with each fault.
    """
    courses = [
        (seed, kind, settings, work.out) for seed, kind in product(work.seeds, settings.kinds)
    ]
    trials: list[Trial] = []
    forecasts: list[_Forecast] = []
    for run in work.map("courses", _run, courses):
        for forecast in from_table(run["forecasts"], list[_Forecast]):
            factors = {"fault": forecast.kind, "recordings": str(forecast.recordings)}
            trials.append(Trial(factors, forecast.seed, forecast.values()))
            forecasts.append(forecast)

    shortest = PlantCourse(recordings=1, duration=0.1, version=settings.rig)
    first, _ = next(plant_course(work.seeds[0], PUMP, shortest))
    return StudyTable(
        study="life",
        title="How long until a fault reaches a limit?",
        metrics=METRICS,
        trials=tuple(trials),
        answer=tuple(_answer(forecasts, settings)),
        settings=asdict(settings),
        origin=describe_origin([first]),
        notes=(
            "The growth of a fault on the rig is our choice: x grows by x^p with p uniform between "
            "0 and 1 and a wandering rate. On a real pump nobody knows it.",
        ),
        details={"forecasts": [asdict(forecast) for forecast in forecasts]},
    )


def _run(seed: int, kind: str, settings: LifeStudySettings, out: Path | None) -> dict[str, Any]:
    """Return the forecasts of a course as JSON values, from `out` if they are there."""
    # other faults of the study do not change this one
    course_settings = asdict(replace(settings, kinds=(kind,)))
    task = Task("life", seed, {"fault": kind}, course_settings, f"virtual rig {settings.rig}")
    return task.run(
        out, lambda: {"forecasts": [asdict(item) for item in _forecast(seed, kind, settings)]}
    )


def _forecast(seed: int, kind: str, settings: LifeStudySettings) -> list[_Forecast]:
    """Return the remaining life at each time of a course, with the truth and a straight line's."""
    typical = TRENDS[kind].severity
    progress, end_of_life = _draw_course(seed, kind, settings)
    sizes = [0.0] * settings.healthy + [float(value) for value in progress]
    course = PlantCourse(recordings=len(sizes), kind=kind, version=settings.rig)
    pairs = list(plant_course(seed, PUMP, course, severities=sizes))
    recordings = [recording for recording, _ in pairs]
    healthy, worn = recordings[: settings.healthy], recordings[settings.healthy :]

    assert healthy[0].condition is not None
    twin = Twin(load_pump("25scy14-1b"), healthy[0].condition)
    calibration = calibrate(twin, healthy, band=SeveritySettings().band)
    start = FAULT_KINDS[kind]
    assert start is not None
    if isinstance(start, SwashPlateDefect):
        start = replace(start, length=START)
    trend = estimate_severity(calibration, worn, start, healthy=healthy)
    assert len(trend.estimates) == settings.worn

    step_days = 0.75 * LIFE_DAYS / (settings.worn - 1)
    days = step_days * np.arange(settings.worn)
    limit = settings.limit * typical
    forecasts = []
    for count in settings.at:
        part = replace(trend, estimates=trend.estimates[:count])
        dates = [_FIRST_DATE + timedelta(days=float(day)) for day in days[:count]]
        result = estimate_remaining_life(part, dates, limit)
        values = np.array([estimate.severity.value for estimate in part.estimates])

        forecast = _Forecast(
            seed=seed,
            kind=kind,
            recordings=count,
            truth=end_of_life - float(days[count - 1]),
            days=result.days,
            interval=result.interval,
            reason=result.reason,
            line=_straight_line(days[:count] - days[count - 1], values, limit),
            severities=tuple(float(value / limit) for value in values),
            verdicts=tuple(estimate.severity.verdict for estimate in part.estimates),
        )
        forecasts.append(forecast)
    return forecasts


def _draw_course(
    seed: int, kind: str, settings: LifeStudySettings
) -> tuple[Float[np.ndarray, " recording"], float]:
    """Return the severities of the worn recordings, over the typical one, and the end of life
    [day].
    """
    rng = random_stream(seed, "life", kind)
    power = rng.uniform(0, 1)
    step = 1 / _N_STEPS
    memory = math.exp(-step / _RATE_MEMORY)
    noise = rng.normal(size=4 * _N_STEPS)
    deviation = rng.normal()

    severity = [settings.first]
    for innovation in noise:
        if severity[-1] >= settings.limit:
            break
        deviation = memory * deviation + math.sqrt(1 - memory**2) * innovation
        rate = _RATE * math.exp(settings.wander * deviation)
        severity.append(severity[-1] + step * rate * severity[-1] ** power)

    # any course is stretched to the same life
    times = np.linspace(0, LIFE_DAYS, len(severity))
    recorded = np.linspace(0, 0.75 * LIFE_DAYS, settings.worn)
    return np.interp(recorded, times, severity), LIFE_DAYS


def _straight_line(
    days: Float[np.ndarray, " recording"], values: Float[np.ndarray, " recording"], limit: float
) -> tuple[float, float, float]:
    """Return the 90 % interval and the median of the time at which a line by least squares meets
    the limit, from draws of its posterior; infinite if it never does.
    """
    design = np.column_stack([np.ones_like(days), days])
    coefficients, *_ = np.linalg.lstsq(design, values, rcond=None)
    residual = values - design @ coefficients
    degrees = len(days) - 2
    covariance = np.linalg.inv(design.T @ design) * (residual @ residual) / degrees

    rng = random_stream(0, "straight line")
    draws = rng.multivariate_normal(np.zeros(2), covariance, size=4000)
    draws *= np.sqrt(degrees / rng.chisquare(degrees, size=(4000, 1)))
    level, slope = (coefficients + draws).T
    growing = slope > 0
    times = np.full(len(slope), np.inf)
    times[growing] = np.maximum(limit - level[growing], 0) / slope[growing]
    low, middle, high = np.quantile(times, [0.05, 0.5, 0.95], method="nearest")
    return float(low), float(middle), float(high)


def _answer(forecasts: Sequence[_Forecast], settings: LifeStudySettings) -> list[str]:
    sentences = []
    for count in settings.at:
        rows = [forecast.values() for forecast in forecasts if forecast.recordings == count]
        held = [row["coverage"] for row in rows if "coverage" in row]
        if not held:
            sentences.append(f"After {count} recordings no remaining life is stated.")
            continue
        widths = [row["width"] for row in rows if "width" in row]
        # both on the same courses
        known = [row for row in rows if "error" in row]
        if not known:
            sentences.append(f"After {count} recordings all limits are said to be exceeded.")
            continue
        error = float(np.median([row["error"] for row in known]))
        line_error = float(np.median([row["line_error"] for row in known]))
        line_text = "it never meets the limit"
        if math.isfinite(line_error):
            line_text = f"error {math.expm1(line_error):.0%}"
        sentences.append(
            f"After {count} recordings {len(held)} of {len(rows)} lives are stated; "
            f"{sum(held):.0f} of {len(held)} intervals hold the truth, their ends differ by a "
            f"factor of {np.median(widths):.2g} in the median, and the median error is "
            f"{math.expm1(error):.0%}. A straight line through the same severities: "
            f"{sum(row['line_coverage'] for row in known):.0f} of {len(known)} hold, {line_text}."
        )
    return sentences
