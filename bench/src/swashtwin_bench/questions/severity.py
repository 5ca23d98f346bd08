"""Accuracy of severities from inversion, compared with the virtual rig's hidden truth."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise, product

import numpy as np
import scipy.stats

from swashtwin.calibration import (
    GaussNewton,
    Nuisances,
    SeveritySettings,
    calibrate,
    estimate_severity,
)
from swashtwin.foundation import mm
from swashtwin.physics import Twin
from swashtwin.pump import FAULT_KINDS, SwashPlateDefect, load_pump
from swashtwin_bench.results.runs import Work
from swashtwin_bench.results.table import StudyTable, Trial, describe_origin
from swashtwin_bench.rigs.courses import TRENDS, trend_recordings

METRICS = {
    "error": "median |ln(estimate / truth)|",
    "bias": "mean ln(estimate / truth)",
    "coverage": "share of 90 % intervals that hold the truth",
    "identified": "share identified",
    "detected": "share detected",
    "false_alarms": "share of healthy recordings detected",
    "rank": "rank correlation along one pump's trend",
    "change": "median |ln| error of a change along it",
    "limit": "detection limit over the typical severity",
    "wall_s": "time per recording [s]",
}

START = mm(36)
"""Length of a recess from which the search starts.

The rig's are 30 mm. Depths start at the paper's 0.6 mm.
"""

MIN_ESTIMATE_SHARE = 0.05
"""Smallest estimate over the truth in error and bias, so that a logarithm of zero is finite."""

PUMPS = ("A",)
"""Pumps of each fleet."""


@dataclass(frozen=True)
class _Case:
    """One dimension estimated from one recording."""

    kind: str
    dimension: str
    seed: int
    specimen: str
    recording_id: str
    truth: float
    estimate: float
    low: float
    high: float
    verdict: str
    detected: bool
    limit: float | None
    wall_s: float

    @property
    def error(self) -> float:
        """Logarithm of the estimate over the truth, at least that of `MIN_ESTIMATE_SHARE`."""
        return math.log(max(self.estimate, MIN_ESTIMATE_SHARE * self.truth) / self.truth)


@dataclass(frozen=True)
class SeverityStudySettings:
    """Trends that are recorded."""

    severities: tuple[float, ...] = (0.3, 0.6, 1.0, 1.7, 3.0)
    """Severities over the rig's typical ones."""


def severity(work: Work, settings: SeverityStudySettings) -> StudyTable:
    """Return errors by fault and dimension, on trends of the virtual rig's pumps.

    Each pump is calibrated on four healthy recordings at 10 MPa, with typical nuisances, up to 1
    kHz. Each recording of its trends, and a fifth healthy one, is then inverted separately.

    Parameters
    ----------
    work : its seeds are fleets of the rig; one pump of each.
    """
    pumps = [(seed, name, settings.severities) for seed, name in product(work.seeds, PUMPS)]
    cases: list[_Case] = []
    for pump_cases in work.map("pumps", _estimate_pump, pumps):
        cases += pump_cases

    healthy = trend_recordings(work.seeds[0], PUMPS[0], severities=(), healthy=1, duration=0.1)
    first, _ = next(healthy)

    return StudyTable(
        study="severity",
        title="How severe is the fault? Severity by inversion against the hidden truth",
        metrics=METRICS,
        trials=tuple(_trials(cases, work.seeds)),
        answer=tuple(_answer(cases)),
        settings={
            "severities": list(settings.severities),
            "pumps": list(PUMPS),
            **asdict(SeveritySettings()),
        },
        origin=describe_origin([first]),
        notes=(
            "A severity found to be zero counts as a twentieth of the truth in error and bias.",
            "Errors of the faults' laws, which widen intervals, were chosen on fleets 100 to 111.",
            "The rig takes a pump apart before each recording, so films move by 12 % between "
            "points of a trend.",
            "Which piston or bore is damaged is not searched.",
        ),
        details={"cases": [asdict(case) for case in cases]},
    )


def _estimate_pump(seed: int, specimen: str, severities: Sequence[float]) -> list[_Case]:
    """Return the estimates of all recordings of a pump's trends."""
    pairs = list(trend_recordings(seed, specimen, severities=severities))
    healthy = [recording for recording, run in pairs if run.fault is None]
    assert healthy[0].condition is not None

    twin = Twin(load_pump("25scy14-1b"), healthy[0].condition)
    calibration = calibrate(
        twin,
        healthy[:-1],
        method=GaussNewton(),
        nuisances=Nuisances.typical(),
        explain_misfit=False,
        band=SeveritySettings().band,
    )

    cases: list[_Case] = []
    for kind, typical in TRENDS.items():
        trend_pairs = [pair for pair in pairs if type(pair[1].fault) is type(typical)]
        trend_pairs += [pair for pair in pairs if pair[0] is healthy[-1]]
        recordings = [recording for recording, _ in trend_pairs]

        start = FAULT_KINDS[kind]
        assert start is not None
        if isinstance(start, SwashPlateDefect):
            start = replace(start, length=START)
        trend = estimate_severity(calibration, recordings, start, healthy=healthy[:-1])

        for (recording, run), severity in zip(trend_pairs, trend.estimates, strict=True):
            for index, estimate in enumerate(severity.dimensions):
                # A healthy pump's recess has no length.
                if index > 0 and run.fault is None:
                    continue

                truth = 0.0
                if run.fault is not None:
                    truth = float(getattr(run.fault, estimate.dimension.name))
                cases.append(
                    _Case(
                        kind=kind,
                        dimension=estimate.dimension.name,
                        seed=seed,
                        specimen=specimen,
                        recording_id=recording.recording_id,
                        truth=truth,
                        estimate=estimate.value,
                        low=estimate.interval[0],
                        high=estimate.interval[1],
                        verdict=estimate.verdict,
                        detected=bool(severity.evidence > severity.threshold),
                        limit=severity.detection_limit if index == 0 else None,
                        wall_s=severity.wall_s,
                    )
                )

    return cases


def _trials(cases: Sequence[_Case], seeds: Sequence[int]) -> list[Trial]:
    trials = []
    for kind, dimension in dict.fromkeys((case.kind, case.dimension) for case in cases):
        dimension_cases = [
            case for case in cases if case.kind == kind and case.dimension == dimension
        ]
        for seed in seeds:
            values = _values([case for case in dimension_cases if case.seed == seed])
            trials.append(Trial({"fault": kind, "dimension": dimension}, seed, values))

    return trials


def _values(cases: Sequence[_Case]) -> dict[str, float]:
    """Return the metrics of estimates of one dimension."""
    faulty = [case for case in cases if case.truth > 0]
    healthy = [case for case in cases if case.truth == 0]

    error = np.array([case.error for case in faulty])
    values = {
        "error": float(np.median(np.abs(error))),
        "bias": float(error.mean()),
        "coverage": float(np.mean([case.low <= case.truth <= case.high for case in faulty])),
        "identified": float(np.mean([case.verdict == "identified" for case in faulty])),
        "wall_s": float(np.mean([case.wall_s for case in cases])),
    }

    # Only the first dimension, which carries the severity, has healthy cases.
    if healthy:
        typical = TRENDS[cases[0].kind].severity
        limits = [case.limit / typical for case in faulty if case.limit is not None]
        values |= {
            "detected": float(np.mean([case.detected for case in faulty])),
            "false_alarms": float(np.mean([case.detected for case in healthy])),
            "limit": float(np.median(limits)) if limits else math.nan,
            **_trend_metrics(faulty),
        }

    return values


def _trend_metrics(faulty: Sequence[_Case]) -> dict[str, float]:
    """Return rank correlation and error of a change along the trend of each pump."""
    ranks: list[float] = []
    changes: list[float] = []
    for pump in dict.fromkeys((case.seed, case.specimen) for case in faulty):
        trend = [case for case in faulty if (case.seed, case.specimen) == pump]
        trend.sort(key=lambda case: case.truth)
        truths = [case.truth for case in trend]
        estimates = [case.estimate for case in trend]

        # Two points, or equal estimates, have no rank correlation.
        if len(set(estimates)) > 1 and len(trend) > 2:
            ranks.append(float(scipy.stats.spearmanr(truths, estimates)[0]))
        changes += [later.error - earlier.error for earlier, later in pairwise(trend)]

    return {
        "rank": float(np.mean(ranks)) if ranks else math.nan,
        "change": float(np.median(np.abs(changes))) if changes else math.nan,
    }


def _answer(cases: Sequence[_Case]) -> list[str]:
    sentences = []
    for kind in dict.fromkeys(case.kind for case in cases):
        kind_cases = [case for case in cases if case.kind == kind]
        # The first dimension carries the severity.
        dimension = kind_cases[0].dimension
        values = _values([case for case in kind_cases if case.dimension == dimension])

        sentences.append(
            f"{kind.replace('_', ' ')}: {dimension} off by {math.expm1(values['error']):.0%} in "
            f"the median, {values['coverage']:.0%} of the 90 % intervals hold the truth, rank "
            f"correlation along a trend {values['rank']:.2f}, detected {values['detected']:.0%}, "
            f"healthy taken for faulty {values['false_alarms']:.0%}."
        )

    return sentences
