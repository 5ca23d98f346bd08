"""The misfit of a twin's lines, line by line."""

import numpy as np
import pytest

from swashtwin.calibration import MeasuredLines, compare_lines
from swashtwin.physics import Twin
from swashtwin.pump import OperatingCondition, load_pump


@pytest.fixture(scope="module")
def twin() -> Twin:
    return Twin(load_pump("25scy14-1b"), OperatingCondition(90.0, 15e6), bandwidth=800.0)


@pytest.fixture(scope="module")
def amplitude(twin: Twin) -> np.ndarray:
    return np.abs(twin.acceleration().detach().numpy())


def test_the_twins_lines_have_no_misfit_with_themselves(twin: Twin, amplitude: np.ndarray) -> None:
    measured = MeasuredLines(twin.pump.channels, twin.orders, amplitude, np.zeros_like(amplitude))
    misfit = compare_lines(twin, amplitude, measured)
    assert misfit.level_difference == pytest.approx(0.0, abs=1e-9)
    assert misfit.spectral_correlation == pytest.approx(1.0)
    assert misfit.spectrum_value_error == pytest.approx(0.0)


def test_lines_ten_times_as_high_differ_by_20_decibels(twin: Twin, amplitude: np.ndarray) -> None:
    # the first line is not clear of the noise; the last order lies beyond the twin's bandwidth
    deviation = np.zeros_like(amplitude)
    deviation[0, 0] = 1e9
    orders = np.append(twin.orders[:-1], twin.orders[-1] + 1)
    # channels in another order than the twin's
    measured = MeasuredLines(twin.pump.channels[::-1], orders, 10 * amplitude[::-1], deviation)

    difference = compare_lines(twin, amplitude, measured).level_difference

    assert np.isnan(difference[0, 0])
    assert difference[1:, :-1] == pytest.approx(-20.0)
    assert (difference[1:, -1] < -99).all()
