"""From windows to the recording they are of."""

import numpy as np
from jaxtyping import Float


def pooled_probabilities(probability: Float[np.ndarray, "window class"]) -> Float[np.ndarray, " class"]:
    """Probability of each class for a whole recording: the mean log-probability of its windows, made to sum to 1."""
    logarithm = np.log(np.maximum(probability, 1e-12)).mean(axis=0)
    share = np.exp(logarithm - logarithm.max())
    return share / share.sum()
