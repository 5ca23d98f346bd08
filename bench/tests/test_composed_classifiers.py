"""An ensemble is the mean of its trainings, and a network of one sensor hears that one alone."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from swashtwin.foundation import derive_seed, stream
from swashtwin.learning import TrainingSettings, WindowSet, cut_windows
from swashtwin.recordings import Recording
from swashtwin_bench.rivals.composed import Ensemble, NetworkOnView
from swashtwin_bench.rivals.models import COMPOSED, MODELS, Model, train_model

NETWORK = Model("wdcnn", training=TrainingSettings(epochs=2, batch_size=8, normalization="set"))


def windows(seed: int = 0) -> WindowSet:
    """Two classes that only the second of two sensors tells."""
    rng = stream(seed, "test")
    recordings = [
        Recording(
            rng.standard_normal((2, 64 * 6)) * np.array([[1.0], [loud]]),
            1000.0,
            f"{label}-{seed}-{number}",
            label=label,
            channels=("first", "second"),
        )
        for label, loud in (("normal", 0.1), ("piston", 3.0))
        for number in range(3)
    ]
    return cut_windows(recordings, length=64)


def test_an_ensemble_is_the_mean_of_trainings_by_seeds_of_their_own() -> None:
    train, test = windows(), windows(1)
    whole = train_model(replace(NETWORK, trainings=3), train, seed=4, manifest=iter(["calibrated-on"]))
    assert isinstance(whole, Ensemble)
    seeds = (4, derive_seed(4, "training", 1), derive_seed(4, "training", 2))
    alone = [train_model(NETWORK, train, seed=seed).predict_proba(test) for seed in seeds]
    assert np.array_equal(whole.predict_proba(test), np.mean(alone, axis=0))
    assert not np.array_equal(alone[0], alone[1])
    assert whole.classes == train.classes
    assert whole.manifest == tuple(sorted({*train.recording_id.tolist(), "calibrated-on"}))
    assert all("calibrated-on" in member.manifest for member in whole.members)


def test_a_network_of_the_first_sensor_does_not_hear_the_second() -> None:
    train, test = windows(), windows(1)
    half_deaf = train_model(replace(NETWORK, sensors=1), train, seed=4)
    assert isinstance(half_deaf, NetworkOnView)
    changed = replace(test, signal=test.signal * np.array([1, -7], dtype=np.float32)[None, :, None])
    assert np.array_equal(half_deaf.predict_proba(test), half_deaf.predict_proba(changed))
    heard = train_model(NETWORK, train, seed=4)
    assert not np.array_equal(heard.predict_proba(test), heard.predict_proba(changed))
    assert half_deaf.classes == train.classes
    assert set(half_deaf.manifest) == set(train.recording_id.tolist())
    assert len(half_deaf.history) == 2
    assert np.array_equal(half_deaf.embed(test), half_deaf.embed(changed))
    several = train_model(replace(NETWORK, sensors=1, trainings=2), train, seed=4)
    assert np.array_equal(several.predict_proba(test), several.predict_proba(changed))


@pytest.mark.parametrize(("name", "settings"), COMPOSED.items())
def test_what_a_model_is_composed_of_stands_in_its_settings_and_only_there(name: str, settings: dict[str, Any]) -> None:
    usual = MODELS["quick"]["spectral_bitcn"].describe()
    assert not {"trainings", "sensors"} & set(usual)
    assert MODELS["quick"][name].describe() == usual | settings
