"""Fidelity of synthetic windows: each metric in a case with a known answer."""

from dataclasses import replace

import numpy as np
import pytest

from swashtwin.foundation import DataError, InputError, MPa, random_stream
from swashtwin.learning import WindowSet
from swashtwin.synthesis import (
    Fidelity,
    discriminative_score,
    measure_fidelity,
    spectral_distance,
)

CLASSES = ("normal", "piston")


def windows(
    seed: int,
    *,
    tone: float = 0.0,
    gain: float = 1.0,
    per_recording: int = 10,
    recordings: int = 6,
) -> WindowSet:
    """Noise of two classes, of which `piston` has a tone of frequency `tone`."""
    rng = random_stream(seed, "likeness")
    count = per_recording * recordings
    target = np.arange(count) // per_recording % 2
    noise = rng.normal(size=(count, 2, 256))
    phase = 6.28 * rng.random((count, 1, 1))
    tones = 2 * target[:, None, None] * np.sin(2 * np.pi * tone * np.arange(256) + phase)

    return WindowSet(
        signal=(gain * (noise + tones)).astype(np.float32),
        target=target.astype(np.int64),
        classes=CLASSES,
        recording_id=np.array([f"{seed}_{i // per_recording}" for i in range(count)]),
        specimen=np.array([f"p{seed}"] * count),
        discharge_pressure=np.full(count, MPa(10)),
        speed=np.full(count, 100.0),
        start=np.arange(count, dtype=np.int64) * 256,
        synthetic=np.zeros(count, dtype=bool),
        sample_rate=4000.0,
        channels=("x", "y"),
    )


def with_gains(measured: WindowSet, gains: np.ndarray) -> WindowSet:
    return replace(measured, signal=measured.signal * gains.astype(np.float32))


def synthetic_windows(seed: int, **arguments: float) -> WindowSet:
    """Windows that are marked synthetic, each a recording of its own."""
    synthetic = windows(seed, **arguments)  # type: ignore[arg-type]
    ids = np.array([f"made_{seed}_{i}" for i in range(len(synthetic))])
    return replace(synthetic, synthetic=np.ones(len(synthetic), dtype=bool), recording_id=ids)


def test_a_gain_of_decibels_in_every_line_is_a_distance_of_as_many_decibels() -> None:
    quiet = windows(0)
    louder = with_gains(quiet, np.array([[10**0.05], [10**0.15]]))  # 1 and 3 dB

    np.testing.assert_allclose(spectral_distance(quiet, louder), [1.0, 3.0], atol=1e-3)


def test_windows_have_no_distance_from_themselves() -> None:
    measured = windows(0)
    np.testing.assert_array_equal(spectral_distance(measured, measured), 0.0)


def test_windows_of_the_same_distribution_are_not_separated() -> None:
    score = discriminative_score(windows(0), synthetic_windows(1), seed=0)
    # by chance of 60 windows
    assert abs(score - 0.5) < 0.12


def test_windows_of_another_gain_are_separated() -> None:
    assert discriminative_score(windows(0), synthetic_windows(1, gain=3.0), seed=0) > 0.98


def test_a_recording_is_not_recognized_by_other_windows_of_the_same_recording() -> None:
    # Gains differ between recordings of ten windows, and between synthetic windows in the same way.
    # A split by windows would learn the recordings, and separate the two almost perfectly.
    recording_gains = np.exp(random_stream(0, "levels").normal(0, 1, 12))
    measured = with_gains(windows(0, recordings=12), np.repeat(recording_gains, 10)[:, None, None])
    window_gains = np.exp(random_stream(1, "levels").normal(0, 1, 120))
    synthetic = with_gains(synthetic_windows(1, recordings=12), window_gains[:, None, None])

    assert discriminative_score(measured, synthetic, seed=0) < 0.75


def test_a_score_needs_several_recordings() -> None:
    with pytest.raises(DataError, match="one recording"):
        discriminative_score(windows(0, recordings=1), synthetic_windows(1), seed=0)


def test_a_distance_needs_windows_on_both_sides() -> None:
    empty = synthetic_windows(1).subset(np.zeros(60, dtype=bool))
    with pytest.raises(DataError, match="60 measured and 0 synthetic windows"):
        spectral_distance(windows(0), empty)


def test_windows_of_different_channels_are_not_compared() -> None:
    measured = replace(windows(0), channels=("a", "b"))
    with pytest.raises(InputError, match="channels a, b against"):
        spectral_distance(measured, synthetic_windows(1))


@pytest.fixture(scope="module")
def report_on_a_loud_channel() -> Fidelity:
    """Fidelity of windows whose channel y is three times as loud as measured."""
    louder = with_gains(windows(1), np.array([[1.0], [3.0]]))
    return measure_fidelity(windows(0), louder, seed=0)


def test_the_report_names_the_features_that_separate_windows(
    report_on_a_loud_channel: Fidelity,
) -> None:
    report = report_on_a_loud_channel
    assert report.auroc is not None
    assert report.auroc > 0.98
    for feature in report.features:
        assert feature.name.startswith("y ")
        assert feature.auroc > 0.95
    # 20 log10(3)
    assert report.to_dict()["spectral_distance_db"]["y"] == pytest.approx(9.5, abs=0.5)


def test_the_report_counts_windows_and_recordings(report_on_a_loud_channel: Fidelity) -> None:
    report = report_on_a_loud_channel
    assert (report.n_measured, report.n_recordings, report.n_synthetic) == (60, 6, 60)
    assert "AUROC" in repr(report)


def test_one_recording_has_a_report_without_an_auroc() -> None:
    report = measure_fidelity(windows(0, recordings=1), synthetic_windows(1), seed=0)
    assert report.auroc is None
    assert len(report.features) == 5
