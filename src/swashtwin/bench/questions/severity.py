"""How well severities are found by inversion: error against the virtual rig's hidden truth."""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise

import numpy as np
import scipy.stats
import torch
from joblib import Parallel, delayed

from swashtwin.bench.results.table import StudyTable, Trial, origin_of
from swashtwin.bench.rigs.measuring import Run
from swashtwin.bench.rigs.trending import TRENDS, trend_recordings
from swashtwin.calibration import GaussNewton, Nuisances, Severity, SeveritySettings, calibrate, estimate_severity
from swashtwin.foundation import VERSION, mm
from swashtwin.physics import Twin
from swashtwin.pump import FAULT_KINDS, Fault, SwashPlateDefect, load_pump
from swashtwin.recordings import Recording

METRICS = {
    "error": "median |ln(found / truth)|",
    "bias": "mean ln(found / truth)",
    "coverage": "share of 90 % intervals that hold the truth",
    "identified": "share identified",
    "detected": "share detected",
    "false_alarms": "share of healthy recordings detected",
    "rank": "rank correlation along one pump's trend",
    "change": "median |ln| error of a change along it",
    "limit": "least severity to be told, over the typical",
    "wall_s": "time per recording [s]",
}
START = mm(36)
"""Length of a recess from which the search starts; the rig's are 30 mm. Depths start at the paper's 0.6 mm."""
PUMPS = ("A",)
"""Pumps of each fleet."""


@dataclass(frozen=True)
class _Case:
    """One dimension found in one recording."""

    kind: str
    dimension: str
    seed: int
    specimen: str
    recording_id: str
    truth: float
    found: float
    low: float
    high: float
    verdict: str
    detected: bool
    limit: float | None
    per_unit: float
    unit: str
    wall_s: float

    @property
    def error(self) -> float:
        """Logarithm of found over truth; of a severity found to be zero that of the limit."""
        return math.log(max(self.found, 0.05 * self.truth) / self.truth)


def run_severity(
    seeds: Sequence[int],
    *,
    severities: Sequence[float] = (0.3, 0.6, 1.0, 1.7, 3.0),
    jobs: int = 1,
    progress: Callable[[int, int], None] | None = None,
    command: str = "",
) -> StudyTable:
    """Table of errors by fault and dimension, on trends of the virtual rig's pumps.

    Each pump is calibrated on four healthy recordings at 10 MPa, with the usual nuisances, up to 1 kHz; each recording
    of its trends, and a fifth healthy one, is then inverted on its own.

    Parameters
    ----------
    seeds : fleets of the rig; one pump of each.
    severities : over the rig's typical ones.
    jobs : processes that work side by side.
    progress : called with pumps done and in all.
    """
    started = time.perf_counter()
    pumps = [(seed, name) for seed in seeds for name in PUMPS]
    cases: list[_Case] = []
    parallel = Parallel(n_jobs=jobs, return_as="generator")
    for done, found in enumerate(parallel(delayed(_of_pump)(*one, severities) for one in pumps), 1):
        cases += found
        if progress is not None:
            progress(done, len(pumps))
    return StudyTable(
        study="severity",
        title="How severe is the fault? Severity by inversion against the hidden truth",
        metrics=METRICS,
        trials=tuple(_trials(cases, seeds)),
        answer=tuple(_answer(cases)),
        settings={"severities": list(severities), "pumps": list(PUMPS), **asdict(SeveritySettings())},
        origin=origin_of([next(trend_recordings(seeds[0], PUMPS[0], severities=(), healthy=1, duration=0.1))[0]]),
        wall_s=time.perf_counter() - started,
        version=VERSION,
        command=command,
        notes=(
            "A severity found to be zero counts as a twentieth of the truth in error and bias.",
            "Interval widths and thresholds were chosen on fleets 0 and 1; other seeds were not looked at before.",
            "The rig takes a pump apart before each recording, so films move by 12 % between points of a trend.",
            "Phases are dropped: which piston or bore is damaged is not searched.",
        ),
        details={"cases": [{**asdict(one), "detected": bool(one.detected)} for one in cases]},
    )


def _of_pump(seed: int, specimen: str, severities: Sequence[float]) -> list[_Case]:
    torch.set_num_threads(1)
    taken = list(trend_recordings(seed, specimen, severities=severities))
    healthy = [one for one, run in taken if run.fault is None]
    assert healthy[0].condition is not None
    twin = Twin(load_pump("25scy14-1b"), healthy[0].condition)
    known = calibrate(
        twin,
        healthy[:-1],
        method=GaussNewton(),
        nuisances=Nuisances.usual(),
        phases=False,
        band=SeveritySettings().band,
    )
    cases: list[_Case] = []
    for kind, typical in TRENDS.items():
        own = [pair for pair in taken if type(pair[1].fault) is type(typical)] + [
            pair for pair in taken if pair[0] is healthy[-1]
        ]
        trend = estimate_severity(known, [one for one, _ in own], _start(kind), healthy=healthy[:-1])
        for (recording, run), found in zip(own, trend.estimates, strict=True):
            cases += _cases(kind, seed, recording, run, found)
    return cases


def _start(kind: str) -> Fault:
    fault = FAULT_KINDS[kind]
    assert fault is not None
    return replace(fault, length=START) if isinstance(fault, SwashPlateDefect) else fault


def _cases(kind: str, seed: int, recording: Recording, run: Run, found: Severity) -> list[_Case]:
    cases = []
    for place, one in enumerate(found.dimensions):
        if place and run.fault is None:
            continue  # a healthy pump's recess has no length
        cases.append(
            _Case(
                kind=kind,
                dimension=one.dimension.name,
                seed=seed,
                specimen=str(recording.specimen),
                recording_id=recording.recording_id,
                truth=0.0 if run.fault is None else float(getattr(run.fault, one.dimension.name)),
                found=one.value,
                low=one.interval[0],
                high=one.interval[1],
                verdict=one.verdict,
                detected=found.evidence > found.threshold,
                limit=found.detection_limit if place == 0 else None,
                per_unit=one.dimension.per_unit,
                unit=one.dimension.unit,
                wall_s=found.wall_s,
            )
        )
    return cases


def _trials(cases: Sequence[_Case], seeds: Sequence[int]) -> list[Trial]:
    keys = dict.fromkeys((one.kind, one.dimension) for one in cases)
    trials = []
    for kind, dimension in keys:
        for seed in seeds:
            own = [one for one in cases if (one.kind, one.dimension, one.seed) == (kind, dimension, seed)]
            trials.append(Trial({"fault": kind, "dimension": dimension}, seed, _values(own)))
    return trials


def _values(cases: Sequence[_Case]) -> dict[str, float]:
    faulty, healthy = [one for one in cases if one.truth > 0], [one for one in cases if one.truth == 0]
    error = np.array([one.error for one in faulty])
    values = {
        "error": float(np.median(np.abs(error))),
        "bias": float(error.mean()),
        "coverage": float(np.mean([one.low <= one.truth <= one.high for one in faulty])),
        "identified": float(np.mean([one.verdict == "identified" for one in faulty])),
        "wall_s": float(np.mean([one.wall_s for one in cases])),
    }
    if healthy:
        typical = TRENDS[cases[0].kind].severity
        limits = [one.limit / typical for one in faulty if one.limit is not None]
        values |= {
            "detected": float(np.mean([one.detected for one in faulty])),
            "false_alarms": float(np.mean([one.detected for one in healthy])),
            "limit": float(np.median(limits)) if limits else math.nan,
            **_along(faulty),
        }
    return values


def _along(faulty: Sequence[_Case]) -> dict[str, float]:
    """Rank correlation and error of a change, along the trend of each pump."""
    ranks, changes = [], []
    for pump in dict.fromkeys((one.seed, one.specimen) for one in faulty):
        own = sorted((one for one in faulty if (one.seed, one.specimen) == pump), key=lambda one: one.truth)
        truth, found = [one.truth for one in own], [one.found for one in own]
        if len(set(found)) > 1 and len(own) > 2:
            ranks.append(float(scipy.stats.spearmanr(truth, found)[0]))
        changes += [later.error - earlier.error for earlier, later in pairwise(own)]
    return {
        "rank": float(np.mean(ranks)) if ranks else math.nan,
        "change": float(np.median(np.abs(changes))) if changes else math.nan,
    }


def _answer(cases: Sequence[_Case]) -> list[str]:
    told = []
    for kind in dict.fromkeys(one.kind for one in cases):
        own = [one for one in cases if one.kind == kind and one.dimension == _severity_of(cases, kind)]
        values = _values(own)
        told.append(
            f"{kind.replace('_', ' ')}: {_severity_of(cases, kind)} off by {math.expm1(values['error']):.0%} in the "
            f"median, {values['coverage']:.0%} of the 90 % intervals hold the truth, rank correlation along a trend "
            f"{values['rank']:.2f}, detected {values['detected']:.0%}, healthy taken for faulty "
            f"{values['false_alarms']:.0%}."
        )
    return told


def _severity_of(cases: Sequence[_Case], kind: str) -> str:
    """Name of the dimension that carries the severity of `kind`."""
    return next(one.dimension for one in cases if one.kind == kind)
