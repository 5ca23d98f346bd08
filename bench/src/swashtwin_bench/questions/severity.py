"""How well severities are found by inversion: error against the virtual rig's hidden truth."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise

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
"""Length of a recess from which the search starts; the rig's are 30 mm. Depths start at the paper's
0.6 mm.
"""
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
        """Logarithm of the estimate over the truth; an estimate near zero counts as a twentieth of
        the truth.
        """
        return math.log(max(self.estimate, 0.05 * self.truth) / self.truth)


@dataclass(frozen=True)
class SeverityStudySettings:
    """What trends are recorded."""

    severities: tuple[float, ...] = (0.3, 0.6, 1.0, 1.7, 3.0)
    """Over the rig's typical ones."""


def severity(work: Work, settings: SeverityStudySettings) -> StudyTable:
    """Table of errors by fault and dimension, on trends of the virtual rig's pumps.

    Each pump is calibrated on four healthy recordings at 10 MPa, with the usual nuisances, up to 1
    kHz; each recording of its trends, and a fifth healthy one, is then inverted on its own.

    Parameters
    ----------
    work : its seeds are fleets of the rig; one pump of each.
    """
    pumps = [(seed, name, settings.severities) for seed in work.seeds for name in PUMPS]
    cases = [case for pump in work.map("pumps", _of_pump, pumps) for case in pump]
    first = next(trend_recordings(work.seeds[0], PUMPS[0], severities=(), healthy=1, duration=0.1))[
        0
    ]
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


def _of_pump(seed: int, specimen: str, severities: Sequence[float]) -> list[_Case]:
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
        of_trend = [pair for pair in pairs if type(pair[1].fault) is type(typical)]
        of_trend += [pair for pair in pairs if pair[0] is healthy[-1]]
        start = FAULT_KINDS[kind]
        assert start is not None
        start = replace(start, length=START) if isinstance(start, SwashPlateDefect) else start
        trend = estimate_severity(
            calibration, [recording for recording, _ in of_trend], start, healthy=healthy[:-1]
        )
        for (recording, run), severity in zip(of_trend, trend.estimates, strict=True):
            cases += [
                _Case(
                    kind=kind,
                    dimension=estimate.dimension.name,
                    seed=seed,
                    specimen=specimen,
                    recording_id=recording.recording_id,
                    truth=0.0
                    if run.fault is None
                    else float(getattr(run.fault, estimate.dimension.name)),
                    estimate=estimate.value,
                    low=estimate.interval[0],
                    high=estimate.interval[1],
                    verdict=estimate.verdict,
                    detected=bool(severity.evidence > severity.threshold),
                    limit=severity.detection_limit if index == 0 else None,
                    wall_s=severity.wall_s,
                )
                for index, estimate in enumerate(severity.dimensions)
                if index == 0 or run.fault is not None  # a healthy pump's recess has no length
            ]
    return cases


def _trials(cases: Sequence[_Case], seeds: Sequence[int]) -> list[Trial]:
    keys = dict.fromkeys((case.kind, case.dimension) for case in cases)
    return [
        Trial(
            {"fault": kind, "dimension": dimension},
            seed,
            _values(
                [
                    case
                    for case in cases
                    if (case.kind, case.dimension, case.seed) == (kind, dimension, seed)
                ]
            ),
        )
        for kind, dimension in keys
        for seed in seeds
    ]


def _values(cases: Sequence[_Case]) -> dict[str, float]:
    faulty, healthy = (
        [case for case in cases if case.truth > 0],
        [case for case in cases if case.truth == 0],
    )
    error = np.array([case.error for case in faulty])
    values = {
        "error": float(np.median(np.abs(error))),
        "bias": float(error.mean()),
        "coverage": float(np.mean([case.low <= case.truth <= case.high for case in faulty])),
        "identified": float(np.mean([case.verdict == "identified" for case in faulty])),
        "wall_s": float(np.mean([case.wall_s for case in cases])),
    }
    if healthy:
        typical = TRENDS[cases[0].kind].severity
        limits = [case.limit / typical for case in faulty if case.limit is not None]
        values |= {
            "detected": float(np.mean([case.detected for case in faulty])),
            "false_alarms": float(np.mean([case.detected for case in healthy])),
            "limit": float(np.median(limits)) if limits else math.nan,
            **_along(faulty),
        }
    return values


def _along(faulty: Sequence[_Case]) -> dict[str, float]:
    """Rank correlation and error of a change, along the trend of each pump."""
    ranks, changes = [], []
    for pump in dict.fromkeys((case.seed, case.specimen) for case in faulty):
        along = sorted(
            (case for case in faulty if (case.seed, case.specimen) == pump),
            key=lambda case: case.truth,
        )
        truth, estimated = [case.truth for case in along], [case.estimate for case in along]
        if len(set(estimated)) > 1 and len(along) > 2:
            ranks.append(float(scipy.stats.spearmanr(truth, estimated)[0]))
        changes += [later.error - earlier.error for earlier, later in pairwise(along)]
    return {
        "rank": float(np.mean(ranks)) if ranks else math.nan,
        "change": float(np.median(np.abs(changes))) if changes else math.nan,
    }


def _answer(cases: Sequence[_Case]) -> list[str]:
    sentences = []
    for kind in dict.fromkeys(case.kind for case in cases):
        dimension = next(
            case.dimension for case in cases if case.kind == kind
        )  # the first carries the severity
        values = _values(
            [case for case in cases if (case.kind, case.dimension) == (kind, dimension)]
        )
        sentences.append(
            f"{kind.replace('_', ' ')}: {dimension} off by {math.expm1(values['error']):.0%} in "
            f"the median, {values['coverage']:.0%} of the 90 % intervals hold the truth, rank "
            f"correlation along a trend {values['rank']:.2f}, detected {values['detected']:.0%}, "
            f"healthy taken for faulty {values['false_alarms']:.0%}."
        )
    return sentences
