"""Covariance of few rows of many features, shrunk so that it can be inverted."""

import numpy as np
from jaxtyping import Float, Float64


def shrunk_covariance(
    rows: Float[np.ndarray, "recording feature"],
) -> Float64[np.ndarray, "feature feature"]:
    """Return the covariance of the rows, shrunk towards a multiple of the identity.

    The method is that of Ledoit and Wolf (2004):
    (1 - s) S + s m I with S the covariance, m the mean of its diagonal (DOI
    10.1016/S0047-259X(03)00096-4); as scikit-learn's `LedoitWolf`, whose import would take longer
    than a diagnosis.
    """
    return shrinkage(rows, rows.shape[1])[0]


def shrinkage(
    rows: Float[np.ndarray, "recording axis"], n_features: int
) -> tuple[Float64[np.ndarray, "axis axis"], float]:
    """Return the shrunk covariance of the rows, and its variance along all other directions.

    See `shrunk_covariance`. The rows are coordinates along some orthonormal axes that contain all
    differences between them, out of `n_features`.
    """
    centered = rows - rows.mean(axis=0)
    n_rows = len(rows)
    squares = np.einsum("ij,ij->i", centered, centered)
    covariance = centered.T @ centered / n_rows
    trace = squares.sum() / n_rows
    mean = trace / n_features

    norm = float(np.vdot(covariance, covariance))
    beta = (float((squares**2).sum()) / n_rows - norm) / (n_features * n_rows)
    delta = (norm - 2 * mean * trace + n_features * mean**2) / n_features
    share = min(beta, delta) / delta if min(beta, delta) > 0 else 0.0
    shrunk = (1 - share) * covariance + share * mean * np.eye(len(covariance))
    return np.asarray(shrunk), float(share * mean)
