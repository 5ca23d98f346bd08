"""Runs of a study as they would be, made without training anything."""

import math
from dataclasses import asdict
from typing import Any

import numpy as np

from swashtwin.foundation import MPa, random_stream, rpm
from swashtwin.learning import Epoch, Scores, WindowSet, cut_windows, evaluate
from swashtwin.pump import CLASSES, OperatingCondition
from swashtwin.recordings import Recording
from swashtwin_bench.results.result import build_score_row
from swashtwin_bench.results.runs import FORMAT, Task

ORIGIN = (
    "Recordings of the swashtwin virtual rig: a stand-in for a machine; "
    "no figure here says how well it works."
)


class Guesser:
    """Classifier that is right with a set probability."""

    classes = CLASSES
    manifest = ("trained on",)

    def __init__(self, skill: float, seed: int) -> None:
        self.skill = skill
        self.seed = seed

    def predict_proba(self, windows: WindowSet) -> np.ndarray:
        draw = random_stream(self.seed, "guess", self.skill)
        right = draw.random(len(windows)) < self.skill
        wrong = (windows.target + draw.integers(1, len(CLASSES), len(windows))) % len(CLASSES)
        return np.eye(len(CLASSES))[np.where(right, windows.target, wrong)] * 0.9 + 0.02


def windows(labels: tuple[str, ...] = CLASSES) -> WindowSet:
    condition = OperatingCondition(speed=rpm(860), discharge_pressure=MPa(15))
    recordings = []
    for label in labels:
        for number in range(3):
            signal = random_stream(number, label).normal(size=(1, 400))
            name = f"{label} {number}"
            recordings.append(Recording(signal, 1000.0, name, label=label, condition=condition))
    return cut_windows(recordings, length=80, classes=CLASSES)


def scored(
    skill: float,
    seed: int = 0,
    split: str | None = "L2",
    labels: tuple[str, ...] = CLASSES,
) -> Scores:
    return evaluate(Guesser(skill, seed), windows(labels), split=split)


def run(
    name: str,
    seed: int,
    skill: float,
    classifier: str = "spectral_bitcn",
    splits: tuple[str, ...] = ("L2", "L4"),
    study: str = "case1",
    **changes: Any,
) -> dict[str, Any]:
    """A run of the training set `name`, whose classifier is right with the probability `skill`."""
    factors = {"classifier": classifier, "training_set": name}
    is_network = classifier == "spectral_bitcn"
    settings = {
        "scenario": {"pressure_Pa": 15e6},
        "training_set": {},
        "model": {"limit": math.nan},
        "tests": {},
    }
    task = Task(study, seed, factors, settings, "data", "quick")
    scores = {split: scored(skill, seed, split) for split in splits}
    rows = [
        {
            "split": split,
            "repeat": 0,
            **build_score_row(result, result.recall["swash_plate"]),
        }
        for split, result in scores.items()
    ]

    history = [asdict(Epoch(number, 1.5 / number, 1 - 0.8 / number)) for number in range(1, 6)]

    return {
        "format": FORMAT,
        "key": task.key,
        **asdict(task),
        "rows": rows,
        "classes": list(CLASSES),
        "history": history if is_network else [],
        "values": {},
        "roles": {
            "train": ["trained on"],
            **{split: ["tested on"] for split in splits},
        },
        "sha256": {"train": "0" * 64},
        "cells": {
            "train": {"swash_plate @ 15 MPa": 6},
            "L2": {"swash_plate @ 15 MPa": 15},
        },
        "calibrations": [],
        "origin": ORIGIN,
        "command": "swashtwin bench study case1 --seeds 0,1",
        "wall_s": 1.0,
        "cpu_s": 1.0,
        "device": "cpu",
        "features": features(name) if is_network else None,
        **changes,
    }


def features(name: str) -> dict[str, list[Any]]:
    points = random_stream(0, name).normal(size=(40, 4)) + 3 * np.repeat(np.arange(5), 8)[:, None]
    splits = np.tile(np.repeat(["L2", "L4"], 4), 5)
    return {
        "values": points.tolist(),
        "label": np.repeat(CLASSES, 8).tolist(),
        "split": splits.tolist(),
    }
