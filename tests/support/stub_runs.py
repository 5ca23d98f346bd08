"""Runs of a study as they would be, made without training anything."""

import math
from collections.abc import Mapping

import numpy as np

from swashtwin.foundation import MPa, rpm, stream
from swashtwin.learning import Epoch, Scores, WindowSet, cut_windows, evaluate
from swashtwin.pump import CLASSES, OperatingCondition
from swashtwin.recordings import Recording
from swashtwin_bench.results.runs import Embedding, Outcome, Run, Task

ORIGIN = "Recordings of the swashtwin virtual rig: a stand-in for a machine; no figure here says how well it works."


class Guesser:
    """Classifier that is right with a set probability."""

    classes = CLASSES
    manifest = ("trained on",)

    def __init__(self, skill: float, seed: int) -> None:
        self.skill, self.seed = skill, seed

    def predict_proba(self, windows: WindowSet) -> np.ndarray:
        draw = stream(self.seed, "guess", self.skill)
        right = draw.random(len(windows)) < self.skill
        other = (windows.target + draw.integers(1, len(CLASSES), len(windows))) % len(CLASSES)
        return np.eye(len(CLASSES))[np.where(right, windows.target, other)] * 0.9 + 0.02


def windows(labels: tuple[str, ...] = CLASSES) -> WindowSet:
    condition = OperatingCondition(speed=rpm(860), discharge_pressure=MPa(15))
    recordings = [
        Recording(stream(i, label).normal(size=(1, 400)), 1000.0, f"{label} {i}", label=label, condition=condition)
        for label in labels
        for i in range(3)
    ]
    return cut_windows(recordings, length=80, classes=CLASSES)


def scored(skill: float, seed: int = 0, level: str | None = "L2", labels: tuple[str, ...] = CLASSES) -> Scores:
    return evaluate(Guesser(skill, seed), windows(labels), level=level)


def run(
    name: str, seed: int, skill: float, classifier: str = "spectral_bitcn", levels: tuple[str, ...] = ("L2", "L4")
) -> Run:
    factors = {"classifier": classifier, "training_set": name}
    scores = {level: scored(skill, seed, level) for level in levels}
    curve = tuple(Epoch(i, 1.5 / i, 1 - 0.8 / i) for i in range(1, 6)) if classifier == "spectral_bitcn" else ()
    settings = {"scenario": {"pressure_Pa": 15e6}, "training_set": {}, "model": {"limit": math.nan}, "tests": {}}
    return Run(
        task=Task("case1", "quick", seed, factors, settings, "data"),
        outcomes=tuple(
            Outcome({**factors, "level": level}, seed, score, score.recall["swash_plate"])
            for level, score in scores.items()
        ),
        history=curve,
        values={},
        roles={"train": ["trained on"], **{level: ["tested on"] for level in levels}},
        fingerprints={"train": "0" * 64},
        cells={"train": {"swash_plate @ 15 MPa": 6}, "L2": {"swash_plate @ 15 MPa": 15}},
        calibrations=(),
        origin=ORIGIN,
        wall_s=1.0,
        cpu_s=1.0,
        device="cpu",
        version="0.1",
        command="swashtwin bench case1 --seeds 0,1",
        embedding=embedding(factors) if classifier == "spectral_bitcn" else None,
    )


def embedding(factors: Mapping[str, str]) -> Embedding:
    label = np.repeat(CLASSES, 8)
    features = stream(0, factors["training_set"]).normal(size=(40, 4)) + 3 * np.repeat(np.arange(5), 8)[:, None]
    return Embedding(factors, features, label, np.tile(np.repeat(["L2", "L4"], 4), 5))
