"""A map of shaft orders over time: how far each one has changed from the healthy baseline."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float
from markupsafe import Markup

from swashtwin.monitoring.history.reading import IndicatorTable
from swashtwin.monitoring.history.schema import Alarm
from swashtwin.monitoring.page.axis import Axis
from swashtwin.monitoring.page.charts import (
    HEIGHT,
    WIDTH,
    draw_alarms,
    draw_figure,
    seconds_of,
)

CHANGE_STEPS_DB = (3.0, 6.0, 10.0, 15.0)
"""Changes at which the color changes; below the first one a change does not count."""
MAX_COLUMNS = 160
"""Columns of a map, each the mean of consecutive recordings; a phone shows no more."""

# Share of the width by which neighbors may be apart through rounding.
_TOLERANCE = 1e-6

# Orders that are named on the axis if the number of pistons is not known.
_TICK_DISTANCE = 10


def order_of(indicator: str) -> int | None:
    """Return the shaft order of an indicator; `None` if it is another one.

    Examples
    --------
    >>> order_of("shaft order 9"), order_of("shaft order 9 of the envelope")
    (9, None)
    """
    number = indicator.removeprefix("shaft order ")
    if number != indicator and number.isdecimal():
        return int(number)
    return None


def draw_order_map(
    table: IndicatorTable,
    baseline: Mapping[str, tuple[float, float]],
    pistons: int | None,
    alarms: Sequence[Alarm],
) -> Markup:
    """Return a map of the changes of shaft orders over time; empty without an order.

    Parameters
    ----------
    table : powers of the orders 1, 2, ... [dB] of each recording, oldest first.
    baseline : (median, scatter) of each indicator; without it, changes are those from the median of
        all recordings shown.
    pistons : number of pistons, whose multiples are named on the axis.
    """
    if not table.values.size:
        return Markup("")

    has_values = np.isfinite(table.values).any(axis=0)
    median = np.full(len(table.names), np.nan)
    median[has_values] = np.nanmedian(table.values[:, has_values], axis=0)
    for column, name in enumerate(table.names):
        if name in baseline:
            median[column] = baseline[name][0]
    times = seconds_of(table.times)
    group_starts = np.arange(0, len(times), math.ceil(len(times) / MAX_COLUMNS))
    counts = np.diff(np.append(group_starts, len(times)))
    change = np.add.reduceat(table.values - median, group_starts, axis=0) / counts[:, None]
    # The mean of a group around a pause would lie in the pause.
    group_times = times[group_starts + counts // 2]

    x = Axis.around(times, kind="time")
    n_orders = len(table.names)
    y = Axis(0.5, n_orders + 0.5)
    parts = [*_draw_cells(x.share(_edges(group_times)), change), *draw_alarms(x, alarms)]
    step = pistons or _TICK_DISTANCE
    ticks = [(float(y.share(order)), f"{order}×") for order in range(step, n_orders + 1, step)]
    return draw_figure(x, y, parts, title="Shaft order", y_ticks=ticks, map="orders")


def _edges(times: Float[np.ndarray, " column"]) -> Float[np.ndarray, "column 2"]:
    """Return the times at which each column begins and ends.

    A column reaches to the middle between it and its neighbor, but leaves a long pause empty.
    """
    if len(times) == 1:
        return times[:, None] + np.array([-1.0, 1.0])
    gaps = np.diff(times)
    reach = np.minimum(gaps / 2, np.median(gaps))
    outer = np.median(gaps) / 2
    before = np.insert(reach, 0, outer)
    after = np.append(reach, outer)
    return np.stack([times - before, times + after], axis=1)


def _draw_cells(
    edges: Float[np.ndarray, "column 2"], change: Float[np.ndarray, "column order"]
) -> list[str]:
    """Return one path for each color, with a rectangle for each run of cells of that color."""
    magnitude = np.digitize(np.abs(change), CHANGE_STEPS_DB)
    colors = np.where(np.isfinite(change), np.sign(change) * magnitude, 0).astype(int)
    n_columns, n_orders = colors.shape
    row_height = HEIGHT / n_orders

    paths: dict[int, str] = {}
    for order in range(n_orders):
        top = HEIGHT - (order + 1) * row_height
        start = 0
        for column in range(1, n_columns + 1):
            color = int(colors[start, order])
            is_joined = (
                column < n_columns
                and colors[column, order] == color
                and edges[column, 0] <= edges[column - 1, 1] + _TOLERANCE
            )
            if is_joined:
                continue
            if color:
                left, right = (WIDTH * edges[[start, column - 1], [0, 1]]).round(1)
                paths[color] = paths.get(color, "") + (
                    f"M{left:g} {top:.1f}H{right:g}v{row_height:.2f}H{left:g}Z"
                )
            start = column
    return [
        f'<path class="{"rise" if color > 0 else "fall"}-{abs(color)}" d="{line}"/>'
        for color, line in sorted(paths.items())
    ]
