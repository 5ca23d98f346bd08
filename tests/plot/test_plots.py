"""The public figures show what they are given, and refuse what cannot be drawn."""

import math

import numpy as np
import pytest
from matplotlib.figure import Figure

from swashtwin import plot
from swashtwin.foundation import InputError, MPa, mm, rpm
from swashtwin.physics import Twin
from swashtwin.pump import OperatingCondition, SwashPlateDefect
from swashtwin.recordings import Recording

AT = OperatingCondition(rpm(600), MPa(10))


def tone(order: float, name: str = "a", turns: int = 100) -> Recording:
    """A recording with one line, at an order of a shaft that turns at 10 Hz."""
    time = np.arange(turns * 400) / 4000
    noise = np.random.default_rng(0).normal(scale=1e-3, size=time.size)
    return Recording((np.sin(2 * math.pi * 10 * order * time) + noise)[None], 4000.0, name, condition=AT)


def test_a_waveform_shows_three_turns_from_where_it_is_asked_to() -> None:
    figure = plot.waveform(tone(7), start=1.0)
    line = figure.axes[0].lines[-1]
    np.testing.assert_allclose((line.get_xdata()[0], line.get_xdata()[-1]), (1.0, 1.3), atol=1e-3)
    np.testing.assert_array_equal(line.get_ydata(), tone(7).signal[0, 4000:5200])


def test_a_spectrum_of_a_recording_is_that_of_its_lines() -> None:
    figure = plot.spectrum(tone(7), pistons=7)
    curve = next(line for line in figure.axes[0].lines if len(line.get_xdata()) > 2)
    assert curve.get_xdata()[np.argmax(curve.get_ydata())] == pytest.approx(70, abs=0.2)
    assert [text.get_text() for text in figure.axes[0].texts][2:] == ["7x", "14x", "21x", "28x", "35x"]


def test_an_order_map_keeps_a_line_of_the_shaft_at_its_order_while_the_speed_rises() -> None:
    shaft = np.linspace(8, 16, 80000)
    angle = 2 * math.pi * np.cumsum(shaft) / 8000
    run_up = Recording(np.sin(9 * angle)[None], 8000.0, "a", speed=2 * math.pi * shaft, condition=AT)
    figure = plot.order_map(run_up, turns=8, top=20)
    (image,) = figure.axes[0].collections
    level = image.get_array().reshape(image._coordinates.shape[0] - 1, -1)  # type: ignore[attr-defined]
    assert set(level.argmax(axis=1).tolist()) == {9 * 8}


def test_a_waterfall_has_a_spectrum_for_each_recording_and_names_it() -> None:
    figure = plot.waterfall([tone(7, "first"), tone(9, "second")], top=200)
    peaks = [line.get_xdata()[np.argmax(line.get_ydata())] for line in figure.axes[0].lines]
    np.testing.assert_allclose(peaks, (70, 90), atol=0.3)
    assert [text.get_text() for text in figure.axes[0].texts] == ["first", "second"]


def test_a_confusion_matrix_counts_what_has_no_verdict_in_a_column_of_its_own() -> None:
    figure = plot.confusion(np.array([[3, 0, 1], [0, 4, 0]]), ("normal", "piston"))
    assert [label.get_text() for label in figure.axes[0].get_xticklabels()] == ["normal", "piston", "no verdict"]
    assert [text.get_text() for text in figure.axes[0].texts] == ["75", "25", "100"]


def test_what_cannot_be_drawn_is_refused_in_one_line(pump) -> None:
    with pytest.raises(InputError, match="has no recess"):
        plot.excitation(Twin(pump, AT))
    with pytest.raises(InputError, match="has no samples from 20 s on"):
        plot.waveform(tone(7), start=20.0)
    with pytest.raises(InputError, match="no channel 'x'; it has acceleration"):
        plot.order_map(tone(7), channel="x")
    with pytest.raises(InputError, match="covers 20 turns, and a map takes 32 at least"):
        plot.order_map(tone(7, turns=20))
    with pytest.raises(InputError, match="1 labels for 2 spectra"):
        plot.waterfall([tone(7), tone(9)], labels=["one"])
    with pytest.raises(InputError, match="does not fit 3 classes"):
        plot.confusion(np.eye(2), ("a", "b", "c"))


def test_every_public_figure_is_a_figure_of_matplotlib(pump) -> None:
    twin = Twin(pump, AT, SwashPlateDefect(depth=mm(0.07)))
    figures = (
        plot.excitation(twin), plot.waveform(tone(7)), plot.spectrum(tone(7)), plot.order_map(tone(7)),
        plot.waterfall(tone(7)), plot.confusion(np.eye(2), ("a", "b")),
    )  # fmt: skip
    assert all(isinstance(figure, Figure) for figure in figures)
