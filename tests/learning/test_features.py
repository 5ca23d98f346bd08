"""Vibration features against values known in closed form, and the trees that learn from them."""

import numpy as np
import pytest
from scipy import stats
from sklearn.ensemble import ExtraTreesClassifier
from tree_models import fit_trees

from swashtwin.foundation import derive_seed
from swashtwin.learning import (
    WindowSet,
    band_energies,
    build_network,
    cut_windows,
    feature_names,
    feature_values,
)
from swashtwin.recordings import Recording
from swashtwin.signals import TIME_STATISTICS, time_statistics

RATE = 1000.0


def statistics_by_name(signal: np.ndarray) -> dict[str, np.ndarray]:
    return dict(zip(TIME_STATISTICS, time_statistics(signal).T, strict=True))


def test_the_statistics_of_a_sine_are_those_of_textbooks():
    turns = 8 * np.arange(4096) / 4096
    sine = 3 * np.sin(2 * np.pi * turns)
    value = {name: row[0] for name, row in statistics_by_name(sine[None]).items()}

    assert value["mean"] == pytest.approx(0, abs=1e-12)
    assert value["rms"] == pytest.approx(3 / np.sqrt(2))
    assert value["peak"] == pytest.approx(3)
    assert value["peak_to_peak"] == pytest.approx(6)
    assert value["kurtosis"] == pytest.approx(1.5)
    assert value["crest_factor"] == pytest.approx(np.sqrt(2))
    assert value["shape_factor"] == pytest.approx(np.pi / np.sqrt(8), rel=1e-4)
    assert value["impulse_factor"] == pytest.approx(np.pi / 2, rel=1e-4)


def test_skewness_and_kurtosis_are_those_of_scipy():
    signal = np.random.default_rng(0).gamma(2.0, size=(5, 400))
    value = statistics_by_name(signal)

    skewness = stats.skew(signal, axis=1)
    np.testing.assert_allclose(value["skewness"], skewness)
    kurtosis = stats.kurtosis(signal, axis=1, fisher=False)
    np.testing.assert_allclose(value["kurtosis"], kurtosis)


@pytest.mark.parametrize("samples", [255, 256, 1024])
def test_the_energies_of_all_bands_add_up_to_the_mean_square(samples):
    noise = np.random.default_rng(1).normal(size=(2000, samples))
    total = (10 ** band_energies(noise)).sum(axis=1)
    assert total.mean() == pytest.approx(1, abs=0.02)


def test_a_tone_fills_the_band_around_it_and_twice_the_amplitude_gives_four_times_the_energy():
    time = np.arange(1024) / RATE
    tone = np.sin(2 * np.pi * 100 * time)
    energies = band_energies(np.stack([tone, 2 * tone]))

    edges = np.geomspace(0.5, 512.5, 33) * RATE / 1024
    band = energies[0].argmax()
    assert edges[band] < 100 < edges[band + 1]

    rise = energies[1] - energies[0]
    np.testing.assert_allclose(rise, np.log10(4), atol=1e-6)


def test_the_envelope_spectrum_shows_the_modulation_that_the_spectrum_hides():
    time = np.arange(4096) / 4096.0
    modulation = 1 + 0.8 * np.sin(2 * np.pi * 20 * time)
    signal = modulation * np.sin(2 * np.pi * 1000 * time)

    names = feature_names(["acceleration"])
    (features,) = feature_values(signal[None, None])
    value = dict(zip(names, features, strict=True))

    edges = np.geomspace(0.5, 2048.5, 33)
    band = int(np.searchsorted(edges, 20) - 1)

    in_envelope = value[f"acceleration envelope spectrum band {band}"]
    in_spectrum = value[f"acceleration spectrum band {band}"]
    assert in_envelope > in_spectrum + 3
    assert value["acceleration envelope mean"] == pytest.approx(1, abs=0.01)
    assert value["acceleration envelope deviation"] == pytest.approx(0.8 / np.sqrt(2), abs=0.01)


def test_every_channel_has_its_features_under_its_name():
    names = feature_names(["sensor 0", "sensor 1"])
    features = feature_values(np.ones((3, 2, 64)))
    assert features.shape == (3, 2 * 82)
    assert len(set(names)) == 164
    second_names = [name for name in names if name.startswith("sensor 1 ")]
    assert len(second_names) == 82


def test_silence_has_finite_features():
    silence = np.zeros((2, 64))
    assert np.isfinite(time_statistics(silence)).all()
    assert np.isfinite(band_energies(silence)).all()


def tree_windows(seed: int = 0) -> WindowSet:
    draw = np.random.default_rng(seed)
    recordings = []
    for number in range(9):
        index = number % 3
        deviation = 1 + 0.2 * index
        recording = Recording(
            draw.normal(3, deviation, size=(2, 768)),
            1e3,
            f"{seed} {number}",
            label="abc"[index],
            channels=("x", "y"),
        )
        recordings.append(recording)

    return cut_windows(recordings, length=96)


def test_the_trees_give_the_probabilities_of_scikit_learn() -> None:
    train = tree_windows()
    test = tree_windows(1)
    seed = derive_seed(3, "extra trees") % 2**32
    peer = ExtraTreesClassifier(20, random_state=seed)
    peer.fit(feature_values(train.signal), train.target)

    probabilities = fit_trees(train, 20, seed=3).predict_proba(test)

    expected = peer.predict_proba(feature_values(test.signal))
    np.testing.assert_allclose(probabilities, expected, atol=1e-7)


@pytest.mark.parametrize("damage", ["child beyond the end", "child is its parent", "column"])
def test_nodes_with_an_invalid_child_or_column_are_refused(damage: str) -> None:
    weights = fit_trees(tree_windows(), 2).network.weights
    inner_node = int(np.flatnonzero(weights["column"] >= 0)[0])
    name, value = {
        "child beyond the end": ("left", 10**6),
        "child is its parent": ("left", inner_node),
        "column": ("column", 164),
    }[damage]

    changed = weights[name].copy()
    changed[inner_node] = value
    network = build_network("extra_trees", 2, 3, trees=2)

    with pytest.raises(ValueError, match="its trees"):
        network.loaded({**weights, name: changed})
