"""Which parameters a calibration moves where a pump is faulty: the map from parameters to faults, on the virtual rig.

The paper leaves it to later work. A twin without a fault takes a faulty pump's lines up as far as it can, so what moves
is partly the fault's trace and partly an artifact: a value stands in for physics that the twin lacks.
"""

import math
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass

import numpy as np
import torch
from jaxtyping import Float
from joblib import delayed
from sklearn.metrics import recall_score
from sklearn.neighbors import NearestCentroid
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from swashtwin.bench.results.table import StudyTable, Trial, origin_of
from swashtwin.bench.rigs.trending import TRENDS, trend_recordings
from swashtwin.calibration import QUANTILE, Calibration, GaussNewton, Nuisances, SeveritySettings, calibrate
from swashtwin.foundation import VERSION, parallel
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
METHOD = GaussNewton(starts=2)
"""How each twin is calibrated."""
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
    running = parallel(jobs, return_as="generator")
    for count, pump_moves in enumerate(running(delayed(_of_pump)(*pump) for pump in pumps), 1):
        moves += pump_moves
        if progress is not None:
            progress(count, len(pumps))
    sound = [move for move in moves if move.model == "healthy"]
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
        details={"moves": [asdict(move) for move in moves]},
    )


def _of_pump(seed: int, specimen: str) -> list[_Move]:
    torch.set_num_threads(1)
    pairs = list(trend_recordings(seed, specimen, severities=SEVERITIES, healthy=HEALTHY))
    condition = pairs[0][0].condition
    assert condition is not None
    twin = Twin(load_pump("25scy14-1b"), condition)
    sound = [recording for recording, run in pairs if run.fault is None]
    healthy_calibration = _calibrate(twin, sound[: HEALTHY // 2])
    moves = []
    for recording, run in pairs[HEALTHY // 2 :]:
        kinds = [name for name, fault in TRENDS.items() if type(fault) is type(run.fault)]
        kind = kinds[0] if kinds else "normal"
        for model in MODELS if kinds else MODELS[:1]:
            start = twin if model == "healthy" else twin.with_fault(TRENDS[kind])
            calibration = _calibrate(start, [recording.replace(label=start.label)])
            moves.append(_move_of(healthy_calibration, calibration, kind, model, seed, specimen))
    return moves


def _calibrate(twin: Twin, recordings: Sequence[Recording]) -> Calibration:
    nuisances = Nuisances.usual(excitation=0.0)
    band = SeveritySettings().band
    return calibrate(
        twin, recordings, method=METHOD, nuisances=nuisances, phases=False, explain_misfit=False, band=band
    )


def _move_of(
    healthy_calibration: Calibration, calibration: Calibration, kind: str, model: str, seed: int, specimen: str
) -> _Move:
    variance = np.diag(calibration.posterior.covariance) + np.diag(healthy_calibration.posterior.covariance)
    spectra = calibration.fits[0].spectra
    miss = np.linalg.norm(spectra.measured - spectra.calibrated) / np.linalg.norm(spectra.measured)
    return _Move(
        kind=kind,
        model=model,
        seed=seed,
        specimen=specimen,
        parameters=calibration.posterior.unknowns.names,
        move=tuple((calibration.posterior.point - healthy_calibration.posterior.point).tolist()),
        deviation=tuple(np.sqrt(variance).tolist()),
        misfit=float(miss),
    )


def _move_trials(moves: Sequence[_Move]) -> Iterable[Trial]:
    for kind, model in dict.fromkeys((move.kind, move.model) for move in moves):
        matching = [move for move in moves if (move.kind, move.model) == (kind, model)]
        for index, name in enumerate(matching[0].parameters):
            for seed in sorted({move.seed for move in matching}):
                move, deviation = np.array([(o.move[index], o.deviation[index]) for o in matching if o.seed == seed]).T
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
    pattern = np.array([_pattern(move) for move in moves])
    labels, pumps = np.array([move.label for move in moves]), np.array([move.pump for move in moves])
    named = np.empty(len(moves), dtype=object)
    for pump in np.unique(pumps):
        of_pump = pumps == pump
        rule = make_pipeline(StandardScaler(), NearestCentroid())
        named[of_pump] = rule.fit(pattern[~of_pump], labels[~of_pump]).predict(pattern[of_pump])
    return [str(name) for name in named]


def _pattern(move: _Move) -> Float[np.ndarray, " feature"]:
    return np.array([*move.move, math.log(move.misfit)])


def _recall_trials(moves: Sequence[_Move], named: Sequence[str]) -> Iterable[Trial]:
    for kind in dict.fromkeys(move.kind for move in moves):
        for seed in sorted({move.seed for move in moves}):
            hits = [
                name == move.label
                for move, name in zip(moves, named, strict=True)
                if (move.kind, move.seed) == (kind, seed)
            ]
            yield Trial({"fault": kind, "model": "healthy", "parameter": "all"}, seed, {"recall": float(np.mean(hits))})


def _answer(moves: Sequence[_Move], named: Sequence[str]) -> Iterable[str]:
    labels = [move.label for move in moves]
    recall = recall_score(labels, list(named), average="macro")
    yield (
        f"The nearest pattern of the moves names the class of held-out pumps' recordings with a macro recall of "
        f"{recall:.2f}; guessing gives {1 / len(set(labels)):.2f}."
    )
    for kind in dict.fromkeys(move.kind for move in moves):
        matching = [move for move in moves if move.kind == kind]
        move, deviation = (np.array([getattr(move, name) for move in matching]) for name in ("move", "deviation"))
        share = np.mean(np.abs(move) > QUANTILE * deviation, axis=0)
        sentences = [
            f"{name} x{math.exp(move[:, index].mean()):.2g}"
            for index, name in enumerate(matching[0].parameters)
            if share[index] >= 0.5
        ]
        what = ", ".join(sentences) or "nothing moves beyond its interval in half of the recordings"
        yield f"{kind.replace('_', ' ')} under a healthy model: {what}."
