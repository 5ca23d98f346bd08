"""What a twin lacks, estimated from the lines it misses.

A machine differs from every twin of it: its mounting is off, its housing bends, its slippers follow a recess in part.
Such errors are not noise. They are the same in every recording and shared by neighboring lines, so that fifty lines do
not average them away as fifty independent readings would. After Kennedy and O'Hagan (2001,
doi:10.1111/1467-9868.00294) measured minus simulated amplitudes are taken as noise plus a random function with the
covariance

    sum_k s_k^2 v_k v_k' + t_e^2 A E A + t_p^2 A P A + t_l^2 A^2

- v_k: change of the lines with the logarithm of a constant that was not searched (mounting, bearings, excitation,
  sensors), times the standard deviation of its prior;
- A: each line's amplitude, measured and simulated in the mean square, with a tenth of the loudest channel's for
  cross-talk;
- E: exp(-|f - f'| / 1 kHz) among lines of one condition, such as an excitation of another shape;
- P: the same among lines of one channel, such as gains and a housing that bends;
- and an error of each line's own.

The shares s_k, t_e, t_p, t_l are those most probable (restricted maximum likelihood, Patterson and Thompson 1971,
doi:10.1093/biomet/58.3.545: of the residuals, what no coordinate can take up) under half-normal densities of width 1
for the s_k and 0.1 for the others: zero where the twin meets the lines within what `Comparison.sigma` expects. What a
wrong twin hides in its coordinates without a trace in the residuals, nobody can estimate (Brynjarsdottir and O'Hagan
2014, doi:10.1088/0266-5611/30/11/114007): where it is known that a constant is uncertain, search it (`Nuisances`).
"""

from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg
import scipy.optimize
import torch
from jaxtyping import Float

from swashtwin.calibration.objective.spectrum_objective import Comparison, Objective
from swashtwin.calibration.objective.unknowns import SCALES, Nuisances

COHERENCE = 1000.0
"""Distance of two lines [Hz] at which their errors are correlated by 1/e; our estimate."""
CROSS_TALK = 0.1
"""Share of the loudest channel's line in the error of the others'; our estimate."""
RELATIVE_WIDTH = 0.1
"""Width of the half-normal density of the relative shares: twice the model error that `sigma` expects."""
CHANCE = 4.0
"""By how much -2 ln of the residuals' probability must fall before anything is said to lack: noise alone does so in a
tenth of all cases."""
SHARES = (1e-4, 5.0)
"""Within which shares are sought."""
CONSTANTS = Nuisances.usual()
"""Priors of the constants, where they are not searched."""


@dataclass(frozen=True, eq=False)
class Linearized:
    """An objective around one point."""

    objective: Objective
    """The objective."""
    point: Float[np.ndarray, " unknown"]
    """Where it was linearized."""
    residual: Float[np.ndarray, " reading"]
    """Measured minus simulated reading [m/s^2]."""
    slope: Float[np.ndarray, "reading unknown"]
    """Derivatives of the simulated readings."""
    sigma: Float[np.ndarray, " reading"]
    """Standard deviation without what the twin lacks [m/s^2]."""

    @property
    def simulated(self) -> Float[np.ndarray, " reading"]:
        """Simulated readings [m/s^2]."""
        return self.objective.measured.numpy() - self.residual


def linearized(objective: Objective, point: Float[np.ndarray, " unknown"]) -> Linearized:
    """`objective` around `point`, with exact derivatives."""
    readings, slope = objective.sensitivity(torch.as_tensor(point))
    residual = (objective.measured - readings).numpy()
    return Linearized(objective, point, residual, slope.numpy(), objective.sigma.numpy())


@dataclass(frozen=True)
class Discrepancy:
    """How much a twin lacks, as shares of what each cause would do."""

    constants: tuple[tuple[str, float], ...]
    """Standard deviation of the logarithm of each constant that was not searched, as the lines show it."""
    excitation: float
    """Relative error that all channels of a condition share."""
    path: float
    """Relative error that the lines of a channel share."""
    line: float
    """Relative error of each line's own."""


def discrepancy_of(around: Linearized) -> Discrepancy:
    """What the residuals say the twin lacks; nothing where there are no more readings than coordinates."""
    names = _held(around.objective)
    width = np.array([1.0] * len(names) + [RELATIVE_WIDTH] * 3)
    found = np.zeros(len(width))
    if around.slope.shape[0] > around.slope.shape[1]:
        blind = scipy.linalg.qr(around.slope / around.sigma[:, None])[0][:, around.slope.shape[1] :]
        scaled = blind / around.sigma[:, None]
        parts = [scaled.T @ part @ scaled for part in _parts(around, names)]
        found = _most_probable(scaled.T @ around.residual, parts, width)
    prior = [getattr(CONSTANTS, name) for name in names]
    constants = tuple((name, float(s * d)) for name, s, d in zip(names, found, prior, strict=False))
    excitation, path, line = (float(share) for share in found[len(names) :])
    return Discrepancy(constants, excitation, path, line)


def _most_probable(residual: np.ndarray, parts: list[np.ndarray], width: np.ndarray) -> np.ndarray:
    """Shares at which the residual, with unit noise, is most probable; `width` is that of their half-normal priors."""
    unit = np.eye(len(residual))

    def loss(logarithm: np.ndarray) -> tuple[float, np.ndarray]:
        variance = np.exp(2 * logarithm)
        factor = scipy.linalg.cho_factor(unit + sum(v * part for v, part in zip(variance, parts, strict=True)))
        weighted, inverse = scipy.linalg.cho_solve(factor, residual), scipy.linalg.cho_solve(factor, unit)
        value = 2 * np.log(np.diag(factor[0])).sum() + residual @ weighted + (variance / width**2).sum()
        slope = [np.vdot(inverse, part) - weighted @ part @ weighted for part in parts]
        return float(value), 2 * variance * (np.array(slope) + 1 / width**2)

    bounds = [tuple(np.log(SHARES))] * len(parts)
    start = np.log(0.5 * width)
    result = scipy.optimize.minimize(loss, start, jac=True, method="L-BFGS-B", bounds=bounds)
    found: np.ndarray = np.exp(result.x)
    if residual @ residual - result.fun < CHANCE:
        return np.zeros_like(found)
    return np.where(found > 2 * SHARES[0], found, 0.0)


def noise_covariance(around: Linearized, lacking: Discrepancy) -> Float[np.ndarray, "reading reading"]:
    """Covariance of measured minus simulated readings [(m/s^2)^2]: noise, and what the twin lacks."""
    names = [name for name, _ in lacking.constants]
    shares = [share / getattr(CONSTANTS, name) for name, share in lacking.constants]
    shares += [lacking.excitation, lacking.path, lacking.line]
    parts = _parts(around, names)
    return np.diag(around.sigma**2) + sum(s**2 * part for s, part in zip(shares, parts, strict=True))


def _held(objective: Objective) -> list[str]:
    """Constants that were not searched and matter here."""
    forced = objective.twin.fault is not None
    return [name for name in SCALES if name not in objective.unknowns.scales and (forced or name != "excitation")]


def _parts(around: Linearized, names: list[str]) -> list[np.ndarray]:
    """Covariance of each cause at a share of 1."""
    objective = around.objective
    held = [np.outer(one, one) for one in _constant_slopes(objective, around.point, names)]
    comparisons = objective.comparisons
    frequency = np.concatenate([np.tile(_frequency(one), len(one.measured)) for one in comparisons])
    place = np.concatenate([np.full(one.measured.numel(), i) for i, one in enumerate(comparisons)])
    channel = np.concatenate([np.repeat(one.measurement.channels, one.measured.shape[1]) for one in comparisons])
    level, turned = _levels(objective, around.simulated)
    alike = np.outer(level, level) + np.outer(turned, turned)
    near = np.exp(-np.abs(frequency[:, None] - frequency) / COHERENCE) * alike
    return [
        *held,
        near * (place[:, None] == place),
        near * (channel[:, None] == channel),
        np.diag(level**2 + turned**2),
    ]


def _frequency(comparison: Comparison) -> np.ndarray:
    """Frequency [Hz] of each reading of a channel."""
    lines = comparison.measurement.orders * comparison.twin.condition.shaft_frequency
    return np.tile(lines, 2) if comparison.has_phases else lines


def _levels(objective: Objective, simulated: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What an error of 1 does to each reading [m/s^2]: one in phase with the line, and one a quarter turn ahead of it.

    Amplitudes know only the first. A line's level is the mean of the simulated and the measured one, and a share of
    the loudest channel's.
    """
    levels, ahead, first = [], [], 0
    for one in objective.comparisons:
        own = simulated[first : first + one.measured.numel()].reshape(one.measured.shape)
        count = len(one.measurement.orders)
        line = own[:, :count] + 1j * own[:, count:] if one.has_phases else own.astype(complex)
        square = (np.abs(line) ** 2 + one.measurement.amplitude**2) / 2
        level = np.sqrt(square + CROSS_TALK**2 * square.max(axis=0)) * np.exp(1j * np.angle(line))
        parts = (level.real, level.imag) if one.has_phases else (np.abs(level),)
        quarter = (-level.imag, level.real) if one.has_phases else (np.zeros_like(own),)
        levels.append(np.concatenate(parts, axis=1).reshape(-1))
        ahead.append(np.concatenate(quarter, axis=1).reshape(-1))
        first += own.size
    return np.concatenate(levels), np.concatenate(ahead)


def _constant_slopes(objective: Objective, point: np.ndarray, names: list[str]) -> np.ndarray:
    """Change of the lines [m/s^2] by one prior standard deviation of each constant."""
    if not names:
        return np.empty((0, len(objective.measured)))
    unknowns, step = objective.unknowns, 1e-4
    rows = []
    for name in names:
        moved = unknowns.own_scales.copy()
        moved[SCALES.index(name)] += step
        other = replace(objective, unknowns=replace(unknowns, own_scales=moved))
        with torch.no_grad():
            pair = [one.readings(torch.as_tensor(point)).numpy() for one in (other, objective)]
        rows.append((pair[0] - pair[1]) / step * getattr(CONSTANTS, name))
    return np.stack(rows)
