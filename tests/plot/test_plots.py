"""The public figures show what they are given, and refuse what cannot be drawn."""

import math

import numpy as np
import pytest

from swashtwin import plot
from swashtwin.foundation import InputError, MPa, rpm
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import Recording

AT = OperatingCondition(rpm(600), MPa(10))


def tone(order: float, name: str = "a", turns: int = 100) -> Recording:
    """A recording with one line, at an order of a shaft that turns at 10 Hz."""
    time = np.arange(turns * 400) / 4000
    noise = np.random.default_rng(0).normal(scale=1e-3, size=time.size)
    return Recording(
        (np.sin(2 * math.pi * 10 * order * time) + noise)[None], 4000.0, name, condition=AT
    )


def test_a_spectrum_of_a_recording_is_that_of_its_lines() -> None:
    figure = plot.spectrum(tone(7), pistons=7)
    curve = next(line for line in figure.axes[0].lines if len(line.get_xdata()) > 2)
    assert curve.get_xdata()[np.argmax(curve.get_ydata())] == pytest.approx(70, abs=0.2)
    assert [text.get_text() for text in figure.axes[0].texts][2:] == [
        "7x",
        "14x",
        "21x",
        "28x",
        "35x",
    ]


def test_a_confusion_matrix_counts_what_has_no_verdict_in_a_column_of_its_own() -> None:
    figure = plot.confusion(np.array([[3, 0, 1], [0, 4, 0]]), ("normal", "piston"))
    assert [label.get_text() for label in figure.axes[0].get_xticklabels()] == [
        "normal",
        "piston",
        "no verdict",
    ]
    assert [text.get_text() for text in figure.axes[0].texts] == ["75", "25", "100"]


def test_what_cannot_be_drawn_is_refused_in_one_line() -> None:
    with pytest.raises(InputError, match="does not fit 3 classes"):
        plot.confusion(np.eye(2), ("a", "b", "c"))
