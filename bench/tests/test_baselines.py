"""Classifiers of scikit-learn on features distinguish tones, reproducibly for one seed."""

import numpy as np
import pytest

from swashtwin.learning import WindowSet, build_network, cut_windows, evaluate, fit
from swashtwin.recordings import Recording
from swashtwin_bench.rivals.baselines import BASELINES, UNSCALED, OnFeatures

CLASSES = ("normal", "piston", "valve_plate")


def tones(prefix: str, classes: tuple[str, ...] = CLASSES) -> WindowSet:
    """Return windows of three recordings per class, whose tone has a frequency for each class."""
    recordings = []
    for index, label in enumerate(classes):
        for number in range(3):
            name = f"{prefix} {label} {number}"
            # seeded by name, so that training and test recordings differ
            rng = np.random.default_rng(list(name.encode()))
            phase = 2 * np.pi * (0.05 + 0.06 * index) * np.arange(640) + rng.uniform(0, 6)
            signal = np.sin(phase) + 0.3 * rng.normal(size=640)
            recordings.append(Recording(signal[None], 1e3, name, label=label))

    return cut_windows(recordings, length=128)


@pytest.mark.parametrize("baseline", BASELINES)
@pytest.mark.parametrize("classes", [CLASSES, CLASSES[:2]])
def test_every_baseline_distinguishes_tones_of_new_recordings(
    baseline: type[OnFeatures], classes: tuple[str, ...]
) -> None:
    train = tones("train", classes)
    test = tones("test", classes)

    first, second = (
        fit(build_network(baseline.name, 1, len(classes)), train, settings=UNSCALED)
        for _ in range(2)
    )

    probability = first.predict_proba(test)
    np.testing.assert_allclose(probability.sum(axis=1), 1)
    np.testing.assert_array_equal(probability, second.predict_proba(test))
    assert evaluate(first, test).accuracy > 0.9
