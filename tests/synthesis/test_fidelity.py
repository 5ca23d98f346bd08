"""Fidelity of synthetic windows: each metric in a case with a known answer."""

from dataclasses import replace

import numpy as np
import pytest

from swashtwin.foundation import DataError, InputError, MPa, random_stream
from swashtwin.learning import WindowSet
from swashtwin.synthesis import (
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
    signal = rng.normal(size=(count, 2, 256))
    signal += (
        2
        * target[:, None, None]
        * np.sin(2 * np.pi * tone * np.arange(256) + 6.28 * rng.random((count, 1, 1)))
    )

    return WindowSet(
        signal=(gain * signal).astype(np.float32),
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


def synthetic_windows(seed: int, **how: float) -> WindowSet:
    """Windows that are marked synthetic, each a recording of its own."""
    synthetic = windows(seed, **how)  # type: ignore[arg-type]
    ids = np.array([f"made_{seed}_{i}" for i in range(len(synthetic))])
    return replace(synthetic, synthetic=np.ones(len(synthetic), dtype=bool), recording_id=ids)


def test_a_gain_of_a_decibel_in_every_line_is_a_distance_of_a_decibel() -> None:
    quiet = windows(0)
    louder = replace(
        quiet,
        signal=quiet.signal * np.array([[10**0.05], [10**0.15]], dtype=np.float32),
    )

    np.testing.assert_allclose(spectral_distance(quiet, louder), [1.0, 3.0], atol=1e-3)
    np.testing.assert_array_equal(spectral_distance(quiet, quiet), 0.0)


def test_windows_of_the_same_law_are_not_told_apart_and_a_fingerprint_is() -> None:
    assert abs(discriminative_score(windows(0), synthetic_windows(1), seed=0) - 0.5) < 0.12
    assert discriminative_score(windows(0), synthetic_windows(1, gain=3.0), seed=0) > 0.98


def test_a_recording_is_not_recognized_by_windows_of_its_own() -> None:
    """Measured windows whose recordings differ in level, and synthetic ones spread as the
    recordings are.
    """
    level = np.exp(random_stream(0, "levels").normal(0, 1, 12)).astype(np.float32)
    plain = windows(0, recordings=12)
    measured = replace(plain, signal=plain.signal * np.repeat(level, 10)[:, None, None])
    second = synthetic_windows(1, recordings=12)
    spread = np.exp(random_stream(1, "levels").normal(0, 1, 120)).astype(np.float32)
    synthetic = replace(second, signal=second.signal * spread[:, None, None])

    assert discriminative_score(measured, synthetic, seed=0) < 0.75


def test_what_cannot_be_compared_is_refused() -> None:
    measured = windows(0)
    with pytest.raises(DataError, match="one recording"):
        discriminative_score(windows(0, recordings=1), synthetic_windows(1), seed=0)
    with pytest.raises(DataError, match="60 measured and 0 synthetic windows"):
        spectral_distance(measured, synthetic_windows(1).subset(np.zeros(60, dtype=bool)))
    with pytest.raises(InputError, match="channels a, b against"):
        spectral_distance(replace(measured, channels=("a", "b")), synthetic_windows(1))


def test_the_report_names_the_features_that_give_windows_away() -> None:
    measured = windows(0)
    louder = replace(
        windows(1),
        signal=windows(1).signal * np.array([[1.0], [3.0]], dtype=np.float32),
    )
    report = measure_fidelity(measured, louder, seed=0)

    assert report.auroc is not None
    assert report.auroc > 0.98
    assert all(
        feature.name.startswith("y ") and feature.auroc > 0.95 for feature in report.features
    )
    assert (report.n_measured, report.n_recordings, report.n_synthetic) == (60, 6, 60)
    assert report.to_dict()["spectral_distance_db"]["y"] == pytest.approx(9.5, abs=0.5)
    assert "AUROC" in repr(report)


def test_one_recording_has_no_auroc_and_still_a_report() -> None:
    report = measure_fidelity(windows(0, recordings=1), synthetic_windows(1), seed=0)
    assert report.auroc is None
    assert len(report.features) == 5
