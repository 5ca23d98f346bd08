"""What the half-sine edges of the paper's recess do to the Runge-Kutta method.

The slippers' displacement bends where an edge begins and ends: its velocity jumps, and with it the force through the
slippers' films. Whoever samples that force at half steps lets the jumps fall anywhere within a step. Compared are
settled motions over one piston passage: forces sampled so, steps cut at the jumps, and an edge of raised-cosine shape.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import torch
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter
from torch import Tensor

from peers.figures import Line, save
from peers.measuring import alone, settle
from peers.problem import pump_twin
from swashtwin.physics import Twin
from swashtwin.physics.recess import slipper_profile, stages
from swashtwin.physics.solvers.runge_kutta import rk4_limit, rk4_map, state_matrix
from swashtwin.physics.solvers.trajectories import Trajectory, rk4_trajectory_with_breaks
from swashtwin.plot import CALIBRATED, MEASURED, NOMINAL, figure_style, name_decades, panels
from swashtwin.pump import Interfaces, SwashPlateDefect

PARTS = 64
"""Moments of one passage at which motions are compared."""
FINEST = 2
"""How many times smaller the reference's step is than the smallest drawn."""
SHARES = tuple(np.geomspace(0.06, 0.97, 13))
"""Steps drawn, over the stability limit."""
FILMS = {1.86e6: "the paper's film, C_sw 1.86e6 N s/m", 9e4: "a thick film, C_sw 9e4 N s/m"}
"""Damping of the slippers' film [N s/m], and its words."""
TICKS = {1.86e6: (0.1, 0.3, 1), 9e4: (1, 3, 10)}
"""Steps [us] that are named."""


@dataclass(frozen=True)
class Case:
    """A twin and how its steps are laid."""

    twin: Twin
    aligned: bool
    """Whether steps are cut where the displacement bends."""

    @property
    def defect(self) -> SwashPlateDefect:
        """The recess."""
        assert isinstance(self.twin.fault, SwashPlateDefect)
        return self.twin.fault

    @property
    def passage(self) -> float:
        """Time from one piston to the next [s]."""
        return self.twin.condition.period / self.twin.pump.rotating_group.piston_count

    def matrices(self) -> tuple[Tensor, Tensor, Tensor]:
        """M, C and K."""
        structure, values = self.twin.structure, self.twin.values
        return structure.mass, structure.damping(values), structure.stiffness(values)

    def bends(self) -> list[float]:
        """Times within one passage at which the displacement bends [s]."""
        stage = stages(self.twin.pump, self.defect)
        half = np.array([stage.total / 2, stage.total / 2 - stage.rise])
        angles = self.defect.angle + np.concatenate([-half, half])
        return sorted(np.mod(angles / self.twin.condition.speed, self.passage))

    def force(self) -> Callable[[Tensor], Tensor]:
        """Forces [N, N m] at times [s]: the pressures' lines, and the displacement as it is."""
        drive, values, speed = self.twin.drive, self.twin.values, self.twin.condition.speed
        count = self.twin.pump.rotating_group.piston_count
        offset = 2 * math.pi * np.arange(count)[:, None] / count
        every = drive.orders % count == 0
        rates, lines = 1j * drive.frequency[0, every], drive.pressure[0, every]
        film, bore = (vector.reshape(-1, 13)[0] for vector in (drive.action.film, drive.action.bore))

        def at(time: Tensor) -> Tensor:
            shape, slope = slipper_profile(self.twin.pump, self.defect, speed * time.numpy() + offset)
            moved, moving = torch.as_tensor(shape.sum(0))[:, None], torch.as_tensor(speed * slope.sum(0))[:, None]
            strained = (values[1] * moved + values[0] * moving) * film + (values[5] * moved + values[4] * moving) * bore
            return (torch.exp(time[:, None] * rates) @ lines).real + strained

        return at


def mean_accelerations(case: Case, step: float) -> np.ndarray:
    """Mean acceleration [m/s^2] of each sensor (part, sensor) between the compared moments, once settled."""
    moments = [case.passage * i / PARTS for i in range(1, PARTS)]
    breaks = sorted({*moments, *case.bends()}) if case.aligned else moments
    state, turn = state_matrix(*case.matrices()), torch.eye(26, dtype=torch.float64)
    for begin, end in pairwise([0.0, *breaks, case.passage]):
        n_steps = math.ceil((end - begin) / step - 1e-6)
        turn = torch.linalg.matrix_power(rk4_map(state, (end - begin) / n_steps)[0], n_steps) @ turn

    def march(start: Tensor | None) -> Trajectory:
        return rk4_trajectory_with_breaks(*case.matrices(), case.force(), step, case.passage, breaks, start)

    start = torch.linalg.solve(torch.eye(26, dtype=torch.float64) - turn, march(None).states[-1])
    trajectory = march(start)
    times = torch.tensor([0, *moments, case.passage], dtype=torch.float64)
    rows = torch.searchsorted(trajectory.time, times - 1e-12)
    velocity = trajectory.states[rows, 13:] @ case.twin.structure.sensor_rows.T
    return np.diff(velocity.numpy(), axis=0) / (case.passage / PARTS)


def errors(damping: float) -> list[Line]:
    """Error over the step [us] for each way, with this damping of the slippers' film [N s/m]."""
    settle()
    reference = pump_twin()
    values = reference.values.numpy().copy()
    values[0] = damping
    twin = reference.with_interfaces(Interfaces.from_values(values))
    assert isinstance(twin.fault, SwashPlateDefect)
    smooth = twin.with_fault(replace(twin.fault, edge="raised_cosine"))
    limit = rk4_limit(state_matrix(*Case(twin, True).matrices()))
    ways = (
        ("half-sine, sampled at half steps", NOMINAL, Case(twin, False)),
        ("raised cosine, sampled at half steps", MEASURED, Case(smooth, False)),
        ("half-sine, steps cut at its bends", CALIBRATED, Case(twin, True)),
    )
    lines = []
    for name, color, case in ways:
        exact = mean_accelerations(replace(case, aligned=True), limit * min(SHARES) / FINEST)
        errors_of_steps = [
            np.abs(mean_accelerations(case, limit * share) - exact).max() / np.abs(exact).max() for share in SHARES
        ]
        lines.append(
            Line(name, color, [(limit * s * 1e6, float(e)) for s, e in zip(SHARES, errors_of_steps, strict=True)])
        )
    return lines


def draw_edges(folder: Path) -> None:
    """Compute, and write ``simulator_edges`` as SVG, PNG and CSV into `folder`."""
    save(edges_figure({damping: alone(errors, damping) for damping in FILMS}), folder, "simulator_edges")


@figure_style()
def edges_figure(lines: dict[float, list[Line]]) -> tuple[Figure, list[dict[str, object]]]:
    """One panel for each film, and their data."""
    figure, axes = panels(1, len(lines), 4.0, sharey=True)
    for ax, (damping, of_film) in zip(axes[0], lines.items(), strict=True):
        ax.set(xscale="log", yscale="log", xlabel="step [µs]", title=FILMS[damping])
        for line in of_film:
            ax.plot(*zip(*line.points, strict=True), marker="o", markersize=3.5, color=line.color)
        ax.set_xticks(TICKS[damping], [f"{tick:g}" for tick in TICKS[damping]])
        ax.xaxis.set_minor_formatter(NullFormatter())
    axes[0, 0].set_ylabel("error of the acceleration, relative [1]")
    for line, away in zip(next(iter(lines.values())), (0.15, 40, 0.15), strict=True):
        step, error = line.points[0]
        axes[0, 0].text(step, away * error, line.name, color=line.color, fontsize=9)
    axes[0, 0].set_ylim(bottom=5e-13)
    name_decades(axes[0, 0])
    data = [
        {"C_sw": damping, "way": line.name, "step_us": x, "error": y}
        for damping, of_film in lines.items()
        for line in of_film
        for x, y in line.points
    ]
    return figure, data
