"""Fault dimensions, interface values and nuisances of one recording at once, by least squares.

The twin's lines are differentiated exactly with respect to values and nuisances, and by differences
with respect to a fault's dimensions, each of which moves the fault's displacement or the chamber
pressures.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import product
from typing import NamedTuple

import numpy as np
import scipy.linalg
import scipy.optimize
import scipy.stats
import torch
from jaxtyping import Float

from swashtwin.calibration.discrepancy import Discrepancy, linearize, noise_covariance
from swashtwin.calibration.severity.dimensions import FaultSpace, get_severity_search
from swashtwin.calibration.severity.profile_likelihood import (
    THRESHOLD,
    ProfileProblem,
    interval_of,
    profile_likelihood,
)
from swashtwin.calibration.spectrum_objective import Comparison, Objective
from swashtwin.foundation import SwashTwinError

SHARE = 0.1
"""Relative errors of the excitation, of the path and of single lines that a twin is expected to
have; see `discrepancy`. An estimate of ours: what a fault's law lacks, no healthy recording
shows.
"""
ROLL_OFF_FREQUENCY = 1000.0
"""Frequency [Hz] for which `SeveritySearch.roll_off` is stated."""
_PORT_ANGLES = ("discharge_open", "suction_open")
FACTORS = np.geomspace(0.03, 8.0, 9)
"""Severities over the reference's on the first grid; the last is the greatest it can find."""
LEAST_SEVERITY = 1e-3
"""Severity over the reference's that counts as next to none."""
GRID_POINTS = 27
"""Number of values of a further dimension on the first grid, over two standard deviations to both
sides: lines up to order k distinguish a length from those a few k-ths longer, so that there are
many minima.
"""
STARTS = 3
"""Number of starts that are descended from."""
_DEEPER = 0.1
"""Fall of the sum of squares from which a valley is a deeper one."""
_MOST_VALLEYS = 3
_STEP = 1e-3
"""Step of the differences: of the severity over the reference's, or of a logarithm."""
_ROUNDS = 2
"""Number of times that the weights are computed again at the best point."""
ERROR = 0.05
"""Probability of either error at the detection limit (Currie 1968, doi:10.1021/ac60259a007)."""


Ends = tuple[float | None, float | None]
"""Ends of an interval of the severity over the reference's; None where nothing limits it."""


@dataclass(frozen=True, eq=False)
class Prior:
    """What is known of the interface values and nuisances before a recording is looked at."""

    center: Float[np.ndarray, " unknown"]
    """Mean."""
    covariance: Float[np.ndarray, "unknown unknown"]
    """Covariance of all that is uncertain."""
    drift: Float[np.ndarray, "unknown unknown"]
    """The part of it that differs from recording to recording."""


class Minimum(NamedTuple):
    """A local minimum of the sum of squares."""

    point: Float[np.ndarray, " unknown"]
    """Where it is."""
    height: float
    """Sum of squares there."""


class Inversion(ProfileProblem):
    """Sum of squares of one recording's lines and of the priors; coordinates: values, nuisances,
    fault's dimensions.
    """

    def __init__(
        self, objective: Objective, space: FaultSpace, prior: Prior, port_timing: float
    ) -> None:
        self.objective, self.space, self.prior, self.port_timing = (
            objective,
            space,
            prior,
            port_timing,
        )
        searches_corner = any(dimension.name == "corner" for dimension in space.free)
        self.roll_off = 0.0 if searches_corner else get_severity_search(space.reference).roll_off
        self.n_unknowns, self.simulations = len(prior.center), 0
        spread = 6 * np.sqrt(np.diag(prior.covariance))
        further = 4 * np.array([dimension.deviation for dimension in space.free[1:]])
        self.lower = np.concatenate([prior.center - spread, [0.0], -further])
        self.upper = np.concatenate([prior.center + spread, [FACTORS[-1]], further])
        self.prior_root = np.linalg.inv(np.linalg.cholesky(prior.covariance))
        self.root = np.diag(objective.sigma.numpy())

    @property
    def severity(self) -> int:
        """Place of the severity among the coordinates."""
        return self.n_unknowns

    @property
    def threshold(self) -> float:
        """Rise of the sum of squares without the fault above which it is there: noise alone exceeds
        it in 5 % of all cases. Where a further dimension is free there are many minima for noise to
        fall into (Bonferroni).
        """
        return float(
            scipy.stats.chi2.isf(2 * ERROR / (GRID_POINTS if len(self.space.free) > 1 else 1), 1)
        )

    def _objective_at(self, point: np.ndarray, late_port: str | None = None) -> Objective:
        fault = self.space.at(point[self.n_unknowns :])

        def with_fault(comparison: Comparison) -> Comparison:
            twin = comparison.twin.with_fault(fault)
            if late_port is not None:
                plate = twin.pump.valve_plate
                late = replace(plate, **{late_port: getattr(plate, late_port) + self.port_timing})
                twin = replace(twin, pump=replace(twin.pump, valve_plate=late))
            return replace(comparison, twin=twin)

        return replace(
            self.objective,
            comparisons=tuple(with_fault(comparison) for comparison in self.objective.comparisons),
        )

    def observables(
        self, point: Float[np.ndarray, " unknown"], late_port: str | None = None
    ) -> Float[np.ndarray, " observable"]:
        """Simulated observables [m/s^2]; with a port that opens by `port_timing` too late, if one
        is named.
        """
        self.simulations += 1
        with torch.no_grad():
            return (
                self._objective_at(point, late_port)
                .observables(torch.as_tensor(point[: self.n_unknowns]))
                .numpy()
            )

    def at(
        self, point: Float[np.ndarray, " unknown"]
    ) -> tuple[Float[np.ndarray, " residual"], Float[np.ndarray, "residual unknown"]]:
        """Residuals of lines and priors over their standard deviations, and their derivatives."""
        self.simulations += 1
        objective, count = self._objective_at(point), self.n_unknowns
        observables, slope = objective.sensitivity(torch.as_tensor(point[:count]))
        columns = [
            self._difference(point, index, observables.numpy())
            for index in range(count, len(point))
        ]
        difference = (observables - objective.measured).numpy()
        whitened = self.whiten(np.column_stack([difference, slope.numpy(), *columns]))
        rows = np.zeros((len(point) - 1, len(point)))
        rows[:count, :count] = self.prior_root
        for index, dimension in enumerate(self.space.free[1:], start=count):
            rows[index, index + 1] = 1 / dimension.deviation
        reference = np.concatenate([self.prior.center, self.space.start])
        return np.concatenate([whitened[:, 0], rows @ (point - reference)]), np.concatenate(
            [whitened[:, 1:], rows]
        )

    def _difference(self, point: np.ndarray, index: int, here: np.ndarray) -> np.ndarray:
        ahead = point.copy()
        ahead[index] += _STEP
        return (self.observables(ahead) - here) / _STEP

    def whiten(
        self, observables: Float[np.ndarray, "observable *column"]
    ) -> Float[np.ndarray, "observable *column"]:
        """Observables in independent standard deviations."""
        whitened: np.ndarray = scipy.linalg.solve_triangular(self.root, observables, lower=True)
        return whitened

    def weigh(self, point: Float[np.ndarray, " unknown"]) -> None:
        """Set the weights by noise and the twin's expected errors at `point`."""
        objective = self._objective_at(point)
        around = linearize(objective, point[: self.n_unknowns])
        covariance = noise_covariance(around, Discrepancy((), SHARE, SHARE, SHARE))
        if self.roll_off:
            by_fault = point[self.severity] * self._difference(
                point, self.severity, around.simulated
            )
            error = self.roll_off * (objective.frequency / ROLL_OFF_FREQUENCY) ** 2 * by_fault
            covariance = covariance + np.outer(error, error)
        for port in _PORT_ANGLES if self.port_timing else ():
            error = self.observables(point, port) - around.simulated
            covariance = covariance + np.outer(error, error)
        self.root = np.linalg.cholesky(covariance)

    def search(self, starts: Iterable[np.ndarray] | None = None) -> tuple[list[Minimum], float]:
        """Minima of the sum of squares that are likely enough to hold the truth, the deepest first;
        and the misfit.

        Descents begin at `starts`, or at the best points of a first grid.

        The misfit is the root mean square of the lines' residuals at the first descent. Where it
        exceeds 1, all standard deviations of lines are widened by it.
        """
        descents = []
        for start in self._starts() if starts is None else starts:
            self.weigh(start)
            point, height = self.descend(start, fixed=None)
            descents.append((height + 2 * np.log(np.diag(self.root)).sum(), point))
        points = [point for _, point in sorted(descents, key=lambda pair: pair[0])]
        for _ in range(_ROUNDS):
            self.weigh(points[0])
            points[0], height = self.descend(points[0], fixed=None)
        misfit = math.sqrt(height / len(self.root))
        self.root = self.root * max(misfit, 1.0)
        return self.likely([Minimum(*self.descend(point, fixed=None)) for point in points]), misfit

    def likely(self, minima: Iterable[Minimum]) -> list[Minimum]:
        """Those that may hold the truth, each once, the deepest first."""
        deepest, *others = sorted(minima, key=lambda minimum: minimum.height)
        likely = [deepest]
        for minimum in others:
            is_likely = minimum.height - deepest.height < THRESHOLD
            place, places = (
                minimum.point[self.severity :],
                [other.point[self.severity :] for other in likely],
            )
            if is_likely and not any(
                np.allclose(place, other, rtol=0.02, atol=0.02) for other in places
            ):
                likely.append(minimum)
        return likely

    def profiled(self, minima: list[Minimum]) -> tuple[list[Minimum], Ends]:
        """(minima that may hold the truth, the deepest first; ends of the severity's interval
        around all of them).

        A profile may walk into a valley that no descent found. The search then goes on from its
        bottom.
        """
        profiles = [self.profile(minimum) for minimum in minima]
        for _ in range(_MOST_VALLEYS):
            deeper = self._deeper(minima, profiles)
            if deeper is None:
                break
            minima = self.likely([deeper, *minima])
            profiles = [self.profile(minimum) for minimum in minima]
        best = float(minima[0].point[self.severity])
        below, above = [best], [best]
        for coordinate, height in profiles:
            low, high = interval_of(coordinate, np.maximum(height - minima[0].height, 0.0))
            below.append(-math.inf if low is None else low)
            above.append(math.inf if high is None else high)
        low, high = min(below), max(above)
        return minima, (low if low > -math.inf else None, high if high < math.inf else None)

    def _deeper(
        self, minima: list[Minimum], profiles: list[tuple[np.ndarray, np.ndarray]]
    ) -> Minimum | None:
        """The minimum of a valley that a profile found below the deepest; None where there is
        none.
        """
        lowest = int(np.argmin([height.min() for _, height in profiles]))
        coordinate, height = profiles[lowest]
        if height.min() > minima[0].height - _DEEPER:
            return None
        start = minima[lowest].point.copy()
        start[self.severity] = coordinate[height.argmin()]
        start, _ = self.descend(start, fixed=self.severity)
        minimum = Minimum(*self.descend(start, fixed=None))
        return minimum if minimum.height < minima[0].height - _DEEPER else None

    def profile(
        self, minimum: Minimum
    ) -> tuple[Float[np.ndarray, " point"], Float[np.ndarray, " point"]]:
        """Severities over the reference's around a minimum, rising, and the least sum of squares
        over all else.
        """
        severity = float(minimum.point[self.severity])
        coordinate, rise = profile_likelihood(self, minimum.point, minimum.height, self.severity)
        return coordinate, minimum.height + rise - rise[int(np.searchsorted(coordinate, severity))]

    def _starts(self) -> Iterable[np.ndarray]:
        """The best points of the first grid that are clearly distinct."""
        grids = [
            2 * dimension.deviation * np.linspace(-1, 1, GRID_POINTS)
            for dimension in self.space.free[1:2]
        ]
        fixed = np.zeros(max(0, len(self.space.free) - 2))
        seen: list[tuple[float, np.ndarray]] = []
        for factor, *further in product(FACTORS, *grids):
            point = np.concatenate([self.prior.center, [factor], further, fixed])
            try:
                misses = (
                    self.observables(point) - self.objective.measured.numpy()
                ) / self.objective.sigma.numpy()
            except SwashTwinError:  # no pump runs with a fault so severe
                self.upper[self.severity] = seen[-1][1][self.severity] if seen else FACTORS[0]
                break
            seen.append((float(misses @ misses), point))
        starts: list[np.ndarray] = []
        first = self.severity
        for _, point in sorted(seen, key=lambda pair: pair[0]):
            if all(
                abs(math.log(point[first] / other[first])) > 1
                or bool((np.abs(point[first + 1 :] - other[first + 1 :]) > 0.05).any())
                for other in starts
            ):
                starts.append(point)
            if len(starts) == STARTS:
                break
        return starts

    def detection_limit(self, point: Float[np.ndarray, " unknown"]) -> float | None:
        """Least severity over the reference's that these lines distinguish from next to none; None
        beyond the search.

        Next to none, because a fault of several effects need not vanish with its severity.

        Parameters
        ----------
        point : the best one without a fault.
        """
        _, slope = self.at(point)
        others = np.delete(slope, self.severity, axis=1)
        least = point.copy()
        least[self.severity] = LEAST_SEVERITY
        silent = self.observables(least)
        needed = math.sqrt(self.threshold) + float(scipy.stats.norm.isf(ERROR))

        def surplus(logarithm: float) -> float:
            moved = point.copy()
            moved[self.severity] = np.exp(logarithm)
            change = np.zeros(len(slope))
            change[: len(silent)] = self.whiten(self.observables(moved) - silent)
            residual = change - others @ np.linalg.lstsq(others, change, rcond=None)[0]
            return float(np.linalg.norm(residual)) - needed

        low, high = np.log(LEAST_SEVERITY), np.log(self.upper[self.severity])
        if surplus(high) < 0:
            return None
        return float(np.exp(scipy.optimize.brentq(surplus, low, high, xtol=0.02)))

    def deviations(
        self, point: Float[np.ndarray, " unknown"]
    ) -> tuple[Float[np.ndarray, "unknown unknown"], float]:
        """Covariance of all coordinates, and the standard deviation of the severity (over the
        reference's) from recording to recording of one pump: what noise and drift do, where all
        else stays.
        """
        _, slope = self.at(point)
        n_lines = len(self.root)
        covariance = np.linalg.pinv(slope.T @ slope)
        weights = covariance[self.severity] @ slope.T
        noise = np.concatenate([comparison.deviation for comparison in self.objective.comparisons])
        errors = scipy.linalg.solve_triangular(self.root, weights[:n_lines], lower=True, trans="T")
        drift = self.prior_root.T @ weights[n_lines : n_lines + self.n_unknowns]
        return covariance, float(
            np.sqrt(np.sum((errors * noise) ** 2) + drift @ self.prior.drift @ drift)
        )
