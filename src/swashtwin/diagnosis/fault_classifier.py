"""`FaultClassifier`: from recordings, windows or arrays to classes, by scikit-learn's conventions."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from sklearn.base import BaseEstimator, ClassifierMixin
from sklearn.utils.multiclass import check_classification_targets
from sklearn.utils.validation import check_is_fitted, validate_data

from swashtwin.diagnosis.classifier_input import (
    as_recordings,
    relabeled,
    require_none,
    synthetic_sets,
    windows_of_array,
    with_synthetic,
)
from swashtwin.diagnosis.saving import load_classifier, save_classifier
from swashtwin.diagnosis.verdict import Diagnosis, diagnose, fit_to_recording
from swashtwin.foundation import ArtifactError, InputError
from swashtwin.learning import (
    BASELINES,
    BUDGET,
    NETWORKS,
    RECOMMENDED_TRAINING,
    Epoch,
    FittedBaseline,
    FittedClassifier,
    Network,
    Scores,
    TrainingSettings,
    WindowSet,
    build_network,
    cut_windows,
    evaluate,
    fit,
    fit_baseline,
    fit_chosen,
    has_network,
    learn_confidence,
    pooled_probabilities,
    require_enough,
    require_shared_speed,
    require_verdicts,
    split_by_recording,
    without_overlap,
)
from swashtwin.recordings import Recording, join_manifests, usual_window

_ERROR_RATE = 0.1
_NETWORK_WINDOW = 2048
"""Samples per window of a named network by default."""
_OWN_PARAMETERS = ("epochs", "batch_size", "learning_rate", "decay", "normalization")
"""Settings of the training that the constructor names."""


class FaultClassifier(ClassifierMixin, BaseEstimator):
    """Classifier of pump faults from vibration, an estimator of scikit-learn.

    `fit`, `predict`, `predict_proba` and `score` take recordings, a `WindowSet`, or an array ``(window, channel,
    sample)`` or ``(window, sample)``. Each recording gets one answer, pooled over its windows; else each window does.

    `score` and `evaluate` raise a `LeakError` for a recording that had a part in the training. Cross-validation of
    arrays needs `groups` (``StratifiedGroupKFold``).

    Parameters
    ----------
    network : name of a network (`NETWORKS`; `register_network` adds one), or of a classifier on vibration features
        (`BASELINES`, such as ``"extra_trees"``). By default the training chooses among `CANDIDATES` by trials on inner
        folds, and learns its confidence from them (`fit_chosen`).
    window : samples per window and channel that recordings are cut into; a `WindowSet` or an array has its own. By
        default `usual_window` of the recordings, or 2048 for a network that is named.
    stride : samples from one window of a training recording to the next; None lets none overlap.
    allow_partial_revolution : accept windows shorter than one turn of the shaft.
    epochs, batch_size, learning_rate, decay, normalization : see `TrainingSettings`; for networks only.
    training_settings : other fields of `TrainingSettings` by name, such as ``{"noise_snr": 0.0}``.
    network_settings : settings of the network by name, such as ``{"dropout": 0.2}``.
    budget : computing time [s] on one core that choosing may take.
    validation_fraction : share of the recordings that calibrate its confidence (`learn_confidence`) instead; 0 for
        none. A network that is named has no confidence without.
    error_rate : share of recordings whose prediction set may miss the true class; by default 0.1, or the least that the
        recordings allow.
    sample_rate : samples per second [Hz] of arrays; recordings and window sets state their own.
    device : ``"cpu"``, or a GPU such as ``"cuda"``.
    seed : seed of everything random. The same seed, data and machine give the same bits.

    Attributes
    ----------
    classes_ : classes, in the order of the probabilities.
    fitted_ : the `FittedClassifier`, or `FittedBaseline`, with its manifest and history.
    n_features_in_ : second dimension of the array that it was fitted on; absent after other data.

    Examples
    --------
    >>> time = np.arange(64) / 1000
    >>> X = np.stack([np.sin(2 * np.pi * f * time) for f in (100, 101, 102, 200, 201, 202)])[:, None]
    >>> y = ["normal"] * 3 + ["piston"] * 3
    >>> FaultClassifier("extra_trees", sample_rate=1000.0).fit(X, y).predict(X[:4:3]).tolist()
    ['normal', 'piston']
    """

    def __init__(
        self,
        network: str | None = None,
        *,
        window: int | None = None,
        stride: int | None = None,
        allow_partial_revolution: bool = False,
        epochs: int = RECOMMENDED_TRAINING.epochs,
        batch_size: int = RECOMMENDED_TRAINING.batch_size,
        learning_rate: float = RECOMMENDED_TRAINING.learning_rate,
        decay: str = RECOMMENDED_TRAINING.decay,
        normalization: str = RECOMMENDED_TRAINING.normalization,
        training_settings: Mapping[str, Any] | None = None,
        network_settings: Mapping[str, Any] | None = None,
        budget: float = BUDGET,
        validation_fraction: float = 0.0,
        error_rate: float | None = None,
        sample_rate: float = 1.0,
        device: str = "cpu",
        seed: int = 0,
    ) -> None:
        self.network = network
        self.window = window
        self.stride = stride
        self.allow_partial_revolution = allow_partial_revolution
        self.epochs = epochs
        self.batch_size = batch_size
        self.learning_rate = learning_rate
        self.decay = decay
        self.normalization = normalization
        self.training_settings = training_settings
        self.network_settings = network_settings
        self.budget = budget
        self.validation_fraction = validation_fraction
        self.error_rate = error_rate
        self.sample_rate = sample_rate
        self.device = device
        self.seed = seed

    def fit(
        self,
        X: Any,
        y: Any = None,
        *,
        groups: Any = None,
        synthetic: WindowSet | Iterable[WindowSet] | None = None,
        progress: Callable[[Epoch], None] | None = None,
    ) -> "FaultClassifier":
        """The same classifier, trained.

        Parameters
        ----------
        X : recordings, a window set, or an array.
        y : class of each recording, or of each window of an array. Without it recordings have their own labels; a
            window set always has its own.
        groups : recording of each window of an array.
        synthetic : further training windows that nobody measured (`synthesize`), one set or several.
        progress : called after each epoch.

        Raises
        ------
        InputError
            A parameter, or data that do not fit together.
        DataError
            A recording is unfit or too short, a label is missing, or a class has no window.
        """
        settings = self._settings()
        further = synthetic_sets(synthetic)
        measured = self._training_windows(X, y, groups, further[0].length if further else None)
        validation, rate = None, _ERROR_RATE if self.error_rate is None else self.error_rate
        if self.validation_fraction:
            measured, validation = split_by_recording(
                measured,
                test_fraction=self.validation_fraction,
                seed=self.seed,
                keep_in_training=join_manifests([windows.manifest for windows in further]),
            )
            require_enough(np.unique(validation.recording_id).size, rate)
        for windows in further:
            require_shared_speed(measured, windows)
        windows = with_synthetic(measured, further)
        fitted: FittedClassifier | FittedBaseline
        if self.network is None:
            rate_of_folds = None if validation is not None else self.error_rate
            fitted = fit_chosen(
                windows, budget=self.budget, error_rate=rate_of_folds, seed=self.seed, device=self.device
            )
        elif self.network in BASELINES:
            fitted = fit_baseline(self.network, windows, seed=self.seed)
        else:
            network = self._network(self.network, windows)
            fitted = fit(network, windows, settings=settings, seed=self.seed, device=self.device, progress=progress)
        if validation is not None:
            validation = without_overlap(validation).with_classes(windows.classes)
            fitted = learn_confidence(fitted, validation, error_rate=rate)
        self.fitted_ = fitted
        if windows.classes != tuple(str(name) for name in getattr(self, "classes_", ())):
            self.classes_ = np.array(windows.classes, dtype=np.str_)
        return self

    def predict_proba(self, X: Any) -> np.ndarray:
        """Probability of each class, for each recording, or for each window of a window set or an array.

        Raises
        ------
        DataError
            A recording or a window has no verdict, since a number of its answer is not finite; `diagnose` gives the
            reason and leaves the others their verdict.
        """
        check_is_fitted(self, "fitted_")
        if (recordings := as_recordings(X)) is not None:
            return np.stack([self._recording_probability(recording) for recording in recordings])
        windows = X if isinstance(X, WindowSet) else self._array_windows(X)
        probability = np.asarray(self.fitted_.predict_proba(windows))
        require_verdicts(probability, windows.recording_id)
        return probability

    def predict(self, X: Any) -> np.ndarray:
        """Likeliest class of each recording, or of each window of a window set or an array."""
        probability = self.predict_proba(X)
        return np.asarray(self.classes_[probability.argmax(axis=1)])

    def score(self, X: Any, y: Any = None, sample_weight: Any = None) -> float:
        """Share of the recordings, or of the windows, whose class is right.

        Raises
        ------
        LeakError
            A recording had a part in the training, or a window is synthetic. Arrays are not checked.
        """
        X = list(X) if isinstance(X, Iterator) else X
        if isinstance(X, WindowSet):
            return self.evaluate(X).accuracy
        if as_recordings(X) is not None:
            return self.evaluate(X, y).recording_accuracy
        return float(super().score(X, y, sample_weight))

    def evaluate(self, X: Any, y: Any = None, *, level: str | None = None, seed: int = 0) -> Scores:
        """All scores on recordings, or on a window set, that had no part in the training.

        Parameters
        ----------
        X : recordings with labels, or a window set.
        y : class of each recording; its own label by default.
        level : level of generalization of the test, ``"L0"`` to ``"L5"`` (`LEVELS`); only the caller knows it.
        seed : seed of the bootstrap of the interval.

        Raises
        ------
        LeakError
            A recording had a part in the training, or a window is synthetic.
        InputError
            An array, which does not say which recordings it is of; or a class that was not trained.
        """
        check_is_fitted(self, "fitted_")
        if isinstance(X, WindowSet):
            return evaluate(self.fitted_, X, level=level, seed=seed)
        recordings = as_recordings(X)
        if recordings is None:
            raise InputError("evaluate takes recordings or a window set; an array is scored with score(X, y).")
        windows = cut_windows(
            relabeled(recordings, y),
            length=self.fitted_.layout.length,
            classes=self.fitted_.classes,
            allow_partial_revolution=True,
        )
        return evaluate(self.fitted_, windows, level=level, seed=seed)

    def diagnose(self, recording: Recording, *, error_rate: float | None = None) -> Diagnosis:
        """The class of one recording, how sure that is, and what to doubt; see `swashtwin.diagnosis.diagnose`."""
        check_is_fitted(self, "fitted_")
        return diagnose(self.fitted_, recording, error_rate=error_rate)

    def save(self, path: Path | str) -> Path:
        """`path`, after the trained network was written to it; classes are saved as text.

        Raises
        ------
        ArtifactError
            It is a classifier on features, which has no file format, or its network is not registered.
        """
        check_is_fitted(self, "fitted_")
        if isinstance(self.fitted_, FittedBaseline):
            raise ArtifactError(
                f"a classifier {self.network!r} cannot be saved, only a network; train it again instead."
            )
        return save_classifier(self.fitted_, path)

    @classmethod
    def load(cls, path: Path | str) -> "FaultClassifier":
        """The classifier that `save` wrote; its answers are those of the one saved.

        Raises
        ------
        MissingFileError
            There is no such file.
        ArtifactError
            It is damaged, no classifier, of another version, or its network is not registered here.
        """
        fitted = load_classifier(path)
        training = asdict(fitted.settings)
        usual = asdict(RECOMMENDED_TRAINING)
        other = {
            name: training[name] for name in usual if name not in _OWN_PARAMETERS and training[name] != usual[name]
        }
        settings = fitted.network.settings
        plain = build_network(
            fitted.network.name, settings["n_channels"], settings["n_classes"], length=fitted.length
        ).settings
        network = {name: value for name, value in settings.items() if name not in plain or value != plain[name]}
        named: dict[str, Any] = {
            "network": fitted.network.name,
            **{name: training[name] for name in _OWN_PARAMETERS},
            "training_settings": other or None,
            "network_settings": network or None,
        }
        classifier = cls(
            **({} if fitted.choice is not None else named),
            window=fitted.length,
            sample_rate=fitted.sample_rate,
            seed=fitted.seed,
        )
        classifier.fitted_ = fitted
        classifier.classes_ = np.array(fitted.classes, dtype=np.str_)
        return classifier

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        tags.input_tags.three_d_array = True
        tags.classifier_tags.poor_score = True  # a table of a few columns is no vibration
        return tags

    def _settings(self) -> TrainingSettings:
        if self.network is None:
            usual = type(self)()
            for name in (*_OWN_PARAMETERS, "training_settings", "network_settings"):
                if getattr(self, name) != getattr(usual, name):
                    raise InputError(f"{name} belongs to a network; name it, such as network='spectral_bitcn'.")
        values = {name: getattr(self, name) for name in _OWN_PARAMETERS}
        other = dict(self.training_settings or {})
        unknown = [name for name in other if name not in asdict(RECOMMENDED_TRAINING) or name in values]
        if unknown:
            raise InputError(
                f"training_settings has no field {unknown[0]!r}; it takes fields of TrainingSettings other than "
                f"{', '.join(values)}, which are parameters of FaultClassifier."
            )
        return TrainingSettings(**values, **other)

    def _network(self, name: str, windows: WindowSet) -> Network:
        if not has_network(name):
            raise InputError(
                f"unknown network {name!r}; there are {', '.join(sorted(NETWORKS))}, and on vibration features "
                f"{', '.join(sorted(BASELINES))}. An own one is added with register_network."
            )
        settings = self.network_settings or {}
        return build_network(name, windows.n_channels, len(windows.classes), length=windows.length, **settings)

    def _training_windows(self, X: Any, y: Any, groups: Any, length: int | None) -> WindowSet:
        """Labeled windows, with `classes_` set where `X` is an array; `length` is that of synthetic ones."""
        if isinstance(y, WindowSet):
            raise InputError("y is a window set, and takes classes; give synthetic windows as synthetic=.")
        if isinstance(X, WindowSet):
            require_none(y, groups, "a window set has its own labels and recordings")
            return X
        recordings = as_recordings(X)
        if recordings is None:
            return self._array_windows(X, y, groups, training=True)
        require_none(None, groups, "each recording is a group")
        return cut_windows(
            relabeled(recordings, y),
            length=self.window or length or (usual_window(recordings) if self.network is None else _NETWORK_WINDOW),
            stride=self.stride,
            allow_partial_revolution=self.allow_partial_revolution,
        )

    def _array_windows(self, X: Any, y: Any = None, groups: Any = None, *, training: bool = False) -> WindowSet:
        if training:
            X, y = validate_data(self, X, y, dtype=[np.float32, np.float64], allow_nd=True, ensure_min_samples=2)
            check_classification_targets(y)
            self.classes_, target = np.unique(y, return_inverse=True)
        else:
            X = validate_data(self, X, dtype=[np.float32, np.float64], allow_nd=True, reset=False)
            target = np.full(len(X), -1)
        classes = tuple(str(name) for name in self.classes_)
        return windows_of_array(X, target, classes, groups, float(self.sample_rate))

    def _recording_probability(self, recording: Recording) -> np.ndarray:
        classifier, parts = fit_to_recording(self.fitted_, recording)
        probability = np.concatenate([classifier.predict_proba(windows) for windows in parts()])
        pooled = pooled_probabilities(probability, classifier.confidence)
        require_verdicts(pooled[None], np.array([recording.recording_id]))
        return pooled
