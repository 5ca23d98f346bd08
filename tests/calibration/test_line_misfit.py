"""The misfit of a twin's lines, line by line."""

import numpy as np
import pytest

from swashtwin.calibration import MeasuredLines, compare_lines
from swashtwin.physics import Twin
from swashtwin.pump import OperatingCondition, load_pump


def test_lines_of_the_twin_itself_fit_and_others_differ_by_their_levels() -> None:
    twin = Twin(load_pump("25scy14-1b"), OperatingCondition(90.0, 15e6), bandwidth=800.0)
    amplitude = np.abs(twin.acceleration().detach().numpy())
    deviation = np.zeros_like(amplitude)
    channels = twin.pump.channels

    same = compare_lines(
        twin, amplitude, MeasuredLines(channels, twin.orders, amplitude, deviation)
    )
    assert same.level_difference == pytest.approx(0.0, abs=1e-9)
    assert same.spectral_correlation == pytest.approx(1.0)
    assert same.spectrum_value_error == pytest.approx(0.0)

    # The first line is not clear of the noise; the last order lies beyond the twin's bandwidth.
    deviation[0, 0] = 1e9
    orders = np.append(twin.orders[:-1], twin.orders[-1] + 1)
    measured = MeasuredLines(channels[::-1], orders, 10 * amplitude[::-1], deviation)
    scaled = compare_lines(twin, amplitude, measured).level_difference
    assert np.isnan(scaled[0, 0])
    assert scaled[1:, :-1] == pytest.approx(-20.0)
    assert (scaled[1:, -1] < -99).all()
