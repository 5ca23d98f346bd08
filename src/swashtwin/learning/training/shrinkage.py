"""Covariances of few recordings with many features."""

import numpy as np
from jaxtyping import Float, Float64


def shrunk_covariance(rows: Float[np.ndarray, "recording feature"]) -> Float64[np.ndarray, "feature feature"]:
    """Covariance of the rows, shrunk towards a multiple of the identity by Ledoit and Wolf (2004).

    (1 - s) S + s m I with S the covariance, m the mean of its diagonal (DOI 10.1016/S0047-259X(03)00096-4); as
    scikit-learn's `LedoitWolf`, whose import would take longer than a diagnosis.
    """
    return shrinkage(rows, rows.shape[1])[0]


def shrinkage(
    rows: Float[np.ndarray, "recording axis"], n_features: int
) -> tuple[Float64[np.ndarray, "axis axis"], float]:
    """(covariance of the rows as `shrunk_covariance`, its diagonal along directions in which no row differs).

    The rows are coordinates along some orthonormal axes that hold all that differs between them, out of `n_features`.
    """
    centered = rows - rows.mean(axis=0)
    squares = (centered**2).sum(axis=1)
    covariance = centered.T @ centered / len(rows)
    trace = squares.sum() / len(rows)
    mean = trace / n_features
    norm = float((covariance**2).sum())
    beta = (float((squares**2).sum()) / len(rows) - norm) / (n_features * len(rows))
    delta = (norm - 2 * mean * trace + n_features * mean**2) / n_features
    share = min(beta, delta) / delta if min(beta, delta) > 0 else 0.0
    return np.asarray((1 - share) * covariance + share * mean * np.eye(len(covariance))), float(share * mean)
