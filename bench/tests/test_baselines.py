"""Classifiers of scikit-learn on features tell tones apart, and the same ones again with the same
seed.
"""

import numpy as np
import pytest

from swashtwin.learning import WindowSet, build_network, cut_windows, evaluate, fit
from swashtwin.recordings import Recording
from swashtwin_bench.rivals.baselines import BASELINES, UNSCALED, OnFeatures

CLASSES = ("normal", "piston", "valve_plate")


def tones(tag: str, classes: tuple[str, ...] = CLASSES) -> WindowSet:
    recordings = []
    for index, label in enumerate(classes):
        for number in range(3):
            name = f"{tag} {label} {number}"
            draw = np.random.default_rng(list(name.encode()))
            phase = 2 * np.pi * (0.05 + 0.06 * index) * np.arange(640) + draw.uniform(0, 6)
            recordings.append(
                Recording(
                    (np.sin(phase) + 0.3 * draw.normal(size=640))[None], 1e3, name, label=label
                )
            )
    return cut_windows(recordings, length=128)


@pytest.mark.parametrize("baseline", BASELINES)
@pytest.mark.parametrize("classes", [CLASSES, CLASSES[:2]])
def test_every_baseline_tells_tones_of_new_recordings_apart(
    baseline: type[OnFeatures], classes: tuple[str, ...]
) -> None:
    train, test = tones("train", classes), tones("test", classes)
    first, second = (
        fit(build_network(baseline.name, 1, len(classes)), train, settings=UNSCALED)
        for _ in range(2)
    )
    probability = first.predict_proba(test)
    np.testing.assert_allclose(probability.sum(axis=1), 1)
    np.testing.assert_array_equal(probability, second.predict_proba(test))
    assert evaluate(first, test).accuracy > 0.9
