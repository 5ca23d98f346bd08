"""Windows changed in training: where and by how much, and that a run with it repeats itself bit for bit."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from swashtwin.diagnosis import load_classifier, save_classifier
from swashtwin.foundation import InputError
from swashtwin.learning import (
    RANGE,
    BiTCN,
    FittedClassifier,
    TrainingSettings,
    WindowSet,
    cut_windows,
    fit,
)
from swashtwin.learning.training.settings import at_other_speeds, transform_windows, with_gains, with_noise
from swashtwin.recordings import Recording

SETTINGS = TrainingSettings(epochs=3, batch_size=8, noise_snr=0.0, normalization="set")


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


def same(first: FittedClassifier, second: FittedClassifier) -> bool:
    weights = second.network.weights
    return all(np.array_equal(value, weights[name]) for name, value in first.network.weights.items())


def test_half_the_windows_get_noise_of_the_ratios_asked_for_on_every_channel():
    clean = tones(500)
    before = clean.signal.copy()
    which, noisy = transform_windows(clean, replace(SETTINGS, noise_snr=5.0), 0, 1)
    assert 0.45 < len(which) / len(clean) < 0.55
    assert np.array_equal(noisy.start, clean.start[which])
    added = noisy.signal - clean.signal[which]
    ratio = 10 * np.log10(clean.signal[which].var(axis=-1) / added.var(axis=-1))
    assert 5.0 - 2 < ratio.min() < 7  # 64 samples tell a variance to a decibel or so
    assert 3 + RANGE < ratio.max() < 7 + RANGE
    assert np.abs(np.median(ratio, axis=0) - (5 + RANGE / 2)).max() < 1
    assert np.abs(ratio[:, 0] - ratio[:, 1]).max() < 6  # one ratio for both channels of a window
    assert np.array_equal(clean.signal, before)


def test_each_channel_has_a_gain_of_its_own_within_the_largest():
    clean = tones(100).signal
    gained = with_gains(clean, 3.0, np.random.default_rng(0))
    gain = 20 * np.log10(gained.std(axis=-1) / clean.std(axis=-1))
    assert np.abs(gain).max() <= 3.0
    assert gain.min() < -2.8
    assert gain.max() > 2.8
    assert np.abs(np.corrcoef(gain.T)[0, 1]) < 0.2


def test_a_faster_shaft_moves_every_line_by_as_much():
    length, line = 4096, 200
    tone = np.sin(2 * np.pi * line / length * np.arange(length)).astype(np.float32)
    taper = np.hanning(length)
    moved = at_other_speeds(np.tile(tone, (200, 2, 1)), 0.05, np.random.default_rng(0))
    assert moved.dtype == np.float32
    shift = np.abs(np.fft.rfft(taper * moved)).argmax(axis=-1) / line - 1
    assert np.array_equal(shift[:, 0], shift[:, 1])  # sensors of one shaft
    assert np.abs(shift).max() < 0.05 + 0.005
    assert shift.min() < -0.04
    assert shift.max() > 0.04
    assert np.abs(moved).max() < 1.01
    still = at_other_speeds(np.tile(tone, (1, 1, 1)), 0.0, np.random.default_rng(0))
    assert np.allclose(still, tone, atol=1e-5)


def test_each_transform_changes_a_random_half_of_the_windows_and_no_other():
    clean = tones(500)
    before = clean.signal.copy()
    every = replace(SETTINGS, noise_snr=40.0, gain=1.0, stretch=0.01)
    which, changed = transform_windows(clean, every, 0, 1)
    assert 0.83 < len(which) / len(clean) < 0.92  # 7 of 8
    assert (changed.signal != clean.signal[which]).any(axis=(1, 2)).all()
    assert np.array_equal(clean.signal, before)
    assert len(transform_windows(clean, replace(SETTINGS, noise_snr=None), 0, 1)[0]) == 0
    alone = transform_windows(clean, SETTINGS, 0, 1)[0]
    assert set(alone.tolist()) <= set(which.tolist())  # what noise falls on does not hang on the others
    assert not np.array_equal(alone, transform_windows(clean, SETTINGS, 0, 2)[0])
    few = clean.subset(np.arange(2))
    assert {len(transform_windows(few, every, 0, epoch)[0]) for epoch in range(100)} == {0, 1, 2}


def test_a_network_that_learned_with_noise_stands_noise_better():
    windows, by_window = tones(20), replace(SETTINGS, normalization="window", epochs=12)
    test = tones(41)
    test = replace(test, signal=with_noise(test.signal, -RANGE, np.random.default_rng(1)))  # noise of -25 to 0 dB
    share = {
        ratio: (
            fit(network(), windows, settings=replace(by_window, noise_snr=ratio), seed=2).predict(test) == test.label
        ).mean()
        for ratio in (None, -RANGE)
    }
    assert share[-RANGE] > share[None] + 0.02


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"noise_snr": float("nan")}, r"noise_snr \(nan\) must be a finite ratio in dB"),
        ({"epochs": 0}, "epochs"),
        ({"batch_size": 1}, "batch_size"),
        ({"learning_rate": 0.0}, "learning_rate"),
        ({"gain": -1.0}, r"gain \(-1\) must be between 0 and 40 dB"),
        ({"gain": float("nan")}, r"gain \(nan\) must be between"),
        ({"stretch": 0.5}, r"stretch \(0\.5\) must be between 0 and 0\.2; 0\.02 is 2 % of the speed"),
        ({"stretch": float("nan")}, r"stretch \(nan\)"),
        ({"gain": 1.0, "normalization": "window"}, "gain would change nothing"),
    ],
)
def test_settings_that_make_no_sense_are_refused(change: dict[str, Any], message: str):
    with pytest.raises(InputError, match=message):
        TrainingSettings(**change)


def test_settings_without_transforms_are_written_without_them(tmp_path):
    assert not {"noise_snr", "gain", "stretch"} & set(TrainingSettings().to_dict())
    assert SETTINGS.to_dict()["noise_snr"] == 0.0
    for settings in (SETTINGS, replace(SETTINGS, noise_snr=None), replace(SETTINGS, gain=1.0, stretch=0.01)):
        path = tmp_path / f"{settings.noise_snr}-{settings.gain}.safetensors"
        save_classifier(fit(network(), tones(), settings=settings), path)
        assert load_classifier(path).settings == settings
