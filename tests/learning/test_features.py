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


def test_the_statistics_of_a_sine_are_those_of_textbooks():
    sine = 3 * np.sin(2 * np.pi * 8 * np.arange(4096) / 4096)[None]
    value = dict(zip(TIME_STATISTICS, time_statistics(sine)[0], strict=True))

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
    value = dict(zip(TIME_STATISTICS, time_statistics(signal).T, strict=True))

    np.testing.assert_allclose(value["skewness"], stats.skew(signal, axis=1))
    np.testing.assert_allclose(value["kurtosis"], stats.kurtosis(signal, axis=1, fisher=False))


@pytest.mark.parametrize("samples", [255, 256, 1024])
def test_the_energies_of_all_bands_add_up_to_the_mean_square(samples):
    noise = np.random.default_rng(1).normal(size=(2000, samples))
    total = (10 ** band_energies(noise)).sum(axis=1)
    assert total.mean() == pytest.approx(1, abs=0.02)


def test_a_tone_fills_the_band_around_it_and_twice_the_amplitude_gives_four_times_the_energy():
    time = np.arange(1024) / RATE
    energies = [band_energies(gain * np.sin(2 * np.pi * 100 * time)[None])[0] for gain in (1, 2)]
    edges = np.geomspace(0.5, 512.5, 33) * RATE / 1024

    assert edges[energies[0].argmax()] < 100 < edges[energies[0].argmax() + 1]
    np.testing.assert_allclose(energies[1] - energies[0], np.log10(4), atol=1e-6)


def test_the_envelope_spectrum_shows_the_modulation_that_the_spectrum_hides():
    time = np.arange(4096) / 4096.0
    carrier = np.sin(2 * np.pi * 1000 * time) * (1 + 0.8 * np.sin(2 * np.pi * 20 * time))
    names = feature_names(["acceleration"])
    value = dict(zip(names, feature_values(carrier[None, None])[0], strict=True))
    edges = np.geomspace(0.5, 2048.5, 33)
    band = int(np.searchsorted(edges, 20) - 1)

    in_envelope = value[f"acceleration envelope spectrum band {band}"]
    in_spectrum = value[f"acceleration spectrum band {band}"]
    assert in_envelope > in_spectrum + 3
    assert value["acceleration envelope mean"] == pytest.approx(1, abs=0.01)
    assert value["acceleration envelope deviation"] == pytest.approx(0.8 / np.sqrt(2), abs=0.01)


def test_every_channel_has_its_features_under_its_name_and_silence_has_finite_ones():
    names = feature_names(["sensor 0", "sensor 1"])
    assert feature_values(np.ones((3, 2, 64))).shape == (3, 2 * 82)
    assert len(set(names)) == 164
    assert sum(name.startswith("sensor 1 ") for name in names) == 82
    assert np.isfinite(time_statistics(np.zeros((2, 64)))).all()
    assert np.isfinite(band_energies(np.zeros((2, 64)))).all()


def tree_windows(seed: int = 0) -> WindowSet:
    draw = np.random.default_rng(seed)
    recordings = []
    for number in range(9):
        signal = draw.normal(3, 1 + 0.2 * (number % 3), size=(2, 768))
        label = "abc"[number % 3]
        name = f"{seed} {number}"
        recordings.append(Recording(signal, 1e3, name, label=label, channels=("x", "y")))

    return cut_windows(recordings, length=96)


def test_the_trees_give_the_probabilities_of_scikit_learn() -> None:
    train = tree_windows()
    test = tree_windows(1)
    peer = ExtraTreesClassifier(20, random_state=derive_seed(3, "extra trees") % 2**32)
    peer.fit(feature_values(train.signal), train.target)
    answer = fit_trees(train, 20, seed=3).predict_proba(test)

    np.testing.assert_allclose(answer, peer.predict_proba(feature_values(test.signal)), atol=1e-7)


def test_nodes_with_an_invalid_child_or_column_are_refused() -> None:
    weights = fit_trees(tree_windows(), 2).network.weights
    inner = int(np.flatnonzero(weights["column"] >= 0)[0])
    for name, value in (("left", 10**6), ("left", inner), ("column", 164)):
        changed = {**weights, name: weights[name].copy()}
        changed[name][inner] = value

        with pytest.raises(ValueError, match="its trees"):
            build_network("extra_trees", 2, 3, trees=2).loaded(changed)
