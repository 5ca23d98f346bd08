"""Which parameters a calibration moves where a pump is faulty: the map from parameters to faults, on the virtual rig.

The paper leaves it to later work. A twin without a fault takes a faulty pump's lines up as far as it can, so what moves
is partly the fault's trace and partly an artifact: a value stands in for physics that the twin lacks.
"""

import math
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np
import torch
from jaxtyping import Float
from joblib import Parallel, delayed
from sklearn.metrics import recall_score
from sklearn.neighbors import NearestCentroid
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from swashtwin.bench.results.table import StudyTable, Trial, origin_of
from swashtwin.bench.rigs.trending import TRENDS, trend_recordings
from swashtwin.calibration import QUANTILE, Calibration, GaussNewton, Nuisances, SeveritySettings, calibrate
from swashtwin.foundation import VERSION
from swashtwin.physics import Twin
from swashtwin.pump import load_pump
from swashtwin.recordings import Recording

METRICS = {
    "move": "ln(value / healthy value)",
    "width": "half of its 90 % interval",
    "significant": "share whose interval excludes 0",
    "recall": "recall of the nearest pattern",
}
PUMPS = ("A", "B")
"""Pumps of each fleet."""
SEVERITIES = (0.8, 1.0, 1.25)
"""Severities over the rig's typical ones."""
HEALTHY = 6
"""Healthy recordings of each pump; the first half calibrates it, the others are a class of their own."""
MODELS = ("healthy", "fault")
"""Twins that are calibrated: one without a fault, and one with the fault's typical dimensions."""


@dataclass(frozen=True)
class _Move:
    """How far one recording's calibration lies from its pump's healthy one."""

    kind: str
    model: str
    seed: int
    specimen: str
    parameters: tuple[str, ...]
    move: tuple[float, ...]
    deviation: tuple[float, ...]
    misfit: float

    @property
    def pump(self) -> str:
        """Name of the pump among all fleets."""
        return f"{self.seed}{self.specimen}"

    @property
    def label(self) -> str:
        """Class of its kind."""
        return "normal" if self.kind == "normal" else TRENDS[self.kind].label


def run_fault_map(
    seeds: Sequence[int],
    *,
    jobs: int = 1,
    progress: Callable[[int, int], None] | None = None,
    command: str = "",
) -> StudyTable:
    """Table of what moves, by kind of fault, model and parameter, and how well the moves tell classes apart.

    Each pump is calibrated on its healthy recordings, and each other recording on its own, up to 1 kHz at 10 MPa with
    the usual nuisances. Patterns are the mean moves of each class over all other pumps; the nearest one, in standard
    deviations over those pumps, names the class of a pump's recordings.

    Parameters
    ----------
    seeds : fleets of the rig; two pumps of each.
    jobs : processes that work side by side.
    progress : called with pumps done and in all.
    """
    started = time.perf_counter()
    pumps = [(seed, name) for seed in seeds for name in PUMPS]
    moves: list[_Move] = []
    parallel = Parallel(n_jobs=jobs, return_as="generator")
    for done, found in enumerate(parallel(delayed(_of_pump)(*one) for one in pumps), 1):
        moves += found
        if progress is not None:
            progress(done, len(pumps))
    sound = [one for one in moves if one.model == "healthy"]
    named = _nearest(sound)
    return StudyTable(
        study="fault-map",
        title="Which parameters move with which fault?",
        metrics=METRICS,
        trials=(*_move_trials(moves), *_recall_trials(sound, named)),
        answer=tuple(_answer(sound, named)),
        settings={"severities": list(SEVERITIES), "pumps": list(PUMPS), "healthy": HEALTHY},
        origin=origin_of([next(trend_recordings(seeds[0], PUMPS[0], severities=(), healthy=1, duration=0.1))[0]]),
        wall_s=time.perf_counter() - started,
        version=VERSION,
        command=command,
        notes=(
            "A healthy model has no fault to explain a faulty pump's lines: its values take up what they can. Such a "
            "move is a trace of the fault, but says nothing of a film.",
            "Where the right fault is in the model and a value moves still, the fault's law or its dimensions are off.",
            "The rig takes a pump apart before each recording: normal rows show what that alone moves.",
            "Nearest patterns were taken on other pumps than those they name; pumps of one fleet are alike.",
        ),
        details={"moves": [asdict(one) for one in moves]},
    )


def _of_pump(seed: int, specimen: str) -> list[_Move]:
    torch.set_num_threads(1)
    taken = list(trend_recordings(seed, specimen, severities=SEVERITIES, healthy=HEALTHY))
    condition = taken[0][0].condition
    assert condition is not None
    twin = Twin(load_pump("25scy14-1b"), condition)
    sound = [one for one, run in taken if run.fault is None]
    known = _calibrated(twin, sound[: HEALTHY // 2])
    moves = []
    for recording, run in taken[HEALTHY // 2 :]:
        kinds = [name for name, one in TRENDS.items() if type(one) is type(run.fault)]
        kind = kinds[0] if kinds else "normal"
        for model in MODELS if kinds else MODELS[:1]:
            own = twin if model == "healthy" else twin.with_fault(TRENDS[kind])
            found = _calibrated(own, [replace(recording, label=own.label)])
            moves.append(_moved(known, found, kind, model, seed, specimen))
    return moves


def _calibrated(twin: Twin, recordings: Sequence[Recording]) -> Calibration:
    nuisances = Nuisances.usual(excitation=0.0)
    method = GaussNewton(starts=2)
    band = SeveritySettings().band
    return calibrate(twin, recordings, method=method, nuisances=nuisances, phases=False, band=band)


def _moved(known: Calibration, found: Calibration, kind: str, model: str, seed: int, specimen: str) -> _Move:
    variance = np.diag(found.posterior.covariance) + np.diag(known.posterior.covariance)
    spectra = found.fits[0].spectra
    miss = np.linalg.norm(spectra.measured - spectra.calibrated) / np.linalg.norm(spectra.measured)
    return _Move(
        kind=kind,
        model=model,
        seed=seed,
        specimen=specimen,
        parameters=found.posterior.unknowns.names,
        move=tuple((found.posterior.point - known.posterior.point).tolist()),
        deviation=tuple(np.sqrt(variance).tolist()),
        misfit=float(miss),
    )


def _move_trials(moves: Sequence[_Move]) -> Iterable[Trial]:
    for kind, model in dict.fromkeys((one.kind, one.model) for one in moves):
        own = [one for one in moves if (one.kind, one.model) == (kind, model)]
        for place, name in enumerate(own[0].parameters):
            for seed in sorted({one.seed for one in own}):
                move, deviation = np.array([(o.move[place], o.deviation[place]) for o in own if o.seed == seed]).T
                yield Trial(
                    {"fault": kind, "model": model, "parameter": name},
                    seed,
                    {
                        "move": float(move.mean()),
                        "width": float(QUANTILE * deviation.mean()),
                        "significant": float(np.mean(np.abs(move) > QUANTILE * deviation)),
                    },
                )


def _nearest(moves: Sequence[_Move]) -> list[str]:
    """Class of each recording by the nearest pattern of the other pumps."""
    pattern = np.array([_pattern(one) for one in moves])
    labels, pumps = np.array([one.label for one in moves]), np.array([one.pump for one in moves])
    named = np.empty(len(moves), dtype=object)
    for pump in np.unique(pumps):
        own = pumps == pump
        rule = make_pipeline(StandardScaler(), NearestCentroid())
        named[own] = rule.fit(pattern[~own], labels[~own]).predict(pattern[own])
    return [str(one) for one in named]


def _pattern(one: _Move) -> Float[np.ndarray, " feature"]:
    return np.array([*one.move, math.log(one.misfit)])


def _recall_trials(moves: Sequence[_Move], named: Sequence[str]) -> Iterable[Trial]:
    for kind in dict.fromkeys(one.kind for one in moves):
        for seed in sorted({one.seed for one in moves}):
            hits = [
                name == one.label
                for one, name in zip(moves, named, strict=True)
                if (one.kind, one.seed) == (kind, seed)
            ]
            yield Trial({"fault": kind, "model": "healthy", "parameter": "all"}, seed, {"recall": float(np.mean(hits))})


def _answer(moves: Sequence[_Move], named: Sequence[str]) -> Iterable[str]:
    labels = [one.label for one in moves]
    recall = recall_score(labels, list(named), average="macro")
    yield (
        f"The nearest pattern of the moves names the class of held-out pumps' recordings with a macro recall of "
        f"{recall:.2f}; guessing gives {1 / len(set(labels)):.2f}."
    )
    for kind in dict.fromkeys(one.kind for one in moves):
        own = [one for one in moves if one.kind == kind]
        move, deviation = (np.array([getattr(one, name) for one in own]) for name in ("move", "deviation"))
        share = np.mean(np.abs(move) > QUANTILE * deviation, axis=0)
        told = [
            f"{name} x{math.exp(move[:, place].mean()):.2g}"
            for place, name in enumerate(own[0].parameters)
            if share[place] >= 0.5
        ]
        what = ", ".join(told) or "nothing moves beyond its interval in half of the recordings"
        yield f"{kind.replace('_', ' ')} under a healthy model: {what}."
