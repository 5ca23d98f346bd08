"""Distance of a recording from every trained class, as a likelihood ratio to a new class."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64, Shaped

from swashtwin.learning.covariance import shrinkage
from swashtwin.learning.windows.window_set import group_means, operating_points

# Added to each variance, because classes of a single recording have none.
_MIN_VARIANCE = 1e-6

# Share of the variance between classes that is assumed equal in every direction.
_NEW_CLASS_SHARE = 0.1

# Share of the variance between machines that is assumed equal in every direction.
_MACHINE_SHARE = 0.5

# Recordings of each class and operating point, on average, from which the offsets of the operating
# points are estimated.
_MIN_RECORDINGS_PER_CELL = 2

# Share of the largest eigenvalue below which a direction is rounding.
_SPAN_TOLERANCE = 1e-10


@dataclass(frozen=True, eq=False)
class ClassSpace:
    """Gaussian classes that differ by machine and by recording.

    A recording of class c is m_c + a + e, with the machine's share a ~ N(0, P) and the recording's
    e ~ N(0, E); a new class is the mean of all + b + a + e with b ~ N(0, B). E is shrunk by Ledoit
    and Wolf (2004, DOI 10.1016/S0047-259X(03)00096-4); P and B, which a few machines and classes
    hardly determine, are mixed with a multiple of the identity. Outside the span of the training
    recordings all three are multiples of the identity.
    """

    mean: Float64[np.ndarray, " feature"]
    basis: Float64[np.ndarray, "feature axis"]
    centers: Float64[np.ndarray, "class axis"]
    trained: Float64[np.ndarray, "axis axis"]
    """Inverse covariance of a trained class, P + E."""
    new: Float64[np.ndarray, "axis axis"]
    """Inverse covariance of a new class, B + P + E; 0 if there is only one class."""
    outside: tuple[float, float]
    """Inverse variances of a trained and of a new class outside the span."""
    conditions: Float64[np.ndarray, "point quantity"]
    """Speed and pressure of each operating point."""
    offsets: Float64[np.ndarray, "point feature"]
    """Offset of each operating point, for all classes."""

    def score(
        self, features: Float[np.ndarray, " feature"], condition: Float[np.ndarray, " quantity"]
    ) -> float:
        """Return the squared distance from the nearest trained class less that from a new one.

        It is divided by the number of features.
        """
        centered = features - self.mean - self._offset_at(condition)
        inside = centered @ self.basis
        outside_square = max(float(centered @ centered - inside @ inside), 0.0)

        from_classes = inside - self.centers
        class_squares = np.einsum("ca,ab,cb->c", from_classes, self.trained, from_classes)
        from_all = inside - self.centers.mean(axis=0)
        new_square = float(from_all @ self.new @ from_all)

        trained_outside, new_outside = self.outside
        difference = float(class_squares.min()) - new_square
        difference += outside_square * (trained_outside - new_outside)
        return difference / features.size

    def _offset_at(self, condition: Float[np.ndarray, " quantity"]) -> np.ndarray:
        """Return the offset of the nearest operating point; the mean of all if unknown."""
        distance = np.abs(np.log(self.conditions / condition)).sum(axis=1)
        if np.isnan(distance).all():
            return np.asarray(self.offsets.mean(axis=0))
        return self.offsets[np.nanargmin(distance)]


def fit_class_space(
    features: Float[np.ndarray, "recording feature"],
    label: Sequence[str] | Shaped[np.ndarray, " recording"],
    specimen: Sequence[str] | Shaped[np.ndarray, " recording"],
    condition: Float[np.ndarray, "recording quantity"],
) -> ClassSpace:
    """Fit the class space of some recordings.

    Parameters
    ----------
    features : mean features of each recording.
    label : its class.
    specimen : its machine, "" if not specified.
    condition : its speed [rad/s] and pressure [Pa].
    """
    values = features.astype(np.float64)
    n_features = features.shape[1]
    classes, target = np.unique(label, return_inverse=True)
    points, point = _resolved_operating_points(condition, len(classes))
    offsets = _operating_point_offsets(values, target, point, len(points))
    values = values - offsets[point]

    mean = values.mean(axis=0)
    basis = _span(values - mean)
    inside = (values - mean) @ basis
    centers = group_means(inside, target)
    covariance, outside = _covariance_within(inside - centers[target], target, specimen, n_features)

    # A new class: its center is drawn like those of the trained classes.
    new = np.zeros_like(covariance)
    new_outside = 0.0
    n_classes = len(classes)
    if n_classes > 1:
        between, between_outside = _mix(
            centers - centers.mean(axis=0), _NEW_CLASS_SHARE, n_features
        )
        # The spread of the centers about their own mean is too small by this factor.
        unbiased = n_classes / (n_classes - 1)
        new = np.linalg.inv(covariance + unbiased * between)
        new_outside = 1 / (outside + unbiased * between_outside)
    return ClassSpace(
        mean=mean,
        basis=basis,
        centers=centers,
        trained=np.linalg.inv(covariance),
        new=new,
        outside=(1 / outside, new_outside),
        conditions=points,
        offsets=offsets,
    )


def _operating_point_offsets(
    values: Float64[np.ndarray, "recording feature"],
    target: np.ndarray,
    point: np.ndarray,
    n_points: int,
) -> Float64[np.ndarray, "point feature"]:
    """Return the mean change of the classes at each operating point from their means."""
    class_means = group_means(values, target)
    offsets = np.zeros((n_points, values.shape[1]))
    for number in range(n_points):
        changes = []
        for index in np.unique(target[point == number]):
            rows = (point == number) & (target == index)
            changes.append(values[rows].mean(axis=0) - class_means[index])
        offsets[number] = np.mean(changes, axis=0)
    return offsets


def _covariance_within(
    deviations: Float64[np.ndarray, "recording axis"],
    target: np.ndarray,
    specimen: Sequence[str] | Shaped[np.ndarray, " recording"],
    n_features: int,
) -> tuple[np.ndarray, float]:
    """Return the covariance P + E of a trained class, and its variance outside the span."""
    machines, machine = np.unique(specimen, return_inverse=True)
    if len(machines) < 2:
        return _shrink(deviations, n_features)

    group = np.unique(target * len(machines) + machine, return_inverse=True)[1]
    machine_means = group_means(deviations, group)
    between, between_outside = _mix(machine_means, _MACHINE_SHARE, n_features)
    within, within_outside = _shrink(deviations - machine_means[group], n_features)
    return within + between, within_outside + between_outside


def _span(rows: Float64[np.ndarray, "recording feature"]) -> Float64[np.ndarray, "feature axis"]:
    """Return orthonormal directions that the rows span."""
    # By the products of recordings, which are fewer than the features.
    value, vector = np.linalg.eigh(rows @ rows.T)
    is_used = value > _SPAN_TOLERANCE * max(float(value[-1]), 1e-300)
    return np.asarray(rows.T @ vector[:, is_used] / np.sqrt(value[is_used]))


def _mix(
    rows: Float64[np.ndarray, "row axis"], share: float, n_features: int
) -> tuple[np.ndarray, float]:
    """Return the mean square of the rows, mixed with a multiple of the identity.

    The second value is that multiple, the variance outside the span of the rows.
    """
    square = rows.T @ rows / len(rows)
    outside = share * float(np.trace(square)) / n_features
    return (1 - share) * square + outside * np.eye(len(square)), outside


def _shrink(rows: Float64[np.ndarray, "row axis"], n_features: int) -> tuple[np.ndarray, float]:
    """Return the shrunk covariance of the rows, and the variance outside their span."""
    covariance, outside = shrinkage(rows, n_features)
    return covariance + _MIN_VARIANCE * np.eye(len(covariance)), outside + _MIN_VARIANCE


def _resolved_operating_points(
    condition: Float[np.ndarray, "recording quantity"], n_classes: int
) -> tuple[Float64[np.ndarray, "point quantity"], np.ndarray]:
    """Return speed and pressure of each operating point, and the index of each recording's.

    If there are fewer than two recordings for each class and operating point, all count as one
    unspecified operating point.
    """
    points, point = operating_points(condition)
    if len(condition) < _MIN_RECORDINGS_PER_CELL * n_classes * len(points):
        return np.full((1, 2), np.nan), np.zeros(len(condition), dtype=np.int64)
    return points, point
