"""Noise in training: where it falls, how loud it is, and that a run with it repeats itself bit for bit."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch

from swashtwin.diagnosis import load_classifier, save_classifier
from swashtwin.errors import InputError
from swashtwin.networks import BiTCN, Network, SpectralBiTCN
from swashtwin.recording import Recording
from swashtwin.training import FittedClassifier, TrainingSettings, fit
from swashtwin.training.disturbance import RANGE, disturbed
from swashtwin.windows import WindowSet, cut_windows

SETTINGS = TrainingSettings(epochs=3, batch_size=8, noise_snr=0.0)


def tones(n_windows: int = 10) -> WindowSet:
    """Two channels, the second a hundred times as loud and off zero."""
    time = np.arange(64 * n_windows)
    recordings = [
        Recording(
            np.stack([np.sin(step * time), 100 * np.sin(step * time + 1) + 1e3]),
            1000.0,
            f"{label}-{number}",
            label=label,
            channels=("x", "y"),
        )
        for label, step in (("normal", 0.3), ("piston", 0.9))
        for number in range(2)
    ]
    return cut_windows(recordings, length=64)


def network() -> BiTCN:
    return BiTCN(2, 2, channels=(8, 8), kernel_size=3)


def on_levels() -> SpectralBiTCN:
    """A network that represents windows once, and learns their levels before the first epoch."""
    return SpectralBiTCN(2, 2, channels=(8,), frame=16, hop=8, n_bands=4, hidden=8)


def same(first: FittedClassifier, second: FittedClassifier) -> bool:
    weights = second.network.state_dict()
    return all(torch.equal(value, weights[name]) for name, value in first.network.state_dict().items())


def test_half_the_windows_get_noise_of_the_ratios_asked_for_on_every_channel():
    clean = tones(500)
    before = clean.signal.copy()
    which, noisy = disturbed(clean, 5.0, np.random.default_rng(0))
    assert 0.45 < len(which) / len(clean) < 0.55
    assert np.array_equal(noisy.start, clean.start[which])
    added = noisy.signal - clean.signal[which]
    ratio = 10 * np.log10(clean.signal[which].var(axis=-1) / added.var(axis=-1))
    assert 5.0 - 2 < ratio.min() < 7  # 64 readings tell a variance to a decibel or so
    assert 3 + RANGE < ratio.max() < 7 + RANGE
    assert np.abs(np.median(ratio, axis=0) - (5 + RANGE / 2)).max() < 1
    assert np.abs(ratio[:, 0] - ratio[:, 1]).max() < 6  # one ratio for both channels of a window
    assert np.array_equal(clean.signal, before)


@pytest.mark.parametrize("made", [network, on_levels])
def test_training_with_noise_repeats_itself_and_continues_bit_for_bit(made: Callable[[], Network], tmp_path):
    whole = fit(made(), tones(), settings=SETTINGS, seed=1)
    clean = replace(SETTINGS, noise_snr=None)
    assert same(whole, fit(made(), tones(), settings=SETTINGS, seed=1))
    assert not same(whole, fit(made(), tones(), settings=clean, seed=1))
    assert not same(whole, fit(made(), tones(), settings=replace(SETTINGS, noise_snr=10.0), seed=1))

    def interrupt(epoch) -> None:
        if epoch.number == 2:
            raise KeyboardInterrupt

    run = {"settings": SETTINGS, "seed": 1, "checkpoint": tmp_path / "run.safetensors"}
    with pytest.raises(KeyboardInterrupt):
        fit(made(), tones(), progress=interrupt, **run)
    with pytest.raises(InputError, match=r"its noise_snr is 0\.0, this run's is None"):
        fit(made(), tones(), resume=True, **{**run, "settings": clean})
    assert same(whole, fit(made(), tones(), resume=True, **run))


def test_a_network_that_learned_with_noise_stands_noise_better():
    windows = tones(40)
    _, test = disturbed(tones(41), -RANGE, np.random.default_rng(1))  # noise of -25 to 0 dB
    share = {
        ratio: (
            fit(network(), windows, settings=replace(SETTINGS, epochs=12, noise_snr=ratio), seed=2).predict(test)
            == test.label
        ).mean()
        for ratio in (None, -RANGE)
    }
    assert share[-RANGE] > share[None] + 0.02


def test_a_ratio_that_is_not_finite_is_refused():
    with pytest.raises(InputError, match=r"noise_snr \(nan\) must be a finite ratio in dB"):
        TrainingSettings(noise_snr=float("nan"))
    with pytest.raises(InputError, match="take another normalization"):
        TrainingSettings(noise_snr=0.0, normalization="recording")


def test_models_and_runs_from_before_there_was_noise_are_described_as_they_were(tmp_path):
    assert "noise_snr" not in TrainingSettings().described()
    assert SETTINGS.described()["noise_snr"] == 0.0
    for settings in (SETTINGS, replace(SETTINGS, noise_snr=None)):
        path = tmp_path / f"{settings.noise_snr}.safetensors"
        save_classifier(fit(network(), tones(), settings=settings), path)
        assert load_classifier(path).settings == settings
