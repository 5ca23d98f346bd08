"""What a twin lacks, estimated from the lines it misses.

A machine differs from every twin of it: its mounting is off, its housing bends, its slippers follow
a recess in part. Such errors are not noise. They are the same in every recording and shared by
neighboring lines, so that fifty lines do not average them away as fifty independent ones would.
After Kennedy and O'Hagan (2001, doi:10.1111/1467-9868.00294) measured minus simulated amplitudes
are taken as noise plus a random function with the covariance

    sum_k s_k^2 v_k v_k' + t_e^2 A E A + t_p^2 A P A + t_l^2 A^2

- v_k: change of the lines with the logarithm of a constant that was not searched (mounting,
  bearings, excitation, sensors), times the standard deviation of its prior;
- A: each line's amplitude, measured and simulated in the mean square, with a tenth of the loudest
  channel's for cross-talk;
- E: exp(-|f - f'| / 1 kHz) among lines of one condition, such as an excitation of another shape;
- P: the same among lines of one channel, such as gains and a housing that bends;
- and an error of each line's own.

The shares s_k, t_e, t_p, t_l are those most probable (restricted maximum likelihood, Patterson and
Thompson 1971, doi:10.1093/biomet/58.3.545: of the residuals, what no coordinate can take up) under
half-normal densities of width 1 for the s_k and 0.1 for the others: zero where the twin meets the
lines within what `Comparison.sigma` expects. What a wrong twin hides in its coordinates without a
trace in the residuals, nobody can estimate (Brynjarsdottir and O'Hagan 2014,
doi:10.1088/0266-5611/30/11/114007): where it is known that a constant is uncertain, search it
(`Nuisances`).
"""

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
import scipy.linalg
import scipy.optimize
import torch
from jaxtyping import Float

from swashtwin.calibration.spectrum_objective import Comparison, Objective
from swashtwin.calibration.unknowns import SCALES, Nuisances

COHERENCE = 1000.0
"""Distance of two lines [Hz] at which their errors are correlated by 1/e; our estimate."""
CROSS_TALK = 0.1
"""Share of the loudest channel's line in the error of the others'; our estimate."""
RELATIVE_WIDTH = 0.1
"""Width of the half-normal density of the relative shares: twice the model error that `sigma`
expects.
"""
CHANCE = 4.0
"""By how much -2 ln of the residuals' probability must fall before a discrepancy is stated: noise
alone does so in a tenth of all cases.
"""
SHARES = (1e-4, 5.0)
"""Within which shares are sought."""
CONSTANTS = Nuisances.typical()
"""Priors of the constants, where they are not searched."""
COMMON = ("mount", "bearing", "excitation", "sensor")
"""Constants that count as uncertain even where they are not searched."""


@dataclass(frozen=True, eq=False)
class Linearization:
    """An objective around one point."""

    objective: Objective
    """The objective."""
    point: Float[np.ndarray, " unknown"]
    """Where it was linearized."""
    residual: Float[np.ndarray, " observable"]
    """Measured minus simulated observable [m/s^2]."""
    slope: Float[np.ndarray, "observable unknown"]
    """Derivatives of the simulated observables."""
    sigma: Float[np.ndarray, " observable"]
    """Standard deviation without what the twin lacks [m/s^2]."""

    @property
    def simulated(self) -> Float[np.ndarray, " observable"]:
        """Simulated observables [m/s^2]."""
        return self.objective.measured.numpy() - self.residual


def linearize(objective: Objective, point: Float[np.ndarray, " unknown"]) -> Linearization:
    """`objective` around `point`, with exact derivatives."""
    observables, slope = objective.sensitivity(torch.as_tensor(point))
    residual = (objective.measured - observables).numpy()
    return Linearization(objective, point, residual, slope.numpy(), objective.sigma.numpy())


@dataclass(frozen=True)
class Discrepancy:
    """How much a twin lacks, as shares of what each cause would do."""

    constants: tuple[tuple[str, float], ...]
    """Standard deviation of the logarithm of each constant that was not searched, as the lines show
    it.
    """
    excitation: float
    """Relative error that all channels of a condition share."""
    path: float
    """Relative error that the lines of a channel share."""
    line: float
    """Relative error of each line's own."""


def estimate_discrepancy(around: Linearization) -> Discrepancy:
    """Discrepancy that the residuals show; none where there are no more observables than
    coordinates.
    """
    forced, searched = around.objective.twin.fault is not None, around.objective.unknowns.scales
    names = [name for name in COMMON if name not in searched and (forced or name != "excitation")]
    width = np.array([1.0] * len(names) + [RELATIVE_WIDTH] * 3)
    shares = np.zeros(len(width))
    if around.slope.shape[0] > around.slope.shape[1]:
        blind = scipy.linalg.qr(around.slope / around.sigma[:, None])[0][:, around.slope.shape[1] :]
        scaled = blind / around.sigma[:, None]
        parts = [scaled.T @ part @ scaled for part in _parts(around, names)]
        shares = _most_probable(scaled.T @ around.residual, parts, width)
    prior = [getattr(CONSTANTS, name) for name in names]
    constants = tuple(
        (name, float(s * d)) for name, s, d in zip(names, shares, prior, strict=False)
    )
    excitation, path, line = (float(share) for share in shares[len(names) :])
    return Discrepancy(constants, excitation, path, line)


def _most_probable(residual: np.ndarray, parts: list[np.ndarray], width: np.ndarray) -> np.ndarray:
    """Shares at which the residual, with unit noise, is most probable; `width` is that of their
    half-normal priors.
    """
    unit = np.eye(len(residual))

    def loss(logarithm: np.ndarray) -> tuple[float, np.ndarray]:
        variance = np.exp(2 * logarithm)
        factor = scipy.linalg.cho_factor(
            unit + sum(v * part for v, part in zip(variance, parts, strict=True))
        )
        weighted, inverse = (
            scipy.linalg.cho_solve(factor, residual),
            scipy.linalg.cho_solve(factor, unit),
        )
        value = (
            2 * np.log(np.diag(factor[0])).sum() + residual @ weighted + (variance / width**2).sum()
        )
        slope = [np.vdot(inverse, part) - weighted @ part @ weighted for part in parts]
        return float(value), 2 * variance * (np.array(slope) + 1 / width**2)

    bounds = [tuple(np.log(SHARES))] * len(parts)
    start = np.log(0.5 * width)
    result = scipy.optimize.minimize(loss, start, jac=True, method="L-BFGS-B", bounds=bounds)
    shares: np.ndarray = np.exp(result.x)
    if residual @ residual - result.fun < CHANCE:
        return np.zeros_like(shares)
    return np.where(shares > 2 * SHARES[0], shares, 0.0)


def noise_covariance(
    around: Linearization, discrepancy: Discrepancy
) -> Float[np.ndarray, "observable observable"]:
    """Covariance of measured minus simulated observables [(m/s^2)^2]: noise, and what the twin
    lacks.
    """
    names = [name for name, _ in discrepancy.constants]
    shares = [share / getattr(CONSTANTS, name) for name, share in discrepancy.constants]
    shares += [discrepancy.excitation, discrepancy.path, discrepancy.line]
    noise = np.diag(around.sigma**2) + _repeated_errors(around)
    if any(shares):
        noise = noise + sum(
            s**2 * part for s, part in zip(shares, _parts(around, names), strict=True)
        )
    return noise


def _repeated_errors(around: Linearization) -> np.ndarray:
    """Covariance between comparisons at one operating point, which are of recordings with different
    sensors.

    In a channel and line that two of them have, the error that `Comparison.sigma` allows the twin
    is the same.
    """
    comparisons = around.objective.comparisons
    noise = np.zeros((len(around.sigma), len(around.sigma)))
    conditions = [comparison.twin.condition for comparison in comparisons]
    if len(set(conditions)) == len(conditions):
        return noise
    level, quarter = _levels(around.objective, around.simulated)
    deviation = np.concatenate([comparison.deviation for comparison in comparisons])
    error = np.sqrt(np.maximum(around.sigma**2 - deviation**2, 0.0)) / np.hypot(level, quarter)
    level, quarter = level * error, quarter * error
    ends = np.cumsum([comparison.measured.numel() for comparison in comparisons])[:-1]
    pairs = zip(np.split(np.arange(len(noise)), ends), comparisons, strict=True)
    for (rows, first), (columns, second) in combinations(pairs, 2):
        if first.twin.condition == second.twin.condition:
            is_same = _line_names(first)[:, None] == _line_names(second)
            block = np.outer(level[rows], level[columns]) + np.outer(
                quarter[rows], quarter[columns]
            )
            noise[np.ix_(rows, columns)], noise[np.ix_(columns, rows)] = (
                is_same * block,
                (is_same * block).T,
            )
    return noise


def _line_names(comparison: Comparison) -> np.ndarray:
    """Channel and order of each observable."""
    orders = np.tile(comparison.measurement.orders, 2 if comparison.has_phases else 1)
    return np.array(
        [f"{order} {channel}" for channel in comparison.measurement.channels for order in orders]
    )


def _parts(around: Linearization, names: list[str]) -> list[np.ndarray]:
    """Covariance of each cause at a share of 1."""
    objective = around.objective
    constants = [
        np.outer(slope, slope) for slope in _constant_slopes(objective, around.point, names)
    ]
    comparisons = objective.comparisons
    frequency = objective.frequency
    condition = np.concatenate(
        [np.full(comparison.measured.numel(), i) for i, comparison in enumerate(comparisons)]
    )
    channel = np.concatenate(
        [
            np.repeat(comparison.measurement.channels, comparison.measured.shape[1])
            for comparison in comparisons
        ]
    )
    level, quarter = _levels(objective, around.simulated)
    similarity = np.outer(level, level) + np.outer(quarter, quarter)
    nearness = np.exp(-np.abs(frequency[:, None] - frequency) / COHERENCE) * similarity
    return [
        *constants,
        nearness * (condition[:, None] == condition),
        nearness * (channel[:, None] == channel),
        np.diag(level**2 + quarter**2),
    ]


def _levels(objective: Objective, simulated: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Effect of an error of 1 on each observable [m/s^2]: one in phase with the line, and one a
    quarter turn ahead of it.

    Amplitudes know only the first. A line's level is the mean of the simulated and the measured
    one, and a share of the loudest channel's.
    """
    levels, quarters, first = [], [], 0
    for comparison in objective.comparisons:
        lines = simulated[first : first + comparison.measured.numel()].reshape(
            comparison.measured.shape
        )
        count = len(comparison.measurement.orders)
        line = (
            lines[:, :count] + 1j * lines[:, count:]
            if comparison.has_phases
            else lines.astype(complex)
        )
        square = (np.abs(line) ** 2 + comparison.measurement.amplitude**2) / 2
        level = np.sqrt(square + CROSS_TALK**2 * square.max(axis=0)) * np.exp(1j * np.angle(line))
        parts = (level.real, level.imag) if comparison.has_phases else (np.abs(level),)
        ahead = (-level.imag, level.real) if comparison.has_phases else (np.zeros_like(lines),)
        levels.append(np.concatenate(parts, axis=1).reshape(-1))
        quarters.append(np.concatenate(ahead, axis=1).reshape(-1))
        first += lines.size
    return np.concatenate(levels), np.concatenate(quarters)


def _constant_slopes(objective: Objective, point: np.ndarray, names: list[str]) -> np.ndarray:
    """Change of the lines [m/s^2] by one prior standard deviation of each constant."""
    if not names:
        return np.empty((0, len(objective.measured)))
    unknowns, step = objective.unknowns, 1e-4
    rows = []
    for name in names:
        moved = unknowns.twin_scales.copy()
        moved[SCALES.index(name)] += step
        other = replace(objective, unknowns=replace(unknowns, twin_scales=moved))
        with torch.no_grad():
            pair = [
                shifted.observables(torch.as_tensor(point)).numpy()
                for shifted in (other, objective)
            ]
        rows.append((pair[0] - pair[1]) / step * getattr(CONSTANTS, name))
    return np.stack(rows)
