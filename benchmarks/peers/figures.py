"""Time against steps and against batch size, for all that is installed."""

import csv
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from peers import throughput
from peers.measuring import Entry, alone, times_over_steps
from peers.problem import STEPS_PER_REVOLUTION
from swashtwin.plot import CALIBRATED, MEASURED, figure_style, name_decades, panels, spread_labels

STEPS = (1_000, 3_000, 10_000, 30_000, 72_000, 288_000)
SETS = (1, 3, 10, 30, 100, 300, 1000)


@dataclass(frozen=True)
class Line:
    """One line of a panel."""

    name: str
    color: str
    points: Sequence[tuple[float, float]]
    scaled: bool = False
    """Whether it is scaled up from fewer steps; drawn dashed."""


@dataclass(frozen=True)
class Timed:
    """An entry of the panel of steps."""

    label: str
    color: str
    entry: Entry
    most: int = STEPS[-1]
    """Steps beyond which it is not run."""


OVER_STEPS = (
    Timed("torchdiffeq rk4", "#aa4499", Entry("", "", "ode_library", "TorchDiffEq"), 10_000),
    Timed("PyTorch eager RK4", "#d55e00", Entry("", "", "eager", "Eager"), 72_000),
    Timed("diffrax RK4", "#009e73", Entry("", "", "diffrax_side", "DiffraxRemembering")),
    Timed("JAX scan RK4", "#e69f00", Entry("", "", "jax_side", "JaxScan")),
    Timed("numba RK4", MEASURED, Entry("", "", "numba_adjoint", "Numba")),
    Timed("ours, RK4 in steady state", CALIBRATED, Entry("", "", "ours", "SteadyRungeKutta")),
    Timed("ours, harmonic balance", CALIBRATED, Entry("", "", "ours", "Steady")),
)


def over_steps() -> list[Line]:
    """Lines of the first panel."""
    lines = []
    for timed in OVER_STEPS:
        counts = tuple(count for count in STEPS if count <= timed.most)
        if points := alone(times_over_steps, timed.entry, counts):
            lines.append(Line(timed.label, timed.color, points))
    return lines


def over_sets() -> list[Line]:
    """Lines of the second panel; the peers are timed over few steps and scaled to a revolution."""
    ours = [(count, alone(throughput.ours, count)) for count in SETS]
    lines = [Line("ours, harmonic balance", CALIBRATED, ours)]
    peers: tuple[tuple[str, str, Callable[[int, int], float], int], ...] = (
        ("PyTorch eager RK4", "#d55e00", throughput.eager, 4000),
        ("JAX scan under vmap", "#e69f00", throughput.jax, 40_000),
    )
    for name, color, run, steps_of_one in peers:
        try:
            points = [(n, alone(run, n, min(1000, max(40, steps_of_one // n)))) for n in SETS]
        except ImportError:
            continue
        lines.append(Line(name, color, [(n, per_step * STEPS_PER_REVOLUTION) for n, per_step in points], scaled=True))
    return lines


def draw_scaling(folder: Path) -> None:
    """Measure, and write ``simulator_scaling`` as SVG, PNG and CSV into `folder`."""
    save(scaling_figure(over_steps(), over_sets()), folder)


@figure_style()
def scaling_figure(steps: Sequence[Line], sets: Sequence[Line]) -> tuple[Figure, list[dict[str, object]]]:
    """The two panels, and their data."""
    figure, axes = panels(1, 2, 4.6, sharey=True, width_ratios=(1.15, 1))
    left, right = axes[0]
    for ax, lines in ((left, steps), (right, sets)):
        ax.set(xscale="log", yscale="log")
        for line in lines:
            style = "--" if line.scaled else "-"
            ax.plot(*zip(*line.points, strict=True), style, marker="o", markersize=3.5, color=line.color)
    left.set(xlabel="steps of 0.97 µs [1]", ylabel="value and gradient [s]", title="One set of values")
    right.set(xlabel="sets of values at once [1]", title="One revolution; dashed: scaled up from fewer steps")
    left.axvline(STEPS_PER_REVOLUTION, color="black", linewidth=0.8, linestyle=":")
    left.text(
        STEPS_PER_REVOLUTION, left.get_ylim()[0], " one revolution", fontsize=8, va="bottom", rotation=90, ha="right"
    )
    for ax, lines in ((left, steps), (right, sets)):
        low = ax.get_xlim()[0]
        label_ends(ax, lines)
        ax.set_xticks(*named_decades(low, max(line.points[-1][0] for line in lines)))
        ax.xaxis.set_minor_locator(NullLocator())
    name_decades(left)
    data = [
        {"panel": panel, "line": line.name, "x": x, "seconds": y, "scaled": line.scaled}
        for panel, lines in (("steps", steps), ("sets", sets))
        for line in lines
        for x, y in line.points
    ]
    return figure, data


def named_decades(low: float, high: float) -> tuple[list[float], list[str]]:
    """Powers of ten within a range, and their names without formulas."""
    ticks = [10.0**decade for decade in range(7) if low <= 10**decade <= high]
    return ticks, [f"{tick:,.0f}" for tick in ticks]


def label_ends(ax: Axes, lines: Sequence[Line], *, gap: float = 0.045) -> None:
    """Name each line beside its last point, moved as far apart as reading needs; above it where it ends early."""
    low, high = ax.get_xlim()
    ax.set_xlim(low, high * (high / low) ** 0.62)
    ax.autoscale(False)
    last = max(line.points[-1][0] for line in lines)
    for line in (line for line in lines if line.points[-1][0] < last):
        x, y = line.points[-1]
        ax.text(x, 1.4 * y, line.name, fontsize=8.5, color=line.color, ha="center")
    lines = [line for line in lines if line.points[-1][0] == last]
    inverse = ax.transAxes.inverted()
    ends = [inverse.transform(ax.transData.transform(line.points[-1])) for line in lines]
    for line, end, height in zip(lines, ends, spread_labels([end[1] for end in ends], gap), strict=True):
        ax.annotate(
            line.name, tuple(end), (end[0] + 0.03, height), "axes fraction", "axes fraction", fontsize=8.5,
            color=line.color, va="center", arrowprops={"arrowstyle": "-", "color": line.color, "linewidth": 0.5},
        )  # fmt: skip


def save(drawing: tuple[Figure, list[dict[str, object]]], folder: Path, name: str = "simulator_scaling") -> None:
    """Write a figure as SVG and PNG, and its data as CSV."""
    figure, data = drawing
    folder.mkdir(parents=True, exist_ok=True)
    with figure_style():
        figure.savefig(folder / f"{name}.svg", metadata={"Date": None, "Creator": None})
        figure.savefig(folder / f"{name}.png", dpi=160, metadata={"Software": None})
    with (folder / f"{name}.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, list(data[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(data)
