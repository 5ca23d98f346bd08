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
from swashtwin.calibration.fault_dimensions import FaultSpace, get_severity_search
from swashtwin.calibration.severity.profile_likelihood import (
    THRESHOLD,
    ProfileProblem,
    find_interval,
    profile_likelihood,
)
from swashtwin.calibration.spectrum_objective import Objective
from swashtwin.foundation import SwashTwinError

EXPECTED_ERROR = 0.1
"""Relative errors of the excitation, of the path and of single lines that a twin is expected to
have; see `discrepancy`. An estimate of ours: what a fault's law lacks, no healthy recording
shows.
"""
ROLL_OFF_FREQUENCY = 1000.0
"""Frequency [Hz] to which `SeveritySearch.roll_off_std` refers."""
_PORT_ANGLES = ("discharge_open", "suction_open")
SEVERITY_GRID = np.geomspace(0.03, 8.0, 9)
"""Severities over the reference's on the first grid; the last is the upper bound of the search."""
MIN_SEVERITY = 1e-3
"""Severity over the reference's that counts as next to none."""
GRID_POINTS = 27
"""Number of values of a further dimension on the first grid, over two standard deviations to both
sides: lines up to order k distinguish a length from those a few k-ths longer, so that there are
many minima.
"""
LIFT_OFF_GRID_POINTS = 9
"""The same of a recess from which slippers lift off. Its simulation takes three times as long, and
hardly any of its lines below 1 kHz stands out.
"""
MAX_STARTS = 3
"""Number of starts of descents."""

# Fall of the sum of squares from which a valley is a deeper one.
_MIN_DEPTH = 0.1

_MAX_DEEPER_VALLEYS = 3

# Step of the differences: of the severity over the reference's, or of a logarithm.
_DIFFERENCE_STEP = 1e-3

# Number of times that the weights are computed again at the best point.
_REWEIGHTING_ROUNDS = 2

ERROR_PROBABILITY = 0.05
"""Probability of either error at the detection limit (Currie 1968, doi:10.1021/ac60259a007)."""
_VALUE_BOUND_STDS = 6.0

# Bounds of the search, in standard deviations of the priors.
_DIMENSION_BOUND_STDS = 4.0


Ends = tuple[float, float]
"""Ends of an interval of the severity over the reference's; infinite if nothing limits it."""


@dataclass(frozen=True, eq=False)
class Prior:
    """What is known of the interface values and nuisances before a recording is inverted."""

    center: Float[np.ndarray, " unknown"]
    """Mean."""
    covariance: Float[np.ndarray, "unknown unknown"]
    """Covariance of all that is uncertain."""
    drift: Float[np.ndarray, "unknown unknown"]
    """The part of it that differs from recording to recording."""


class Minimum(NamedTuple):
    """A local minimum of the sum of squares."""

    point: Float[np.ndarray, " unknown"]
    """Coordinates of the minimum."""
    height: float
    """Sum of squares there."""


class Inversion(ProfileProblem):
    """Sum of squares of one recording's lines and of the priors.

    Coordinates: values, nuisances, dimensions of the fault.
    """

    def __init__(
        self, objective: Objective, space: FaultSpace, prior: Prior, port_timing: float
    ) -> None:
        self.objective = objective
        self.space = space
        self.prior = prior
        self.port_timing = port_timing
        self.n_unknowns = len(prior.center)
        self.simulations = 0

        self.grid_points = GRID_POINTS
        if getattr(space.reference, "contact", None) == "lift_off":
            self.grid_points = LIFT_OFF_GRID_POINTS

        # a corner that is searched is what rolls the excitation off
        search = get_severity_search(space.reference)
        searches_corner = any(dimension.name == "corner" for dimension in space.free)
        self.roll_off = search.roll_off_std
        if searches_corner:
            self.roll_off = 0.0

        value_reach = _VALUE_BOUND_STDS * np.sqrt(np.diag(prior.covariance))
        prior_stds = np.array([dimension.prior_std for dimension in space.free[1:]])
        dimension_reach = _DIMENSION_BOUND_STDS * prior_stds
        self.lower = np.concatenate([prior.center - value_reach, [0.0], -dimension_reach])
        self.upper = np.concatenate(
            [prior.center + value_reach, [SEVERITY_GRID[-1]], dimension_reach]
        )

        self.prior_root = np.linalg.inv(np.linalg.cholesky(prior.covariance))
        self.root = np.diag(objective.sigma.numpy())

    @property
    def severity(self) -> int:
        """Index of the severity among the coordinates."""
        return self.n_unknowns

    @property
    def threshold(self) -> float:
        """Rise of the sum of squares without the fault above which it is detected: noise alone
        exceeds it in 5 % of all cases. A free further dimension gives noise many minima to fall
        into (Bonferroni).
        """
        n_minima = 1
        if len(self.space.free) > 1:
            n_minima = GRID_POINTS
        return float(scipy.stats.chi2.isf(2 * ERROR_PROBABILITY / n_minima, 1))

    def _objective_at(self, point: np.ndarray, late_port: str | None = None) -> Objective:
        """Return the objective with the fault of `point`, and with a late port if one is named."""
        fault = self.space.fault_at(point[self.n_unknowns :])
        comparisons = []
        for comparison in self.objective.comparisons:
            twin = comparison.twin.with_fault(fault)
            if late_port is not None:
                plate = twin.pump.valve_plate
                late_angle = getattr(plate, late_port) + self.port_timing
                late_plate = replace(plate, **{late_port: late_angle})
                twin = replace(twin, pump=replace(twin.pump, valve_plate=late_plate))
            comparisons.append(replace(comparison, twin=twin))
        return replace(self.objective, comparisons=tuple(comparisons))

    def observables(
        self, point: Float[np.ndarray, " unknown"], late_port: str | None = None
    ) -> Float[np.ndarray, " observable"]:
        """Return the simulated observables [m/s^2].

        Parameters
        ----------
        late_port : a port that opens by `port_timing` too late.
        """
        self.simulations += 1
        objective = self._objective_at(point, late_port)
        with torch.no_grad():
            return objective.observables(torch.as_tensor(point[: self.n_unknowns])).numpy()

    def residuals_at(
        self, point: Float[np.ndarray, " unknown"]
    ) -> tuple[Float[np.ndarray, " residual"], Float[np.ndarray, "residual unknown"]]:
        """Return the residuals of lines and priors over their standard deviations, and their
        derivatives.
        """
        self.simulations += 1
        objective = self._objective_at(point)
        count = self.n_unknowns
        observables, slope = objective.sensitivity(torch.as_tensor(point[:count]))
        fault_slopes = [
            self._difference(point, index, observables.numpy())
            for index in range(count, len(point))
        ]
        residual = (observables - objective.measured).numpy()
        whitened = self.whiten(np.column_stack([residual, slope.numpy(), *fault_slopes]))

        # the severity has no prior, so the priors have one row less than there are coordinates
        prior_slope = np.zeros((len(point) - 1, len(point)))
        prior_slope[:count, :count] = self.prior_root
        for index, dimension in enumerate(self.space.free[1:], start=count):
            prior_slope[index, index + 1] = 1 / dimension.prior_std
        reference = np.concatenate([self.prior.center, self.space.start])
        prior_residual = prior_slope @ (point - reference)

        return (
            np.concatenate([whitened[:, 0], prior_residual]),
            np.concatenate([whitened[:, 1:], prior_slope]),
        )

    def _difference(self, point: np.ndarray, index: int, observables: np.ndarray) -> np.ndarray:
        """Return the derivative of the observables by a coordinate, from a difference."""
        shifted_point = point.copy()
        shifted_point[index] += _DIFFERENCE_STEP
        return (self.observables(shifted_point) - observables) / _DIFFERENCE_STEP

    def whiten(
        self, observables: Float[np.ndarray, "observable *column"]
    ) -> Float[np.ndarray, "observable *column"]:
        """Return observables in independent standard deviations."""
        whitened: np.ndarray = scipy.linalg.solve_triangular(self.root, observables, lower=True)
        return whitened

    def update_weights(self, point: Float[np.ndarray, " unknown"]) -> None:
        """Set the weights by noise and the twin's expected errors at `point`."""
        objective = self._objective_at(point)
        linearization = linearize(objective, point[: self.n_unknowns])
        simulated = linearization.simulated
        expected = Discrepancy((), EXPECTED_ERROR, EXPECTED_ERROR, EXPECTED_ERROR)
        covariance = noise_covariance(linearization, expected)

        if self.roll_off:
            by_fault = point[self.severity] * self._difference(point, self.severity, simulated)
            error = self.roll_off * (objective.frequency / ROLL_OFF_FREQUENCY) ** 2 * by_fault
            covariance = covariance + np.outer(error, error)
        if self.port_timing:
            for port in _PORT_ANGLES:
                error = self.observables(point, port) - simulated
                covariance = covariance + np.outer(error, error)
        self.root = np.linalg.cholesky(covariance)

    def find_minima(
        self, starts: Iterable[np.ndarray] | None = None
    ) -> tuple[list[Minimum], float]:
        """Return minima of the sum of squares that are likely enough to hold the truth, the deepest
        first; and the misfit.

        The misfit is the root mean square of the lines' residuals at the first descent. If it
        exceeds 1, all standard deviations of lines are widened by it.

        Parameters
        ----------
        starts : starts of the descents; by default the best points of a first grid, or the best
            point without a fault if no fault can fit much better.
        """
        if starts is None:
            starts = self._find_starts()

        descents = []
        for start in starts:
            self.update_weights(start)
            point, height = self.descend(start, fixed=None)
            # each descent has its own weights, so heights alone do not compare
            loss = height + 2 * np.log(np.diag(self.root)).sum()
            descents.append((loss, point))
        points = [point for _, point in sorted(descents, key=lambda descent: descent[0])]

        for _ in range(_REWEIGHTING_ROUNDS):
            self.update_weights(points[0])
            points[0], height = self.descend(points[0], fixed=None)
        misfit = math.sqrt(height / len(self.root))
        # a twin that misses more than expected makes every line less certain
        self.root = self.root * max(misfit, 1.0)

        minima = [Minimum(*self.descend(point, fixed=None)) for point in points]
        return self.select_likely(minima), misfit

    def select_likely(self, minima: Iterable[Minimum]) -> list[Minimum]:
        """Return the minima that may hold the truth, each once, the deepest first."""
        deepest, *higher_minima = sorted(minima, key=lambda minimum: minimum.height)
        likely = [deepest]
        for minimum in higher_minima:
            dimensions = minimum.point[self.severity :]
            # several descents may end in one minimum
            is_repeated = any(
                np.allclose(dimensions, previous.point[self.severity :], rtol=0.02, atol=0.02)
                for previous in likely
            )
            if minimum.height - deepest.height < THRESHOLD and not is_repeated:
                likely.append(minimum)
        return likely

    def profile_severity(self, minima: list[Minimum]) -> tuple[list[Minimum], Ends]:
        """Return the minima that may hold the truth, the deepest first, and the ends of the
        severity's interval around all of them.

        A profile may walk into a valley that no descent reached. The search then goes on from its
        bottom.
        """
        profiles = [self.profile(minimum) for minimum in minima]
        for _ in range(_MAX_DEEPER_VALLEYS):
            deeper = self._find_deeper_valley(minima, profiles)
            if deeper is None:
                break
            minima = self.select_likely([deeper, *minima])
            profiles = [self.profile(minimum) for minimum in minima]

        low = high = float(minima[0].point[self.severity])
        for coordinate, height in profiles:
            rise = np.maximum(height - minima[0].height, 0.0)
            below, above = find_interval(coordinate, rise)
            low = min(low, below)
            high = max(high, above)
        return minima, (low, high)

    def _find_deeper_valley(
        self, minima: list[Minimum], profiles: list[tuple[np.ndarray, np.ndarray]]
    ) -> Minimum | None:
        """Return the minimum of a valley that a profile entered below the deepest one, if any."""
        lowest = int(np.argmin([height.min() for _, height in profiles]))
        coordinate, height = profiles[lowest]
        limit = minima[0].height - _MIN_DEPTH
        if height.min() > limit:
            return None

        # first along the valley's floor, so that the free descent cannot leave the valley
        start = minima[lowest].point.copy()
        start[self.severity] = coordinate[height.argmin()]
        start, _ = self.descend(start, fixed=self.severity)
        minimum = Minimum(*self.descend(start, fixed=None))
        if minimum.height >= limit:
            return None
        return minimum

    def profile(
        self, minimum: Minimum
    ) -> tuple[Float[np.ndarray, " point"], Float[np.ndarray, " point"]]:
        """Return severities over the reference's around a minimum, rising, and the minimum sum of
        squares over all other coordinates.
        """
        severity = float(minimum.point[self.severity])
        coordinate, rise = profile_likelihood(self, minimum.point, minimum.height, self.severity)
        rise_at_minimum = rise[int(np.searchsorted(coordinate, severity))]
        return coordinate, minimum.height + rise - rise_at_minimum

    def _fit_without_fault(self) -> Minimum:
        """Return the best point without the fault; the lines are weighted as there."""
        point = np.concatenate([self.prior.center, self.space.start])
        point[self.severity] = 0.0
        self.update_weights(point)
        return Minimum(*self.descend(point, fixed=self.severity))

    def _find_starts(self) -> list[np.ndarray]:
        """Return the starts of the descents."""
        without_fault = self._fit_without_fault()
        # a fault lowers the sum of squares by no more than the whole of it
        if without_fault.height <= self.threshold:
            self._limit_severity()
            return [without_fault.point]
        return self._grid_starts()

    def estimate_loss(self) -> float:
        """Return about the smallest -2 ln likelihood of the lines at any severity, without the
        terms that laws share.

        It is that of the best point of the first grid, if the lines change with all unknowns but
        the fault's dimensions as they do without a fault: no descent is needed.
        """
        without_fault = self._fit_without_fault()
        residual, slope = self.residuals_at(without_fault.point)
        other_slopes = slope[:, : self.n_unknowns]
        basis, _ = np.linalg.qr(other_slopes)
        simulated = self.observables(without_fault.point)

        def height(changes: np.ndarray) -> float:
            # what the other unknowns cannot take up
            changed = residual.copy()
            changed[: len(changes)] += changes
            return float(np.sum((changed - basis @ (basis.T @ changed)) ** 2))

        heights = [
            height(self.whiten(observables - simulated))
            for _, observables in self._simulate_grid(without_fault.point)
        ]
        lowest = min([without_fault.height, *heights])
        return lowest + 2 * float(np.log(np.diag(self.root)).sum())

    def _grid_starts(self) -> list[np.ndarray]:
        """Return the best points of the first grid that are clearly distinct."""
        grid_points = self._evaluate_grid()

        starts: list[np.ndarray] = []
        for _, point in sorted(grid_points, key=lambda pair: pair[0]):
            if all(self._are_distinct(point, start) for start in starts):
                starts.append(point)
            if len(starts) == MAX_STARTS:
                break
        return starts

    def _evaluate_grid(self) -> list[tuple[float, np.ndarray]]:
        """Return the sum of squares at each point of the first grid, with the point."""
        measured = self.objective.measured.numpy()
        sigma = self.objective.sigma.numpy()
        return [
            (float(np.sum(((observables - measured) / sigma) ** 2)), point)
            for point, observables in self._simulate_grid(self.prior.center)
        ]

    def _simulate_grid(self, other_unknowns: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return each point of the first grid with its observables [m/s^2].

        The grid spans the severity and the first further dimension.

        Parameters
        ----------
        other_unknowns : values and nuisances at all points.
        """
        dimension_grids = [
            2 * dimension.prior_std * np.linspace(-1, 1, self.grid_points)
            for dimension in self.space.free[1:2]
        ]
        fixed = np.zeros(max(0, len(self.space.free) - 2))

        grid: list[tuple[np.ndarray, np.ndarray]] = []
        for severity, *dimensions in product(SEVERITY_GRID, *dimension_grids):
            point = np.concatenate([other_unknowns, [severity], dimensions, fixed])
            try:
                observables = self.observables(point)
            except SwashTwinError:
                # no pump runs with a fault so severe: the search ends at the previous severity
                self.upper[self.severity] = SEVERITY_GRID[0]
                if grid:
                    self.upper[self.severity] = grid[-1][0][self.severity]
                break
            grid.append((point, observables))
        return grid

    def _limit_severity(self) -> None:
        """Lower the bound of the severity to one at which the pump runs."""
        point = np.concatenate([self.prior.center, self.space.start])
        for severity in reversed(SEVERITY_GRID):
            point[self.severity] = self.upper[self.severity] = severity
            try:
                self.observables(point)
            except SwashTwinError:
                continue
            return

    def _are_distinct(self, point: np.ndarray, start: np.ndarray) -> bool:
        """Return whether two points of the grid may descend into different valleys."""
        ratio = point[self.severity] / start[self.severity]
        dimension_change = np.abs(point[self.severity + 1 :] - start[self.severity + 1 :])
        return abs(math.log(ratio)) > 1 or bool((dimension_change > 0.05).any())

    def detection_limit(self, point: Float[np.ndarray, " unknown"]) -> float | None:
        """Return the minimum severity over the reference's that these lines distinguish from next
        to none; `None` if it lies beyond the search.

        Next to none, because a fault of several effects need not vanish with its severity.

        Parameters
        ----------
        point : the best one without a fault.
        """
        _, slope = self.residuals_at(point)
        other_slopes = np.delete(slope, self.severity, axis=1)
        nearly_healthy = point.copy()
        nearly_healthy[self.severity] = MIN_SEVERITY
        reference = self.observables(nearly_healthy)
        required = math.sqrt(self.threshold) + float(scipy.stats.norm.isf(ERROR_PROBABILITY))

        def surplus(log_severity: float) -> float:
            faulty_point = point.copy()
            faulty_point[self.severity] = np.exp(log_severity)
            change = np.zeros(len(slope))
            change[: len(reference)] = self.whiten(self.observables(faulty_point) - reference)
            # what no other coordinate can take up
            explained = other_slopes @ np.linalg.lstsq(other_slopes, change, rcond=None)[0]
            return float(np.linalg.norm(change - explained)) - required

        low = np.log(MIN_SEVERITY)
        high = np.log(self.upper[self.severity])
        if surplus(high) < 0:
            return None
        return float(np.exp(scipy.optimize.brentq(surplus, low, high, xtol=0.02)))

    def covariance_at(
        self, point: Float[np.ndarray, " unknown"]
    ) -> tuple[Float[np.ndarray, "unknown unknown"], float]:
        """Return the covariance of all coordinates, and the standard deviation of the severity
        (over the reference's) from recording to recording of one pump: what noise and drift do if
        all else stays.
        """
        _, slope = self.residuals_at(point)
        n_lines = len(self.root)
        covariance = np.linalg.pinv(slope.T @ slope)

        weights = covariance[self.severity] @ slope.T
        line_weights = weights[:n_lines]
        prior_weights = weights[n_lines : n_lines + self.n_unknowns]
        noise = np.concatenate([comparison.deviation for comparison in self.objective.comparisons])
        errors = scipy.linalg.solve_triangular(self.root, line_weights, lower=True, trans="T")
        drift = self.prior_root.T @ prior_weights
        variance = np.sum((errors * noise) ** 2) + drift @ self.prior.drift @ drift
        return covariance, float(np.sqrt(variance))
