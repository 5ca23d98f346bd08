"""Problems of a few virtual pumps: how low held-out machines rank the scores of a further one.

    python benchmarks/virtual_problems.py --fleets 30

A fleet is six virtual pumps of one make. Each width of the pump prior is narrowed, to 0.3 or 0.6 of
itself, around a value that is drawn for the fleet; housing and sensors differ as much. A problem
trains on some of its pumps and tests on the others, by the heads that the ordinary training has: a
discriminant and trees on band powers, and trees on changes from healthy recordings. Each is
tempered by its answers to held-out training pumps.

The rank of a score is the share of the training recordings, each answered without its pump, whose
score is lower. One line of JSON for each number of training pumps and each kind of answer holds the
quantiles of the ranks over the tested recordings, and the shares that the answers were right. The
lines "all" are the table of `swashtwin.learning.training.virtual_problems`.
"""

import argparse
import json
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import scipy
import torch
from sklearn.ensemble import ExtraTreesClassifier

from swashtwin.foundation import SwashTwinError, random_stream
from swashtwin.learning.networks.feature_network import MIN_DEVIATION, fit_discriminant
from swashtwin.learning.recordings.recording_heads import MIN_PROBABILITY
from swashtwin.learning.recordings.recording_model import combine_votes
from swashtwin.learning.training.confidence import fit_pooling
from swashtwin.learning.training.virtual_problems import RATES
from swashtwin.physics import SensorPath
from swashtwin.pump import CLASSES, Interface, Interfaces, Pump
from swashtwin.signals import OrderBands
from swashtwin.synthesis import PumpPrior
from swashtwin.synthesis.pump_prior import Impacts, draw_modes, log_uniform, spread
from swashtwin.synthesis.virtual_pump import CELLS, VirtualPump

N_PUMPS = 6
N_REPEATS = 6
"""Recordings of each pump and class."""
NARROWINGS = (0.3, 0.6)
"""Widths of a fleet over those of the prior, of the fleets in turn."""
TRAINING_PUMPS = {
    2: ((0, 1), (2, 3), (4, 5)),
    3: ((0, 2, 4), (1, 3, 5)),
    4: ((0, 1, 2, 3),),
    5: ((0, 1, 2, 3, 4),),
}
"""Training pumps of the problems of a fleet, by their number."""
N_TREES = 60
ANSWERS = {
    "discriminant": ("discriminant",),
    "trees": ("trees",),
    "trees on changes": ("changes",),
    "alone": ("discriminant", "trees"),
    "with own healthy": ("discriminant", "trees", "changes"),
}
"""Heads of each kind of answer, in the order of `VOTE_WEIGHTS`."""

# Ranges of the prior that are narrowed on a logarithmic axis, and spreads that are scaled.
_RANGES = (
    "speed",
    "pressure",
    "viscosity",
    "wandering",
    "care",
    "following",
    "noise",
    "noise_scatter",
    "impulse",
    "pulse",
    "irregular",
    "foreign",
)
_SPREADS = ("interfaces", "supports", "clearances", "slippers", "timing", "unbalance")

# Spreads of resonances, damping and mounting from pump to pump, before they are narrowed.
_MODE_SPREAD = 0.3
_DAMPING_SPREAD = 0.5
_MOUNTING_SPREAD = 0.5


@dataclass(frozen=True)
class Make:
    """What the pumps of a fleet have in common."""

    prior: PumpPrior
    drawing: Pump
    program: int
    """See `TroubleSource.program`."""
    modes: SensorPath
    mounting: np.ndarray
    narrowing: float


@dataclass(eq=False)
class LikePump(VirtualPump):
    """A virtual pump whose housing and sensors resemble those of its make."""

    make: Make

    def __post_init__(self) -> None:
        super().__post_init__()
        self.program = self.make.program

    def _draw_rattle(self) -> tuple[Impacts, ...]:
        return ()

    def _path(self, hertz: np.ndarray) -> np.ndarray:
        rng = self.rng
        make = self.make
        count = len(make.modes.frequency)
        frequency = make.modes.frequency * spread(rng, make.narrowing * _MODE_SPREAD, count)
        damping = make.modes.damping_ratio * spread(rng, make.narrowing * _DAMPING_SPREAD, count)
        residue = np.array(make.modes.residue)
        residue = residue + make.narrowing * rng.normal(0, self.prior.mode_share, residue.shape)
        modes = SensorPath(
            gain=make.modes.gain,
            frequency=tuple(frequency.tolist()),
            damping_ratio=tuple(damping.tolist()),
            residue=tuple(map(tuple, residue.tolist())),
        )
        housing = modes.response(torch.as_tensor(hertz)).numpy()

        resonance = make.mounting * spread(rng, make.narrowing * _MOUNTING_SPREAD, self.sensors)
        resonance = resonance * spread(rng, 0.03 * self.care, (len(hertz), self.sensors))
        ratio = hertz[:, None] / resonance[..., None]
        gain = spread(rng, 0.05 * self.care, (len(hertz), self.sensors, 1))
        return np.asarray(housing * gain / (1 - ratio**2 + 0.1j * ratio))


def draw_make(rng: np.random.Generator, narrowing: float) -> Make:
    """Draw a make around whose values the widths of the prior are narrowed."""
    prior = PumpPrior()
    narrowed: dict[str, object] = {name: getattr(prior, name) * narrowing for name in _SPREADS}
    for name in _RANGES:
        low, high = np.log(getattr(prior, name))
        half_width = narrowing * (high - low) / 2
        center = np.clip(rng.uniform(low, high), low + half_width, high - half_width)
        limits = np.exp([center - half_width, center + half_width])
        narrowed[name] = tuple(limits.tolist())

    drawing = prior.pump
    values = np.array(drawing.interfaces.values()) * spread(rng, prior.interfaces, 6)
    interfaces = [Interface(float(values[row]), float(values[row + 1])) for row in (0, 2, 4)]
    n_sensors = 3
    return Make(
        prior=replace(prior, **narrowed),  # type: ignore[arg-type]
        drawing=replace(drawing, interfaces=Interfaces(*interfaces)),
        program=int(rng.integers(3)),
        modes=draw_modes(rng, prior.modes, n_sensors, prior.mode_frequency, prior.mode_share),
        mounting=np.array([log_uniform(rng, prior.mounting) for _ in range(n_sensors)]),
        narrowing=narrowing,
    )


def simulate_fleet(number: int) -> np.ndarray:
    """Return band powers (pump, recording, channel, band) of a fleet, the classes in order."""
    make = draw_make(
        random_stream(0, "virtual fleet", number), NARROWINGS[number % len(NARROWINGS)]
    )
    bands = OrderBands(make.drawing.rotating_group.piston_count)
    highest = int(bands.highest * bands.piston_count) + 1
    labels = tuple(label for label in CLASSES for _ in range(N_REPEATS))

    pumps: list[np.ndarray] = []
    attempt = 0
    while len(pumps) < N_PUMPS:
        rng = random_stream(0, "virtual fleet", number, "pump", attempt)
        attempt += 1
        try:
            pump = LikePump(make.prior, rng, make.drawing, highest, make)
            power = pump.spectra(labels)
        except SwashTwinError:
            continue  # the chamber pressures do not converge
        pumps.append(bands.log_powers(power, 1 / CELLS))
    return np.stack(pumps)


def without_gains(band_powers: np.ndarray) -> np.ndarray:
    """Return band powers less the gain of each channel."""
    return np.asarray(band_powers - band_powers.mean(axis=-1, keepdims=True))


def changes_of(band_powers: np.ndarray) -> np.ndarray:
    """Return the changes of recordings from the other healthy ones of their pump."""
    healthy = band_powers[:, :N_REPEATS]
    total = healthy.sum(axis=1, keepdims=True)
    reference = np.repeat(total / N_REPEATS, band_powers.shape[1], axis=1)
    reference[:, :N_REPEATS] = (total - healthy) / (N_REPEATS - 1)
    change = band_powers - reference
    return np.asarray(change - np.median(change, axis=-1, keepdims=True))


def answer_by_discriminant(
    training: np.ndarray, target: np.ndarray, tested: np.ndarray, seed: int
) -> np.ndarray:
    """Return log-probabilities of tested recordings by a linear discriminant."""
    mean = training.mean(axis=0)
    deviation = np.maximum(training.std(axis=0), MIN_DEVIATION)
    weights = fit_discriminant((training - mean) / deviation, target, len(CLASSES))
    scores = (tested - mean) / deviation @ weights["discriminant"].T
    return np.asarray(scipy.special.log_softmax(scores + weights["discriminant.bias"], axis=1))


def answer_by_trees(
    training: np.ndarray, target: np.ndarray, tested: np.ndarray, seed: int
) -> np.ndarray:
    """Return log-probabilities of tested recordings by extra trees."""
    trees = ExtraTreesClassifier(N_TREES, random_state=seed).fit(training, target)
    return np.asarray(np.log(np.maximum(trees.predict_proba(tested), MIN_PROBABILITY)))


def scores_of_problem(
    band_powers: np.ndarray, trained: tuple[int, ...], seed: int
) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
    """Yield each kind of answer with its scores (pump, recording, class), and which are tested."""
    n_pumps, n_recordings = band_powers.shape[:2]
    target = np.repeat(np.arange(len(CLASSES)), N_REPEATS)
    shapes = without_gains(band_powers).reshape(n_pumps, n_recordings, -1)
    changes = changes_of(band_powers).reshape(n_pumps, n_recordings, -1)
    heads = {
        "discriminant": (answer_by_discriminant, shapes),
        "trees": (answer_by_trees, shapes),
        "changes": (answer_by_trees, changes),
    }

    is_trained = np.isin(np.arange(n_pumps), trained)
    folds = [(is_trained & (np.arange(n_pumps) != pump), [pump]) for pump in trained]
    folds.append((is_trained, np.flatnonzero(~is_trained).tolist()))
    votes = {}
    temperatures = {}
    for name, (answer, values) in heads.items():
        vote = np.empty((n_pumps, n_recordings, len(CLASSES)))
        for trains, tested in folds:
            training = values[trains].reshape(trains.sum() * n_recordings, -1)
            tests = values[tested].reshape(len(tested) * n_recordings, -1)
            answered = answer(training, np.tile(target, trains.sum()), tests, seed)
            vote[tested] = answered.reshape(len(tested), n_recordings, -1)
        votes[name] = vote
        held_out = scipy.special.softmax(vote[is_trained].reshape(-1, 1, len(CLASSES)), axis=2)
        temperatures[name] = fit_pooling(list(held_out), np.tile(target, len(trained)))[0]

    for kind, names in ANSWERS.items():
        flat = [votes[name].reshape(-1, len(CLASSES)) for name in names]
        tempered = combine_votes(flat, np.array([temperatures[name] for name in names]))
        scores = -np.log(np.maximum(tempered, 1e-12))
        yield kind, scores.reshape(n_pumps, n_recordings, -1), ~is_trained


def compare_ranks(n_fleets: int) -> Iterator[dict[str, object]]:
    """Yield the quantiles of the ranks for each number of training pumps and kind of answer."""
    target = np.repeat(np.arange(len(CLASSES)), N_REPEATS)
    ranks: dict[tuple[int, str], list[np.ndarray]] = {}
    right: dict[tuple[int, str], list[tuple[float, float]]] = {}
    for number in range(n_fleets):
        band_powers = simulate_fleet(number)
        for n_trained, problems in TRAINING_PUMPS.items():
            for trained in problems:
                for kind, scores, is_tested in scores_of_problem(band_powers, trained, number):
                    true = np.take_along_axis(scores, target[None, :, None], axis=2)[..., 0]
                    is_lower = true[~is_tested].ravel() < true[is_tested].ravel()[:, None]
                    is_right = scores.argmin(axis=2) == target
                    shares = (is_right[~is_tested].mean(), is_right[is_tested].mean())
                    ranks.setdefault((n_trained, kind), []).append(is_lower.mean(axis=1))
                    right.setdefault((n_trained, kind), []).append(shares)

    for n_trained in TRAINING_PUMPS:
        for kind in ANSWERS:
            held_out, tested = np.mean(right[n_trained, kind], axis=0)
            yield {
                "training_pumps": n_trained,
                "answers": kind,
                "problems": len(ranks[n_trained, kind]),
                "right_held_out": round(float(held_out), 2),
                "right_tested": round(float(tested), 2),
                "ranks": _upper_quantiles(ranks[n_trained, kind]),
            }
        together = ranks[n_trained, "alone"] + ranks[n_trained, "with own healthy"]
        yield {"training_pumps": n_trained, "answers": "all", "ranks": _upper_quantiles(together)}


def _upper_quantiles(ranks: list[np.ndarray]) -> list[float]:
    """Return the shares of held-out recordings above the quantiles at the error rates."""
    quantiles = np.quantile(np.concatenate(ranks), 1 - np.array(RATES))
    return [round(float(1 - quantile), 3) for quantile in quantiles]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--fleets", type=int, default=30, help="number of virtual fleets")
    torch.set_num_threads(1)
    for row in compare_ranks(parser.parse_args().fleets):
        print(json.dumps(row), flush=True)
