"""p-values corrected for being several."""

import numpy as np
from jaxtyping import Float


def holm_correction(p_values: Float[np.ndarray, " test"]) -> Float[np.ndarray, " test"]:
    """p-values corrected by Holm's step-down method (1979), which bounds the chance of any false alarm among all tests.

    NaN stays NaN and does not count as a test.

    Examples
    --------
    >>> holm_correction(np.array([0.01, 0.04, 0.03, np.nan])).round(3).tolist()
    [0.03, 0.06, 0.06, nan]
    """
    order = np.argsort(p_values)[: np.count_nonzero(~np.isnan(p_values))]  # NaN sorts last
    corrected = np.full(len(p_values), np.nan)
    stepped = p_values[order] * np.arange(len(order), 0, -1)
    corrected[order] = np.minimum(1.0, np.maximum.accumulate(stepped))
    return corrected
