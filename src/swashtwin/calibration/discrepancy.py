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
- E: exp(-|f - f'| / 1 kHz) among lines of one operating point, such as an excitation of another
  shape;
- P: the same among lines of one channel, such as gains and a housing that bends;
- and an independent error of each line.

The shares s_k, t_e, t_p, t_l are those most probable (restricted maximum likelihood, Patterson and
Thompson 1971, doi:10.1093/biomet/58.3.545: of the residuals, what no coordinate can take up) under
half-normal densities of width 1 for the s_k and 0.1 for the others: zero if the twin meets the
lines within what `Comparison.sigma` expects. What a wrong twin hides in its coordinates without a
trace in the residuals, nobody can estimate (Brynjarsdottir and O'Hagan 2014,
doi:10.1088/0266-5611/30/11/114007): if a constant is known to be uncertain, search it
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
from swashtwin.calibration.unknowns import SCALE_NAMES, Nuisances

CORRELATION_DISTANCE_HZ = 1000.0
"""Distance of two lines at which their errors are correlated by 1/e; our estimate."""
CROSS_TALK_SHARE = 0.1
"""Share of the loudest channel's line in the error of the others'; our estimate."""
RELATIVE_SHARE_WIDTH = 0.1
"""Width of the half-normal density of the relative shares: twice the model error that `sigma`
expects.
"""
MIN_LIKELIHOOD_GAIN = 4.0
"""Fall of -2 ln of the residuals' probability from which a discrepancy is reported: noise alone
reaches it in a tenth of all cases.
"""
SHARE_LIMITS = (1e-4, 5.0)
"""Bounds of the search for the shares."""
CONSTANT_PRIORS = Nuisances.typical()
"""Priors of the constants that are not searched."""
UNCERTAIN_CONSTANTS = ("mount", "bearing", "excitation", "sensor")
"""Constants that count as uncertain even if they are not searched."""

# Step of the differences of the lines with respect to the logarithm of a constant.
_SLOPE_STEP = 1e-4


@dataclass(frozen=True, eq=False)
class Linearization:
    """An objective around one point."""

    objective: Objective
    """The objective."""
    point: Float[np.ndarray, " unknown"]
    """The point."""
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
    """Return `objective` linearized around `point`, with exact derivatives."""
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
    """Relative error that all channels of an operating point share."""
    path: float
    """Relative error that the lines of a channel share."""
    line: float
    """Relative error that each line has independently."""


def estimate_discrepancy(linearization: Linearization) -> Discrepancy:
    """Return the discrepancy that the residuals show.

    It is zero if there are no more observables than coordinates.
    """
    searched = linearization.objective.unknowns.scales
    has_fault = linearization.objective.twin.fault is not None
    names = [
        name
        for name in UNCERTAIN_CONSTANTS
        if name not in searched and (has_fault or name != "excitation")
    ]
    width = np.array([1.0] * len(names) + [RELATIVE_SHARE_WIDTH] * 3)

    n_observables, n_unknowns = linearization.slope.shape
    shares = np.zeros(len(width))
    if n_observables > n_unknowns:
        # the directions of the residuals that no coordinate can take up
        scaled_slope = linearization.slope / linearization.sigma[:, None]
        blind = scipy.linalg.qr(scaled_slope)[0][:, n_unknowns:]
        projection = blind / linearization.sigma[:, None]
        parts = [
            projection.T @ part @ projection for part in _cause_covariances(linearization, names)
        ]
        shares = _most_probable_shares(projection.T @ linearization.residual, parts, width)

    constants = tuple(
        (name, float(share * getattr(CONSTANT_PRIORS, name)))
        for name, share in zip(names, shares, strict=False)
    )
    excitation, path, line = (float(share) for share in shares[len(names) :])
    return Discrepancy(constants, excitation, path, line)


def _most_probable_shares(
    residual: np.ndarray, parts: list[np.ndarray], width: np.ndarray
) -> np.ndarray:
    """Return the shares at which the residual, with unit noise, is most probable.

    Parameters
    ----------
    parts : covariance of each cause at a share of 1.
    width : width of the half-normal prior of each share.
    """
    unit = np.eye(len(residual))

    def loss(log_shares: np.ndarray) -> tuple[float, np.ndarray]:
        variance = np.exp(2 * log_shares)
        covariance = unit + sum(v * part for v, part in zip(variance, parts, strict=True))
        factor = scipy.linalg.cho_factor(covariance)
        weighted = scipy.linalg.cho_solve(factor, residual)
        inverse = scipy.linalg.cho_solve(factor, unit)

        log_determinant = 2 * np.log(np.diag(factor[0])).sum()
        value = log_determinant + residual @ weighted + (variance / width**2).sum()
        slope = [np.vdot(inverse, part) - weighted @ part @ weighted for part in parts]
        return float(value), 2 * variance * (np.array(slope) + 1 / width**2)

    bounds = [tuple(np.log(SHARE_LIMITS))] * len(parts)
    start = np.log(0.5 * width)
    result = scipy.optimize.minimize(loss, start, jac=True, method="L-BFGS-B", bounds=bounds)

    shares: np.ndarray = np.exp(result.x)
    if residual @ residual - result.fun < MIN_LIKELIHOOD_GAIN:
        return np.zeros_like(shares)
    # a share at its lower limit is zero: the logarithm that was searched cannot reach it
    return np.where(shares > 2 * SHARE_LIMITS[0], shares, 0.0)


def noise_covariance(
    linearization: Linearization, discrepancy: Discrepancy
) -> Float[np.ndarray, "observable observable"]:
    """Return the covariance of measured minus simulated observables [(m/s^2)^2]: noise, and what
    the twin lacks.
    """
    names = [name for name, _ in discrepancy.constants]
    shares = [std / getattr(CONSTANT_PRIORS, name) for name, std in discrepancy.constants]
    shares += [discrepancy.excitation, discrepancy.path, discrepancy.line]

    noise = np.diag(linearization.sigma**2) + _repeated_errors(linearization)
    if any(shares):
        parts = _cause_covariances(linearization, names)
        noise = noise + sum(share**2 * part for share, part in zip(shares, parts, strict=True))
    return noise


def _repeated_errors(linearization: Linearization) -> np.ndarray:
    """Return the covariance between comparisons at one operating point, which are of recordings
    with different sensors.

    For a channel and line that two of them have, the error that `Comparison.sigma` allows the twin
    is the same.
    """
    comparisons = linearization.objective.comparisons
    sigma = linearization.sigma
    noise = np.zeros((len(sigma), len(sigma)))
    conditions = [comparison.twin.condition for comparison in comparisons]
    # errors at different operating points count as independent
    if len(set(conditions)) == len(conditions):
        return noise

    in_phase, quadrature = _unit_errors(linearization.objective, linearization.simulated)
    deviation = np.concatenate([comparison.deviation for comparison in comparisons])
    twin_error = np.sqrt(np.maximum(sigma**2 - deviation**2, 0.0))
    share = twin_error / np.hypot(in_phase, quadrature)
    in_phase = in_phase * share
    quadrature = quadrature * share

    ends = np.cumsum([comparison.measured.numel() for comparison in comparisons])[:-1]
    pairs = zip(np.split(np.arange(len(noise)), ends), comparisons, strict=True)
    for (rows, first), (columns, second) in combinations(pairs, 2):
        if first.twin.condition != second.twin.condition:
            continue
        is_same_line = _line_names(first)[:, None] == _line_names(second)
        covariance = np.outer(in_phase[rows], in_phase[columns]) + np.outer(
            quadrature[rows], quadrature[columns]
        )
        block = is_same_line * covariance
        noise[np.ix_(rows, columns)] = block
        noise[np.ix_(columns, rows)] = block.T
    return noise


def _line_names(comparison: Comparison) -> np.ndarray:
    """Return the channel and order of each observable."""
    orders = np.tile(comparison.measurement.orders, 2 if comparison.has_phases else 1)
    names = []
    for channel in comparison.measurement.channels:
        names += [f"{order} {channel}" for order in orders]
    return np.array(names)


def _cause_covariances(linearization: Linearization, names: list[str]) -> list[np.ndarray]:
    """Return the covariance of each cause at a share of 1.

    The constants of `names` come first, then excitation, path and single lines.
    """
    objective = linearization.objective
    comparisons = objective.comparisons
    # a constant changes all lines together, so its covariance has rank one
    constants = [
        np.outer(slope, slope) for slope in _constant_slopes(objective, linearization.point, names)
    ]

    condition = np.concatenate(
        [np.full(comparison.measured.numel(), i) for i, comparison in enumerate(comparisons)]
    )
    channel = np.concatenate(
        [
            np.repeat(comparison.measurement.channels, comparison.measured.shape[1])
            for comparison in comparisons
        ]
    )
    in_phase, quadrature = _unit_errors(objective, linearization.simulated)
    distance = np.abs(objective.frequency[:, None] - objective.frequency)
    similarity = np.outer(in_phase, in_phase) + np.outer(quadrature, quadrature)
    covariance = np.exp(-distance / CORRELATION_DISTANCE_HZ) * similarity
    return [
        *constants,
        covariance * (condition[:, None] == condition),
        covariance * (channel[:, None] == channel),
        np.diag(in_phase**2 + quadrature**2),
    ]


def _unit_errors(objective: Objective, simulated: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the effect of a relative error of 1 on each observable [m/s^2]: in phase with the
    line, and a quarter turn ahead of it.

    Amplitudes are sensitive to the first only. The size of a line is the mean of the simulated and
    the measured one, and a share of the loudest channel's.
    """
    in_phase = []
    quadrature = []
    start = 0
    for comparison in objective.comparisons:
        shape = comparison.measured.shape
        observables = simulated[start : start + comparison.measured.numel()].reshape(shape)
        start += observables.size

        count = len(comparison.measurement.orders)
        if comparison.has_phases:
            lines = observables[:, :count] + 1j * observables[:, count:]
        else:
            lines = observables.astype(complex)
        square = (np.abs(lines) ** 2 + comparison.measurement.amplitude**2) / 2
        size = np.sqrt(square + CROSS_TALK_SHARE**2 * square.max(axis=0))
        error = size * np.exp(1j * np.angle(lines))

        if comparison.has_phases:
            in_phase.append(np.concatenate([error.real, error.imag], axis=1).reshape(-1))
            quadrature.append(np.concatenate([-error.imag, error.real], axis=1).reshape(-1))
        else:
            in_phase.append(np.abs(error).reshape(-1))
            quadrature.append(np.zeros(observables.size))
    return np.concatenate(in_phase), np.concatenate(quadrature)


def _constant_slopes(objective: Objective, point: np.ndarray, names: list[str]) -> np.ndarray:
    """Return the change of the lines [m/s^2] by one prior standard deviation of each constant."""
    if not names:
        return np.empty((0, len(objective.measured)))

    unknowns = objective.unknowns
    coordinates = torch.as_tensor(point)
    rows = []
    with torch.no_grad():
        for name in names:
            moved_scales = unknowns.twin_scales.copy()
            moved_scales[SCALE_NAMES.index(name)] += _SLOPE_STEP
            moved = replace(objective, unknowns=replace(unknowns, twin_scales=moved_scales))
            change = moved.observables(coordinates) - objective.observables(coordinates)
            rows.append(change.numpy() / _SLOPE_STEP * getattr(CONSTANT_PRIORS, name))
    return np.stack(rows)
