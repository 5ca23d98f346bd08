"""Answers to windows that the training of a fold did not see."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64, Shaped

from swashtwin.learning.training.fitting import RepresentedWindows


@dataclass(frozen=True, eq=False)
class OutOfFoldPredictions:
    """Answers of a candidate to measured windows that its fold's training did not see."""

    probability: Float64[np.ndarray, "window class"]
    target: Int64[np.ndarray, " window"]
    recording_id: Shaped[np.ndarray, " window"]
    """Recording of each window, in order of time."""
    fold: Int64[np.ndarray, " window"]
    """Fold that left it out."""
    represented: RepresentedWindows | None = None
    """All training windows as the candidate's network sees them; None if the trial used fewer."""
