"""How far a recording lies from every trained class: a likelihood ratio between a trained class and
a new one.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64, Shaped

from swashtwin.learning.windows.window_set import group_means, operating_points


def shrunk_covariance(
    rows: Float[np.ndarray, "recording feature"],
) -> Float64[np.ndarray, "feature feature"]:
    """Covariance of the rows, shrunk towards a multiple of the identity by Ledoit and Wolf (2004).

    (1 - s) S + s m I with S the covariance, m the mean of its diagonal (DOI
    10.1016/S0047-259X(03)00096-4); as scikit-learn's `LedoitWolf`, whose import would take longer
    than a diagnosis.
    """
    return shrinkage(rows, rows.shape[1])[0]


def shrinkage(
    rows: Float[np.ndarray, "recording axis"], n_features: int
) -> tuple[Float64[np.ndarray, "axis axis"], float]:
    """(covariance of the rows as `shrunk_covariance`, its diagonal along directions in which no row
    differs).

    The rows are coordinates along some orthonormal axes that hold all that differs between them,
    out of `n_features`.
    """
    centered = rows - rows.mean(axis=0)
    squares = np.einsum("ij,ij->i", centered, centered)
    covariance = centered.T @ centered / len(rows)
    trace = squares.sum() / len(rows)
    mean = trace / n_features
    norm = float(np.vdot(covariance, covariance))
    beta = (float((squares**2).sum()) / len(rows) - norm) / (n_features * len(rows))
    delta = (norm - 2 * mean * trace + n_features * mean**2) / n_features
    share = min(beta, delta) / delta if min(beta, delta) > 0 else 0.0
    return np.asarray((1 - share) * covariance + share * mean * np.eye(len(covariance))), float(
        share * mean
    )


_LEAST_VARIANCE = 1e-6
"""Added to each variance, for classes of one recording have none."""
_NEW_CLASS_SPREAD, _MACHINE_SPREAD = 0.1, 0.5
"""Share of the variance between classes, and between machines, that is taken to be alike in every
direction.
"""
_LEAST_IN_CELL = 2
"""Recordings of each class and operating point, on average, from which the points' offsets can be
told.
"""
_SPAN = 1e-10
"""Share of the greatest eigenvalue below which a direction is rounding."""


@dataclass(frozen=True, eq=False)
class ClassSpace:
    """Gaussian classes that differ by machine and by recording, within the span of the training
    recordings.

    A recording of class c is m_c + a + e, with the machine's share a ~ N(0, P) and the recording's
    e ~ N(0, E); a new class is the mean of all + b + a + e with b ~ N(0, B). E is shrunk by Ledoit
    and Wolf (2004, DOI 10.1016/S0047-259X(03)00096-4); P and B, of which a few machines and classes
    tell little, are mixed with a multiple of the identity. Outside the span of the training
    recordings all three are multiples of the identity.
    """

    mean: Float64[np.ndarray, " feature"]
    basis: Float64[np.ndarray, "feature axis"]
    centers: Float64[np.ndarray, "class axis"]
    trained: Float64[np.ndarray, "axis axis"]
    """Inverse covariance of a trained class, P + E."""
    new: Float64[np.ndarray, "axis axis"]
    """Inverse covariance of a new class, B + P + E; 0 where there is one class only."""
    outside: tuple[float, float]
    """Both outside the span."""
    conditions: Float64[np.ndarray, "point quantity"]
    """Speed and pressure of each operating point."""
    offsets: Float64[np.ndarray, "point feature"]
    """What each operating point adds, whatever the class."""

    def score(
        self, features: Float[np.ndarray, " feature"], condition: Float[np.ndarray, " quantity"]
    ) -> float:
        """Squared distance from the nearest trained class less that from a new one, per feature."""
        ratio = np.abs(np.log(self.conditions / condition)).sum(axis=1)
        is_stated = not np.isnan(ratio).all()
        centered = (
            features
            - self.mean
            - (self.offsets[np.nanargmin(ratio)] if is_stated else self.offsets.mean(axis=0))
        )
        inside = centered @ self.basis
        rest = max(float(centered @ centered - inside @ inside), 0.0)
        offset = inside - self.centers
        nearest = float(np.einsum("ca,ab,cb->c", offset, self.trained, offset).min())
        from_all = inside - self.centers.mean(axis=0)
        new = float(from_all @ self.new @ from_all)
        return (nearest - new + rest * (self.outside[0] - self.outside[1])) / features.size


def fit_class_space(
    features: Float[np.ndarray, "recording feature"],
    label: Sequence[str] | Shaped[np.ndarray, " recording"],
    specimen: Sequence[str] | Shaped[np.ndarray, " recording"],
    condition: Float[np.ndarray, "recording quantity"],
) -> ClassSpace:
    """The space of recordings by their mean features, class, machine ("" for none), speed [rad/s]
    and pressure [Pa].
    """
    values, n_features = features.astype(np.float64), features.shape[1]
    classes, target = np.unique(label, return_inverse=True)
    points, point = _operating_points(condition, len(classes))
    means, offsets = group_means(values, target), np.zeros((len(points), values.shape[1]))
    for number in range(len(points)):
        present = np.unique(target[point == number])
        changes = [
            values[(point == number) & (target == c)].mean(axis=0) - means[c] for c in present
        ]
        offsets[number] = np.mean(changes, axis=0)
    values = values - offsets[point]
    mean = values.mean(axis=0)
    basis = _span(values - mean)
    inside = (values - mean) @ basis
    centers = group_means(inside, target)
    within = inside - centers[target]
    machines, machine = np.unique(specimen, return_inverse=True)
    if len(machines) > 1:
        group = np.unique(target * len(machines) + machine, return_inverse=True)[1]
        of_machine = group_means(within, group)
        between, between_outside = _mixed(of_machine, _MACHINE_SPREAD, n_features)
        covariance, outside = _shrunk(within - of_machine[group], n_features)
        covariance, outside = covariance + between, outside + between_outside
    else:
        covariance, outside = _shrunk(within, n_features)
    new, inverse_outside = np.zeros_like(covariance), 0.0
    if len(classes) > 1:
        spread, spread_outside = _mixed(
            centers - centers.mean(axis=0), _NEW_CLASS_SPREAD, n_features
        )
        share = len(classes) / (len(classes) - 1)
        new = np.linalg.inv(covariance + share * spread)
        inverse_outside = 1 / (outside + share * spread_outside)
    return ClassSpace(
        mean,
        basis,
        centers,
        np.linalg.inv(covariance),
        new,
        (1 / outside, inverse_outside),
        points,
        offsets,
    )


def _span(rows: Float64[np.ndarray, "recording feature"]) -> Float64[np.ndarray, "feature axis"]:
    """Orthonormal directions that the rows span."""
    value, vector = np.linalg.eigh(rows @ rows.T)
    used = value > _SPAN * max(float(value[-1]), 1e-300)
    return np.asarray(rows.T @ vector[:, used] / np.sqrt(value[used]))


def _mixed(
    rows: Float64[np.ndarray, "row axis"], share: float, n_features: int
) -> tuple[np.ndarray, float]:
    """(mean square of the rows mixed with `share` of a multiple of the identity, that outside their
    span).
    """
    square = rows.T @ rows / len(rows)
    outside = share * float(np.trace(square)) / n_features
    return (1 - share) * square + outside * np.eye(len(square)), outside


def _shrunk(rows: Float64[np.ndarray, "row axis"], n_features: int) -> tuple[np.ndarray, float]:
    """(shrunk covariance of the rows, that outside their span)."""
    covariance, outside = shrinkage(rows, n_features)
    return covariance + _LEAST_VARIANCE * np.eye(len(covariance)), outside + _LEAST_VARIANCE


def _operating_points(
    condition: Float[np.ndarray, "recording quantity"], n_classes: int
) -> tuple[Float64[np.ndarray, "point quantity"], np.ndarray]:
    """(speed and pressure of each operating point, index of each recording's).

    Where there are fewer than two recordings for each class and point, all count as one point that
    is not stated.
    """
    points, point = operating_points(condition)
    if len(condition) < _LEAST_IN_CELL * n_classes * len(points):
        return np.full((1, 2), np.nan), np.zeros(len(condition), dtype=np.int64)
    return points, point
