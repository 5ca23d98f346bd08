"""Judgments of recordings for tests of the history."""

import hashlib
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np

from swashtwin.monitoring.history.schema import Judgment, Rejection
from swashtwin.recordings import Recording

START = datetime(2026, 3, 1, 6, tzinfo=UTC)
"""Time of the first recording."""


def judgment(number: int, **changes: Any) -> Judgment:
    """Judgment of recording `number`: one each hour."""
    time = START + timedelta(hours=number)
    facts: dict[str, Any] = {
        "content": hashlib.sha256(str(number).encode()).hexdigest(),
        "time": time,
        "received": time + timedelta(seconds=2),
        "source": "folder",
        "file": f"{number}.wav",
        "channels": ["x", "y"],
        "unit": "m/s^2",
        "sample_rate": 1000.0,
        "duration": 0.1,
        "state": "normal",
        "point": "1500 rpm, 15 MPa",
    }

    return Judgment(**{**facts, **changes})


def waveform(number: int) -> Recording:
    """Samples of recording `number`."""
    signal = np.random.default_rng(number).standard_normal((2, 100)).astype(np.float32)
    return Recording(signal, 1000.0, str(number), channels=("x", "y"))


def rejection(file: str, content: str, **changes: Any) -> Rejection:
    """Rejection of a broken file."""
    facts: dict[str, Any] = {
        "received": START,
        "source": "folder",
        "machine": "",
        "reason": "broken",
    }
    facts |= {"file": file, "content": content, "detail": "no header"}

    return Rejection(**{**facts, **changes})
