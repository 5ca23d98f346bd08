"""A classifier that is tested on recordings it was trained on, to show how much of a score is leak."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from swashtwin.learning import Classifier, WindowSet


@dataclass(frozen=True, eq=False)
class UnlistedClassifier:
    """A classifier that names none of its training recordings, so that other windows of them may be tested on.

    Only for tests on random windows, level L0, which show how much of a score is leak.
    """

    classifier: Classifier
    """The classifier that answers."""

    @property
    def classes(self) -> tuple[str, ...]:
        """Class names, in the order of the probabilities."""
        return self.classifier.classes

    @property
    def manifest(self) -> tuple[str, ...]:
        """None."""
        return ()

    def predict_proba(self, windows: WindowSet) -> Float[np.ndarray, "window class"]:
        """Probability of each class for each window."""
        return self.classifier.predict_proba(windows)
