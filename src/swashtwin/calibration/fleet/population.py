"""What pumps of one type have in common, learned from recordings of several.

The logarithms of pump i's values (and of the constants searched beside them) are taken as draws x_i from a normal
density with a mean m and, each on its own, a spread s: x_i ~ N(m, diag(s)^2). What the recordings of pump i say, its
prior left out, is a quadratic function around the point found (Laplace): ln likelihood = -x' L_i x / 2 + b_i' x, where
L_i may be singular: a value that no recording tells of is left to the other pumps. Then m and all x_i integrate out
exactly, with the prior of a single pump as that of m, and the spreads are the most probable ones under half-normal
densities, in ln s: that keeps them off zero, where a mode in s itself would end with few pumps (Chung, Rabe-Hesketh,
Dorie, Gelman and Liu 2013, doi:10.1007/s11336-013-9328-2). Only the spreads are plugged in as if they were known; with
two or three pumps their intervals are wide.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy.optimize
import torch
from jaxtyping import Float
from torch import Tensor

from swashtwin.calibration.objective.unknowns import Unknowns
from swashtwin.calibration.uncertainty.posterior import QUANTILE
from swashtwin.foundation import ArtifactError, InputError, MissingFileError, parse_json, read_text, write_text
from swashtwin.recordings import Manifest, join_manifests

FORMAT = "swashtwin population 1"
SPREAD_WIDTH = 0.5
"""Width of the half-normal density of a spread: pumps of one type seldom differ by more than a factor of e. A constant
searched beside the six values has the deviation of its own prior, if that is less. Our estimate."""
LEAST_SPREAD = 1e-3
"""Least spread that is sought."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """Evidence of one pump's recordings on its coordinates x: ln likelihood = -x' information x / 2 + push' x."""

    information: Float[np.ndarray, "unknown unknown"]
    """Fisher information of the coordinates, without any prior."""
    push: Float[np.ndarray, " unknown"]
    """Information times the coordinates that would fit best."""


@dataclass(frozen=True, eq=False)
class Population:
    """Density of the coordinates among pumps of one type: the prior of another pump."""

    specimens: tuple[str, ...]
    """Pumps it was learned from."""
    names: tuple[str, ...]
    """Coordinates, as in `Unknowns.names`: logarithms of the six values by letter, then of constants."""
    mean: Float[np.ndarray, " unknown"]
    """Mean of each coordinate over the pumps."""
    mean_covariance: Float[np.ndarray, "unknown unknown"]
    """Covariance of that mean about the type's true one, the twin's discrepancy in all pumps included."""
    spread: Float[np.ndarray, " unknown"]
    """Standard deviation of each coordinate from pump to pump: 0.2 is 20 %."""
    spread_interval: Float[np.ndarray, "unknown 2"]
    """Range that holds the spread with a probability of 90 %."""
    manifest: Manifest = field(default_factory=dict)
    """Recordings that it was learned from, by id and content."""
    pump: str = ""
    """Name of their design; empty in files that do not say."""

    @property
    def mean_std(self) -> Float[np.ndarray, " unknown"]:
        """Standard deviation of the mean."""
        return np.sqrt(np.diag(self.mean_covariance))

    @property
    def deviation(self) -> Float[np.ndarray, " unknown"]:
        """Standard deviation of the coordinates of another pump of the type: the spread, and how well the mean is
        known."""
        return np.sqrt(self.spread**2 + np.diag(self.mean_covariance))

    def require_pump(self, pump: str) -> None:
        """Raise an `InputError` if it is of another design than `pump`, a name."""
        if self.pump and self.pump != pump:
            raise InputError(
                f"the population is of pumps {self.pump}, not {pump}; calibrate several pumps of this design together "
                "(twin calibrate-fleet), or leave the population out."
            )

    def prior_of(self, unknowns: Unknowns) -> Unknowns:
        """`unknowns` with this density as their prior; coordinates that the population lacks keep theirs.

        No prior becomes wider than it was, and its mean stays within the bounds.

        Raises
        ------
        InputError
            It knows none of them.
        """
        common = [name for name in unknowns.names if name in self.names]
        if not common:
            raise InputError(f"the population knows {', '.join(self.names)}, none of which is searched.")
        rows = [self.names.index(name) for name in common]
        indices = [unknowns.names.index(name) for name in common]
        center, deviation = unknowns.center.copy(), unknowns.deviation.copy()
        center[indices] = self.mean[rows]
        deviation[indices] = np.minimum(deviation[indices], self.deviation[rows])
        return replace(unknowns, center=np.clip(center, unknowns.lower, unknowns.upper), deviation=deviation)

    def to_dict(self) -> dict[str, Any]:
        """All of it as JSON can hold it; `load_population` reads it back."""
        arrays = {name: value.tolist() for name, value in vars(self).items() if isinstance(value, np.ndarray)}
        names = {"specimens": list(self.specimens), "names": list(self.names), "manifest": dict(self.manifest)}
        return {"format": FORMAT, "pump": self.pump, **names, **arrays}

    def save(self, path: Path | str) -> Path:
        """`path`, after the population was written to it as JSON."""
        return write_text(Path(path), json.dumps(self.to_dict(), indent=1, ensure_ascii=False) + "\n")


def load_population(path: Path | str) -> Population:
    """Population that `Population.save` wrote.

    Raises
    ------
    MissingFileError
        No such file.
    ArtifactError
        It is damaged, or of another version.
    """
    path = Path(path)
    if not path.is_file():
        raise MissingFileError(f"{path}: no such population.")
    try:
        return _population(parse_json(read_text(path)))
    except (KeyError, TypeError, ValueError, AttributeError, ArithmeticError, RecursionError) as cause:
        raise ArtifactError(f"{path}: not a population, or a damaged one: {str(cause)[:300]}.") from cause


def _population(table: Mapping[str, Any]) -> Population:
    if table["format"] != FORMAT:
        raise ValueError(f"its format is {table['format']!r}; this version reads {FORMAT!r}")
    arrays = ("mean", "mean_covariance", "spread", "spread_interval")
    return Population(
        specimens=tuple(table["specimens"]),
        names=tuple(table["names"]),
        manifest=join_manifests([table.get("manifest", {})]),
        pump=str(table.get("pump", "")),
        **{name: np.array(table[name], dtype=float) for name in arrays},
    )


def population_of(evidence: Mapping[str, Evidence], unknowns: Unknowns, spread_width: float) -> Population:
    """The most probable population, from the evidence of each specimen.

    Parameters
    ----------
    unknowns : what was searched of each; their priors are those of the population's mean.
    spread_width : width of the half-normal density of the spreads; see `SPREAD_WIDTH`.
    """
    center, scale = unknowns.center, unknowns.deviation
    information = torch.as_tensor(np.stack([item.information for item in evidence.values()]) * np.outer(scale, scale))
    pushed = np.stack([item.push - item.information @ center for item in evidence.values()])
    push = torch.as_tensor(pushed * scale)
    width = torch.as_tensor(np.minimum(spread_width, scale) / scale)

    def loss(logarithm: Tensor) -> Tensor:
        spread = logarithm.exp()
        value, _, _ = _marginal(information, push, spread)
        return value + (spread / width).square().sum() / 2 - logarithm.sum()

    def with_slope(logarithm: np.ndarray) -> tuple[float, np.ndarray]:
        point = torch.tensor(logarithm, requires_grad=True)
        value = loss(point)
        (slope,) = torch.autograd.grad(value, point)
        return value.item(), slope.numpy()

    least = np.log(LEAST_SPREAD / scale)
    bounds = list(zip(least, np.log(5 * width.numpy()), strict=True))
    start = np.log(0.5 * width.numpy())
    log_spread = scipy.optimize.minimize(with_slope, start, jac=True, method="L-BFGS-B", bounds=bounds).x
    curvature = torch.autograd.functional.hessian(loss, torch.tensor(log_spread)).numpy()
    std = np.sqrt(np.clip(np.diag(np.linalg.pinv(curvature, hermitian=True)), 0, None))
    spread = np.exp(log_spread) * scale
    _, mean, precision = _marginal(information, push, torch.tensor(np.exp(log_spread)))
    return Population(
        specimens=tuple(evidence),
        names=unknowns.names,
        mean=center + scale * mean.numpy(),
        mean_covariance=np.linalg.inv(precision.numpy()) * np.outer(scale, scale),
        spread=spread,
        spread_interval=spread[:, None] * np.exp(QUANTILE * std[:, None] * [-1, 1]),
    )


def _marginal(information: Tensor, push: Tensor, spread: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """-ln of the evidence's density given the spreads; mean of the population; the mean's precision.

    In units of the priors' deviations about their centers: the mean's prior is a unit normal density.
    """
    unit = torch.eye(len(spread), dtype=spread.dtype)
    root = torch.linalg.cholesky(unit + spread[:, None] * information * spread)
    inner = torch.cholesky_inverse(root)
    conditional = spread[:, None] * inner * spread  # covariance of a pump about the population's mean
    pull = torch.einsum("nij,njk,nk->ni", information, conditional, push)
    net_push = push - pull
    informative = information - information @ conditional @ information
    precision = informative.sum(dim=0) + unit
    sum_of_pushes = net_push.sum(dim=0)
    mean = torch.linalg.solve(precision, sum_of_pushes)
    value = (
        root.diagonal(dim1=-2, dim2=-1).log().sum()
        + torch.logdet(precision) / 2
        - torch.einsum("ni,nij,nj->", push, conditional, push) / 2
        - sum_of_pushes @ mean / 2
    )
    return value, mean, precision


def covariance_within(
    evidence: Evidence,
    population: Population,
    shared: Float[np.ndarray, "unknown unknown"],
    most: Float[np.ndarray, " unknown"],
) -> Float[np.ndarray, "unknown unknown"]:
    """Covariance of a member's coordinates given its own evidence and the population, the mean's uncertainty within.

    Parameters
    ----------
    shared : covariance of the error that all pumps' evidence and so the mean have in common; the mean's holds it.
    most : standard deviation that no coordinate exceeds: that of its prior.
    """
    spread = population.spread
    scaled = spread[:, None] * evidence.information * spread
    conditional = spread[:, None] * np.linalg.inv(np.eye(len(spread)) + scaled) * spread
    of_mean = conditional / spread**2
    crossed = of_mean @ shared @ (np.eye(len(spread)) - of_mean).T
    covariance = conditional + of_mean @ population.mean_covariance @ of_mean.T + crossed + crossed.T
    values, vectors = np.linalg.eigh((covariance + covariance.T) / 2 / np.outer(most, most))
    covariance = vectors * np.maximum(values, LEAST_SPREAD**2) @ vectors.T * np.outer(most, most)
    excess = np.minimum(1.0, most / np.sqrt(np.diag(covariance)))
    return covariance * np.outer(excess, excess)


def names_shared(unknowns: Sequence[Unknowns]) -> tuple[str, ...]:
    """Coordinates of all, which must be the same.

    Raises
    ------
    InputError
        They differ, for the channels do.
    """
    first = unknowns[0].names
    for other in unknowns[1:]:
        if other.names != first:
            differing = sorted(set(other.names) ^ set(first))
            raise InputError(
                f"specimens measured on different channels share no {', '.join(differing[:3])}; pick the same channels "
                "of all with recording.picked([...]), or search neither gains nor modes."
            )
    return first
