"""From windows to the recording they are of."""

import numpy as np
from jaxtyping import Float, Int64


def pooled_probabilities(probability: Float[np.ndarray, "window class"]) -> Float[np.ndarray, " class"]:
    """Probability of each class for a whole recording: the mean log-probability of its windows, made to sum to 1.

    NaN for each class where a window has no finite answer.
    """
    logarithm = np.log(np.maximum(probability, 1e-12)).mean(axis=0)
    share = np.exp(logarithm - logarithm.max())
    return share / share.sum()


def likeliest_class(probability: Float[np.ndarray, "*window class"]) -> Int64[np.ndarray, "*window"]:
    """Index of the likeliest class; -1 where a probability is no finite number, so that there is no verdict.

    Examples
    --------
    >>> likeliest_class(np.array([[0.2, 0.8], [np.nan, np.nan]])).tolist()
    [1, -1]
    """
    return np.where(np.isfinite(probability).all(axis=-1), probability.argmax(axis=-1), -1)
