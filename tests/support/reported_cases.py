"""Cases of files that users of other readers have reported, and the signal that they hold."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swashtwin.foundation import DataError
from swashtwin.recordings import load_recording

RATE = 10_000.0
G = 9.80665
N_SAMPLES = 401
NOISE = np.random.default_rng(4).normal(size=N_SAMPLES).round(4)
TIME = np.arange(N_SAMPLES) / RATE
TIME_TEXTS = [f"{value:.4f}" for value in TIME]

# The same noise as a converter of 0.1 mg a count gives it.
COUNTS = np.round(NOISE * 1e4).astype(np.int16)

# The same noise in volts, of a sensor of 100 mV/g.
VOLTS = (NOISE * 0.1).round(6)

# Samples that a recorder marks as invalid, and what is read of them.
IS_MISSING = np.arange(N_SAMPLES) % 100 == 7
NOISE_WITH_GAPS = np.where(IS_MISSING, np.nan, NOISE)

FileWriter = Callable[[Path], Path]


def reads(title: str, write: FileWriter, expected: np.ndarray = NOISE, **options: Any) -> Any:
    """Return the case of a file that gives the `expected` samples in g with some options."""
    return pytest.param(write, options, expected, id=title)


def refuses(title: str, write: FileWriter, message: str, **options: Any) -> Any:
    """Return the case of a file whose refusal matches `message`."""
    return pytest.param(write, options, message, id=title)


READ_CASE = ("write", "options", "expected")
REFUSED_CASE = ("write", "options", "message")


def assert_reads(path: Path, options: dict[str, Any], expected: np.ndarray) -> None:
    recording = load_recording(path, **options)

    assert recording.sample_rate == pytest.approx(RATE, rel=1e-6)
    assert (recording.n_channels, recording.unit) == (1, "m/s^2")
    np.testing.assert_allclose(recording.signal[0], expected * G, rtol=1e-5, atol=1e-5)


def assert_refuses(path: Path, options: dict[str, Any], message: str) -> None:
    with pytest.raises(DataError, match=message):
        load_recording(path, **options)
