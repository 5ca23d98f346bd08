"""The public figures show the data that they are given, and refuse data that cannot be drawn."""

import itertools
import math

import numpy as np
import pytest

from swashtwin import plot
from swashtwin.foundation import InputError, MPa, rpm
from swashtwin.plot import create_panels, figure_style, fit_to_phone
from swashtwin.plot.phone import PHONE_WIDTH
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import Recording

# the shaft turns at 10 Hz
CONDITION = OperatingCondition(rpm(600), MPa(10))


def tone(order: float, turns: int = 100) -> Recording:
    """Return a recording with one line, at an order of the shaft."""
    sample_rate = 4000.0
    time = np.arange(turns * 400) / sample_rate
    noise = np.random.default_rng(0).normal(scale=1e-3, size=time.size)
    signal = np.sin(2 * math.pi * 10 * order * time) + noise
    return Recording(signal[np.newaxis], sample_rate, "a", condition=CONDITION)


def test_a_spectrum_peaks_at_the_line_of_a_recording() -> None:
    figure = plot.spectrum(tone(7), pistons=7)

    # the marks are lines of two points
    curve = next(line for line in figure.axes[0].lines if len(line.get_xdata()) > 2)
    peak = curve.get_xdata()[np.argmax(curve.get_ydata())]
    # over orders, since the speed is known
    assert peak == pytest.approx(7, abs=0.02)


def test_spectra_are_drawn_over_each_other_with_their_names_and_one_set_of_marks() -> None:
    figure = plot.spectrum([tone(7), tone(9).replace(recording_id="b_c")], pistons=7)

    names = [text.get_text() for text in figure.legends[-1].texts]
    assert names == ["a", "b c"]
    assert len([text for text in figure.axes[0].texts if text.get_text() == "7x"]) == 1


def test_a_notebook_shows_a_figure_as_an_image() -> None:
    assert plot.confusion(np.eye(1), ("a",))._repr_html_().startswith("<img alt='figure'")


def test_arrays_are_drawn_at_their_sample_rate() -> None:
    wave = tone(7).signal[0]
    figure = plot.spectrum([wave, wave[:8000]], sample_rate=4000.0)
    curve = figure.axes[0].lines[0]
    assert curve.get_xdata()[np.argmax(curve.get_ydata())] == pytest.approx(70, abs=0.2)


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ([], "no recording to draw"),
        (np.ones((1, 100)), "give sample_rate in Hz"),
        (np.ones((100, 2)), r"array \(channel, time\)"),
        pytest.param(["a.csv"], "Source 1 is a str", marks=pytest.mark.wrong_types),
        pytest.param(None, "Source 1 is a NoneType", marks=pytest.mark.wrong_types),
        ([tone(7), tone(7).replace(unit="g")], "differ in unit"),
        ([tone(7), tone(7).replace(channels=("x",))], "no channel in common"),
    ],
)
def test_sources_that_share_no_axes_are_refused(source: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        plot.spectrum(source)


def test_a_spectrum_names_the_multiples_of_the_pistons() -> None:
    figure = plot.spectrum(tone(7), pistons=7)

    # after the first two multiples of the shaft
    names = [text.get_text() for text in figure.axes[0].texts][2:]
    assert names == ["7x", "14x", "21x", "28x", "35x"]


def test_a_confusion_matrix_has_a_column_for_recordings_without_a_verdict() -> None:
    counts = np.array([[3, 0, 1], [0, 4, 0]])

    axes = plot.confusion(counts, ("normal", "piston")).axes[0]

    columns = [label.get_text() for label in axes.get_xticklabels()]
    assert columns == ["normal", "piston", "no verdict"]
    # percent of each row; zeros are left blank
    assert [text.get_text() for text in axes.texts] == ["75", "25", "100"]


def test_a_confusion_matrix_of_other_classes_is_refused() -> None:
    with pytest.raises(InputError, match="does not fit 3 classes"):
        plot.confusion(np.eye(2), ("a", "b", "c"))


def test_all_of_many_confusion_matrices_have_titles_that_fit() -> None:
    networks = [f"with calibrated twin and law of the recess {number}" for number in range(12)]
    matrices = {(split, name): np.eye(2) for split in ("L2", "L4") for name in networks}

    figure = plot.confusion(matrices, ("normal", "piston"))
    figure.canvas.draw()

    panels = [panel for panel in figure.axes if panel.axison]
    assert len(panels) == 24
    titles = [panel.title.get_window_extent() for panel in panels]
    assert titles[0].y1 <= figure.bbox.y1
    for title, other in itertools.combinations(titles, 2):
        assert not title.overlaps(other)


def test_a_figure_on_a_phone_has_its_panels_below_each_other_and_its_legend_in_it() -> None:
    with figure_style():
        figure, axes = create_panels(2, 2, 4.0, sharex=True)
        for panel in axes.flat:
            panel.plot([0, 1], [0, 1], label="a training set with a long name")
        axes[0, 0].set(yticks=[0, 1], yticklabels=["BiTCN on spectra with a calibrated twin", "b"])
        handles, labels = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles * 3, labels * 3, loc="outside upper center", ncols=3)
        fit_to_phone(figure)
        figure.canvas.draw()

    assert figure.get_figwidth() == PHONE_WIDTH
    tops = [panel.get_window_extent().y1 for panel in axes.flat]
    assert tops == sorted(tops, reverse=True)
    assert figure.legends[0].get_window_extent().x1 <= figure.bbox.x1
    # half of the phone is left for the data
    assert axes[0, 0].get_window_extent().width > figure.bbox.width / 2


def test_a_training_set_has_one_color_whatever_it_is_drawn_with() -> None:
    alone = plot.series_colors(["law"])
    beside_others = plot.series_colors(["own", "measured", "law_everywhere", "law"])

    assert alone["law"] == beside_others["law"] == beside_others["law_everywhere"]
    assert len({*beside_others.values()}) == 3
