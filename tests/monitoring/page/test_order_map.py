"""The map of shaft orders over time, and spectra over shaft orders."""

import re

import numpy as np
import pytest

from swashtwin.foundation import MPa
from swashtwin.monitoring.history.reading import IndicatorTable
from swashtwin.monitoring.page.charts import HEIGHT, WIDTH
from swashtwin.monitoring.page.order_map import MAX_COLUMNS, draw_order_map
from swashtwin.monitoring.page.spectra import _read_lines
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import Recording

N_ORDERS = 40
START = np.datetime64("2026-03-01T06:00:00")
NAMES = [f"shaft order {order}" for order in range(1, N_ORDERS + 1)]
BASELINE = dict.fromkeys(NAMES, (-20.0, 1.0))


def table(values: np.ndarray) -> IndicatorTable:
    """One recording an hour."""
    return IndicatorTable(NAMES, START + np.arange(len(values)) * np.timedelta64(1, "h"), values)


def cells(drawing: str, role: str) -> list[tuple[float, float, float]]:
    """Return left and right end of each rectangle of a color, as shares, and its order."""
    (path,) = re.findall(rf'<path class="{role}" d="([^"]*)"', drawing)
    found = []
    for left, top, right in re.findall(r"M([\d.]+) ([\d.]+)H([\d.]+)", path):
        order = N_ORDERS - float(top) / HEIGHT * N_ORDERS
        found.append((float(left) / WIDTH, float(right) / WIDTH, order))
    return found


def test_an_order_that_rises_is_colored_from_its_rise_to_the_end() -> None:
    values = np.full((10, N_ORDERS), -20.0)
    values[6:, 8] = -12.0
    values[3, 20] = -40.0

    drawing = draw_order_map(table(values), BASELINE, 9, [])

    ((left, right, order),) = cells(drawing, "rise-2")
    assert order == pytest.approx(9, abs=0.01)
    # Half of the time between two recordings before the seventh; 5 % of space at the end.
    assert left == pytest.approx(0.05 + 0.9 * 5.5 / 9, abs=0.01)
    assert right == pytest.approx(0.95 + 0.9 * 0.5 / 9, abs=0.01)
    ((_, _, fallen_order),) = cells(drawing, "fall-4")
    assert fallen_order == pytest.approx(21, abs=0.01)
    assert re.findall(r"class=\"value\"[^>]*>([^<]*)", drawing) == ["9×", "18×", "27×", "36×"]


def test_a_map_without_a_baseline_shows_changes_from_the_median() -> None:
    values = np.full((10, N_ORDERS), 5.0)
    values[9, 0] = 25.0
    values[:, 39] = np.nan  # beyond half of the sample rate

    drawing = draw_order_map(table(values), {}, None, [])

    ((_, _, order),) = cells(drawing, "rise-4")
    assert order == pytest.approx(1, abs=0.01)
    assert drawing.count("<path") == 1


def test_a_map_of_thousands_of_recordings_stays_small_and_leaves_a_pause_empty() -> None:
    random = np.random.default_rng(0)
    stored = table(-20.0 + random.normal(scale=4.0, size=(2000, N_ORDERS)))
    stored.times[1000:] += np.timedelta64(2000, "h")
    stored.values[:, 0] = 0.0

    drawing = draw_order_map(stored, BASELINE, 9, [])

    assert drawing.count("M") < MAX_COLUMNS * N_ORDERS
    before, after = sorted(cell for cell in cells(drawing, "rise-4") if cell[2] < 1.5)
    assert after[0] - before[1] > 0.3


def test_a_map_without_orders_is_empty() -> None:
    empty = IndicatorTable((), np.array([], "datetime64[us]"), np.empty((0, 0)))
    assert draw_order_map(empty, {}, 9, []) == ""


def test_lines_at_the_same_order_are_compared_although_the_speeds_differ() -> None:
    spectra = []
    for shaft_hz in (25.0, 25.4):
        time = np.arange(4 * 6400) / 6400
        recording = Recording(
            np.sin(2 * np.pi * 28 * shaft_hz * time)[None],
            6400.0,
            f"{shaft_hz}",
            channels=("x",),
            condition=OperatingCondition(2 * np.pi * shaft_hz, MPa(15)),
        )
        spectra.append(_read_lines(recording))
    first, second = spectra

    orders = first.frequency / first.shaft_hz
    healthy = second.near(orders * second.shaft_hz)[0]

    assert orders[np.argmax(healthy)] == pytest.approx(28, abs=0.1)
    assert healthy.max() == pytest.approx(first.amplitude.max(), rel=0.2)
