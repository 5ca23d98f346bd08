"""Classifiers made of a trained one, or of several: an ensemble, and one that sees windows in a view of its own."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from swashtwin.learning import Classifier, Epoch, FittedClassifier, WindowSet
from swashtwin.recordings import Manifest


@dataclass(frozen=True, eq=False)
class Ensemble:
    """Mean of its members' probabilities (deep ensemble, Lakshminarayanan et al. 2017, DOI 10.48550/arXiv.1612.01474).

    The members differ by the seed of their weights and of the order of their windows. Being several, they have no loss
    curve nor features in common.
    """

    members: tuple[Classifier, ...]
    """Classifiers of the same classes, one at least."""

    @property
    def classes(self) -> tuple[str, ...]:
        """Class names, in the order of the probabilities."""
        return self.members[0].classes

    @property
    def manifest(self) -> tuple[str, ...]:
        """Every recording that had a part in a member, sorted."""
        return tuple(sorted({name for member in self.members for name in member.manifest}))

    def predict_proba(self, windows: WindowSet) -> Float[np.ndarray, "window class"]:
        """Probability of each class for each window; rows sum to 1."""
        return np.mean([member.predict_proba(windows) for member in self.members], axis=0)


@dataclass(frozen=True, eq=False)
class NetworkOnView:
    """A network trained on a view of the windows; it takes whole windows and makes the view itself."""

    classifier: FittedClassifier
    """Trained on what `view` gives."""
    view: Callable[[WindowSet], WindowSet]
    """What it sees of windows."""

    @property
    def classes(self) -> tuple[str, ...]:
        """Class names, in the order of the probabilities."""
        return self.classifier.classes

    @property
    def manifest(self) -> Manifest:
        """Every recording that had a part in it."""
        return self.classifier.manifest

    @property
    def history(self) -> tuple[Epoch, ...]:
        """Loss and accuracy of each epoch."""
        return self.classifier.history

    def predict_proba(self, windows: WindowSet) -> Float[np.ndarray, "window class"]:
        """Probability of each class for each window."""
        return self.classifier.predict_proba(self.view(windows))

    def embed(self, windows: WindowSet) -> Float[np.ndarray, "window feature"]:
        """What the last layer sees of each window."""
        return self.classifier.embed(self.view(windows))


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


def first_sensors(windows: WindowSet, count: int) -> WindowSet:
    """The windows with their first `count` channels only."""
    return replace(windows, signal=windows.signal[:, :count], channels=windows.channels[:count])
