"""A classifier without a network, fitted, and how it comes to be."""

import difflib
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Shaped
from sklearn.ensemble import ExtraTreesClassifier

from swashtwin.foundation import DataError, InputError, derive_seed, plural
from swashtwin.learning.estimators.registry import BASELINES, N_TREES
from swashtwin.learning.features import FeatureTable, extract_features, level_features
from swashtwin.learning.training.classifier import require_verdicts
from swashtwin.learning.training.confidence import Confidence
from swashtwin.learning.training.training_reference import TrainingReference, build_reference
from swashtwin.learning.windows.window_set import WindowLayout, WindowSet, distinct_values
from swashtwin.recordings import Manifest, join_manifests


@dataclass(frozen=True, eq=False)
class FittedBaseline:
    """A fitted estimator that answers as a fitted network does, so that `evaluate` takes either."""

    estimator: Any
    """The estimator of scikit-learn, fitted on the columns of `features`."""
    classes: tuple[str, ...]
    """Class names, in the order of the probabilities."""
    layout: WindowLayout
    """Sample rate, channels, unit and length that windows must have."""
    manifest: Manifest
    """Every recording that had a part in it, by id with the hashes of its content; none may be tested on."""
    pressures: tuple[float, ...] = ()
    """Discharge pressures it was fitted at [Pa], ascending; empty where they were not known."""
    speeds: tuple[float, ...] = ()
    """Shaft speeds it was fitted at [rad/s], ascending; empty where they were not known."""
    features: Callable[[WindowSet], FeatureTable] = extract_features
    """What gives the estimator its columns."""
    training_reference: TrainingReference | None = None
    """The measured recordings it was fitted on, by the levels of their vibration; None where there was none."""
    confidence: Confidence | None = None
    """Calibrated confidence (`learn_confidence`); None where it was not calibrated."""

    def __repr__(self) -> str:
        return (
            f"<FittedBaseline: {plural(len(self.layout.channels), 'channel')}, {self.layout.length} samples at "
            f"{self.layout.sample_rate:g} Hz, classes {', '.join(self.classes)}, "
            f"{plural(len(self.manifest), 'recording')} had a part in it>"
        )

    def scaled_for(self, parts: Callable[[], Iterable[WindowSet]]) -> "FittedBaseline":
        """The same classifier: its columns depend on each window alone."""
        return self

    def predict_proba(self, windows: WindowSet) -> Float[np.ndarray, "window class"]:
        """Probability of each class for each window; rows sum to 1, or are NaN where a feature is not finite."""
        if difference := self.layout.difference(windows.layout):
            raise InputError(f"the classifier was fitted on other windows: {difference}.")
        values = self.features(windows).values
        finite: np.ndarray = (np.abs(values) < np.finfo(np.float32).max).all(
            axis=1
        )  # trees compare in single precision
        probability: np.ndarray = self.estimator.predict_proba(np.where(finite[:, None], values, 0.0))
        return np.where(finite[:, None], probability, np.nan)

    def answer(
        self, windows: WindowSet
    ) -> tuple[Float[np.ndarray, "window class"], Float[np.ndarray, "window feature"]]:
        """(`predict_proba`, `level_features`) of each window: what a verdict and what its trust rest on."""
        return self.predict_proba(windows), level_features(windows)

    def predict(self, windows: WindowSet) -> Shaped[np.ndarray, " window"]:
        """Name of the likeliest class of each window; a `DataError` where one has no verdict."""
        probability = self.predict_proba(windows)
        require_verdicts(probability, windows.recording_id)
        return np.array(self.classes, dtype=np.str_)[probability.argmax(axis=1)]


def fit_baseline(
    name: str,
    windows: WindowSet,
    *,
    seed: int = 0,
    manifest: Manifest | Iterable[str] = (),
    features: Callable[[WindowSet], FeatureTable] = extract_features,
) -> FittedBaseline:
    """The classifier of that name, fitted.

    Parameters
    ----------
    name : one of `BASELINES`.
    windows : training windows with labels.
    seed : seed of everything random in it.
    manifest : further recordings, as a manifest or by their ids, that had a part in the windows, such as those a twin
        was calibrated on.
    features : what gives the columns, where the classifier is one on features; those of `extract_features` by default.

    Raises
    ------
    InputError
        No classifier has this name (the nearest is offered), or it makes its own columns and `features` was given.
    DataError
        A class has no window, or a window has no label.
    """
    if name not in BASELINES:
        near = difflib.get_close_matches(name.lower(), BASELINES, n=1, cutoff=0.3)
        hint = f" Did you mean {near[0]!r}?" if near else ""
        raise InputError(f"unknown classifier {name!r}; there are {', '.join(sorted(BASELINES))}.{hint}")
    baseline = BASELINES[name]
    estimator = baseline.estimator(derive_seed(seed, baseline.title) % 2**32)
    if baseline.fit_columns is not None:
        if features is not extract_features:
            raise InputError(f"{name} reads the windows themselves; features belong to the classifiers on features.")
        _require_every_class(windows)
        features = baseline.fit_columns(windows, derive_seed(seed, name, "kernels") % 2**32)
    return _fitted(estimator, windows, features, manifest)


def fit_extra_trees(
    windows: WindowSet,
    *,
    seed: int = 0,
    n_trees: int = N_TREES,
    manifest: Manifest | Iterable[str] = (),
    features: Callable[[WindowSet], FeatureTable] = extract_features,
) -> FittedBaseline:
    """Extremely randomized trees (Geurts, Ernst and Wehenkel 2006, DOI 10.1007/s10994-006-6226-1) on the features.

    Trees need no scaling, no selection and hardly a setting: compare a network with them first.

    Parameters
    ----------
    windows : training windows with labels.
    seed : seed of the trees.
    n_trees : number of trees.
    manifest : further recordings, as a manifest or by their ids, that had a part in the windows, such as those a twin
        was calibrated on.
    features : what gives the columns; those of `extract_features` by default.

    Raises
    ------
    DataError
        A class has no window, or a window has no label.
    """
    estimator = ExtraTreesClassifier(n_trees, random_state=derive_seed(seed, "extra trees") % 2**32, n_jobs=1)
    return _fitted(estimator, windows, features, manifest)


def _fitted(
    estimator: Any,
    windows: WindowSet,
    features: Callable[[WindowSet], FeatureTable],
    manifest: Manifest | Iterable[str],
) -> FittedBaseline:
    _require_every_class(windows)
    estimator.fit(features(windows).values, windows.target)
    return FittedBaseline(
        estimator=estimator,
        classes=windows.classes,
        layout=windows.layout,
        manifest=join_manifests([windows.sources, manifest]),
        pressures=distinct_values(windows.cell_pressure),
        speeds=distinct_values(windows.speed),
        features=features,
        training_reference=build_reference(windows, level_features(windows)),
    )


def _require_every_class(windows: WindowSet) -> None:
    windows.require_labels("training")
    windows.require_two_classes()
    counts = np.bincount(windows.target, minlength=len(windows.classes))
    if not (counts.size and counts.all()):
        missing = windows.classes[int(counts.argmin())] if counts.size else "any"
        raise DataError(f"class {missing} has no training window; add some, or cut the windows without this class.")
