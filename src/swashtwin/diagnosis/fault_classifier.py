"""`FaultClassifier`: from recordings, windows or arrays to classes, by scikit-learn's
conventions.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import KW_ONLY, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

import swashtwin.learning as learning
from swashtwin.diagnosis.classifier_file import load_both, save_classifier
from swashtwin.diagnosis.estimator import Estimator
from swashtwin.diagnosis.prior_classifier import PriorClassifier
from swashtwin.diagnosis.reasons import describe_single_machine_faults
from swashtwin.diagnosis.recording_arguments import as_recordings, relabeled, require_recordings
from swashtwin.diagnosis.recording_diagnosis import diagnose, make_known, recording_probability
from swashtwin.diagnosis.resemblance import NO_CONFIDENCE, find_resemblance
from swashtwin.diagnosis.training_windows import (
    checked_settings,
    classes_of,
    copy_notes,
    hold_out_validation,
    name_alike,
    network_parameters,
    refuse_seen,
    require_none,
    synthetic_sets,
    windows_of_array,
    windows_to_train,
    with_synthetic,
)
from swashtwin.diagnosis.verdict import Diagnosis
from swashtwin.foundation import DataError, InputError
from swashtwin.learning import RECOMMENDED_TRAINING, FittedClassifier, WindowSet, require_verdicts
from swashtwin.recordings import Manifest, Recording, join_manifests

Progress = Callable[[str, int, int], None]


@dataclass(eq=False, repr=False)
class FaultClassifier(Estimator):
    """Classifier of pump faults from vibration, an estimator of scikit-learn, which is imported
    where it is needed.

    `fit`, `predict`, `predict_proba` and `score` take recordings, a `WindowSet`, or an array
    ``(window, channel, sample)`` or ``(window, sample)``. Each recording gets one answer, pooled
    over its windows; else each window does.

    `score` and `evaluate` raise a `LeakError` for a recording that had a part in the training.
    Cross-validation of arrays needs `groups` (``StratifiedGroupKFold``).

    Parameters
    ----------
    network : name of a network (`NETWORKS`; `register_network` adds one). By default the training
        chooses among `CANDIDATES` by trials on inner folds, and learns its confidence from them
        (`fit_best_candidate`).
    window : samples per window and channel that recordings are cut into; a `WindowSet` or an array
        has its own. By default `default_window` of the recordings, or 2048 for the paper's
        ``"bitcn"``.
    stride : samples from one window of a training recording to the next; None lets none overlap.
    allow_partial_revolution : accept windows shorter than one turn of the shaft.
    epochs, batch_size, learning_rate, decay, normalization : see `TrainingSettings`; for networks
    only.
    training_settings : other fields of `TrainingSettings` by name, such as ``{"noise_snr": 0.0}``.
    network_settings : settings of the network by name, such as ``{"dropout": 0.2}``.
    test_fraction : share of the windows whose recordings are held out (`held_out_`); 0 trains on
        all.
    validation_fraction : share of the remaining recordings that calibrate its confidence
        (`learn_confidence`) instead; 0 for none. A network that is named has no confidence without.
    group : what both splits keep whole, and confidence is calibrated for: ``"recording"``,
        ``"specimen"``, ``"condition"``, an attribute of the recordings, or a group by recording id.
    fault_of : fault that a class of the recordings stands for, such as ``{"Kolbenverschleiss":
        "piston"}``: synthetic windows of that fault are then of this class.
    prior : pump prior, or the design of a shipped one, for faults that no recording of the training
        holds: a recording that it takes for one of them is unknown, and the answer says what it
        resembles. Needs recordings, healthy ones of each machine among them.
    error_rate : share of recordings whose prediction set may miss the true class; by default 0.1,
        or the least that the recordings allow.
    sample_rate : samples per second [Hz] of arrays; recordings and window sets state their own.
    device : ``"cpu"``, or a GPU such as ``"cuda"``.
    seed : seed of everything random. The same seed, data and machine give the same bits.

    Attributes
    ----------
    classes_ : classes, in the order of the probabilities.
    fitted_ : the `FittedClassifier`, with its manifest, history, choice and confidence.
    held_out_, validation_ : recordings that were held out to test it, and to calibrate its
    confidence.
    n_windows_, n_synthetic_ : windows it was trained on, and how many of them were synthetic.
    resemblance_ : what the prior says of faults that were not trained; None without `prior`.
    notes_ : what was otherwise than asked for, or should be known.
    n_features_in_ : second dimension of the array that it was fitted on; absent after other data.

    Examples
    --------
    >>> time = np.arange(64) / 1000
    >>> X = np.stack([np.sin(2 * np.pi * f * time) for f in (100, 101, 102, 200, 201, 202)])[:, None]
    >>> y = ["normal"] * 3 + ["piston"] * 3
    >>> FaultClassifier("band_powers", sample_rate=1000.0).fit(X, y).predict(X[:4:3]).tolist()
    ['normal', 'piston']
    """

    network: str | None = None
    _: KW_ONLY
    window: int | None = None
    stride: int | None = None
    allow_partial_revolution: bool = False
    epochs: int = RECOMMENDED_TRAINING.epochs
    batch_size: int = RECOMMENDED_TRAINING.batch_size
    learning_rate: float = RECOMMENDED_TRAINING.learning_rate
    decay: str = RECOMMENDED_TRAINING.decay
    normalization: str = RECOMMENDED_TRAINING.normalization
    training_settings: Mapping[str, Any] | None = None
    network_settings: Mapping[str, Any] | None = None
    test_fraction: float = 0.0
    validation_fraction: float = 0.0
    group: str | Mapping[str, str] = "recording"
    error_rate: float | None = None
    fault_of: Mapping[str, str] | None = None
    prior: PriorClassifier | str | Path | None = None
    sample_rate: float = 1.0
    device: str = "cpu"
    seed: int = 0

    def fit(
        self,
        X: Any,
        y: Any = None,
        *,
        groups: Any = None,
        synthetic: WindowSet | Iterable[WindowSet] | None = None,
        classes: Sequence[str] | None = None,
        checkpoint: Path | str | None = None,
        resume: bool = False,
        progress: Progress | None = None,
    ) -> "FaultClassifier":
        """The same classifier, trained.

        Parameters
        ----------
        X : recordings, a window set, or an array.
        y : class of each recording, or of each window of an array. Without it recordings have their
            own labels; a window set always has its own.
        groups : recording of each window of an array.
        synthetic : further training windows that nobody measured (`synthesize`), one set or
            several.
        classes : class names in the order wanted, of recordings; by default those of synthetic
            windows, or the labels found, sorted.
        checkpoint : file that the training of a named network is saved to after each epoch.
        resume : continue from `checkpoint` if it exists; the result has the same bits as a run
            without interruption.
        progress : called with (activity, finished, in all).

        Raises
        ------
        InputError
            A parameter, or data that do not fit together.
        DataError
            A recording is unfit or too short, a label is missing, or a class has no window.
        LeakError
            A recording that was held out had a part in synthetic windows.
        """
        self._require_parameters()
        settings, tell = (
            checked_settings(self),
            progress or (lambda activity, finished, total: None),
        )
        checkpoint = None if checkpoint is None else Path(checkpoint)
        if checkpoint is not None and checkpoint.exists() and not resume:
            raise InputError(
                f"{checkpoint} exists; resume it, or delete it to start again.", field="resume"
            )
        X, sets = list(X) if isinstance(X, Iterator) else X, synthetic_sets(synthetic)
        further, unlike = name_alike(sets, classes_of(X, y, classes), self.fault_of or {})
        manifest = join_manifests([windows.manifest for windows in further])
        windows, group = self._training_windows(X, y, groups, further, classes)
        training, held_out = windows, windows.subset(windows.target < -1)
        if self.test_fraction:
            training, held_out = learning.split_by_recording(
                windows, test_fraction=self.test_fraction, seed=self.seed, group=group
            )
        training, validation, rate, notes = hold_out_validation(
            training,
            group,
            manifest,
            fraction=self.validation_fraction,
            error_rate=self.error_rate,
            seed=self.seed,
        )
        refuse_seen(held_out, manifest)
        training = with_synthetic(training, further)
        learning.check_disjoint(training, held_out)
        resemblance, of_prior = None, ""
        if self.prior is not None:
            resemblance, of_prior = find_resemblance(
                self.prior, X, y, training, self.fault_of or {}
            )
        fitted: FittedClassifier
        if self.network is None:
            rate_of_folds = None if validation is not None else self.error_rate
            fitted = learning.fit_best_candidate(
                training, error_rate=rate_of_folds, seed=self.seed, progress=tell
            )
        else:
            shape = dict(self.network_settings or {}, length=training.length)
            fitted = learning.fit(
                learning.build_network(
                    self.network, training.n_channels, len(training.classes), **shape
                ),
                training,
                settings=settings,
                seed=self.seed,
                device=self.device,
                checkpoint=checkpoint,
                resume=resume,
                progress=lambda epoch: tell(
                    f"training, loss {epoch.loss:.4f}", epoch.number, settings.epochs
                ),
            )
        if validation is not None:
            fitted = learning.learn_confidence(
                fitted, validation.with_classes(training.classes), error_rate=rate
            )
        if resemblance is not None and fitted.confidence is None:
            resemblance, of_prior = None, NO_CONFIDENCE
        self.fitted_ = replace(fitted, fault_of=dict(self.fault_of or {}))
        self.resemblance_ = resemblance
        self.n_windows_, self.n_synthetic_ = len(training), int(training.synthetic.sum())
        self.held_out_ = tuple(np.unique(held_out.recording_id).tolist())
        self.validation_ = (
            () if validation is None else tuple(np.unique(validation.recording_id).tolist())
        )
        few = (
            [describe_single_machine_faults(fitted.training_reference)]
            if as_recordings(X) is not None
            else []
        )
        self.notes_ = (*notes, *unlike, *copy_notes(windows), *filter(None, (of_prior, *few)))
        if training.classes != tuple(str(name) for name in getattr(self, "classes_", ())):
            self.classes_ = np.array(training.classes, dtype=np.str_)
        return self

    def predict_proba(self, X: Any) -> np.ndarray:
        """Probability of each class, for each recording, or for each window of a window set or an
        array.

        Raises
        ------
        DataError
            A recording or a window has no verdict, since a number of its answer is not finite;
            `diagnose` gives the reason and leaves the others their verdict.
        """
        self._require_fitted()
        if (recordings := as_recordings(X)) is not None:
            return np.stack(
                [recording_probability(self.fitted_, recording) for recording in recordings]
            )
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
            A recording had a part in the training, or a window is synthetic. Arrays are not
            checked.
        """
        X = list(X) if isinstance(X, Iterator) else X
        if isinstance(X, WindowSet):
            return self.evaluate(X).accuracy
        if as_recordings(X) is not None:
            return self.evaluate(X, y).recording_accuracy
        return float(np.average(self.predict(X) == np.asarray(y), weights=sample_weight))

    def evaluate(
        self, X: Any, y: Any = None, *, split: str | None = None, seed: int = 0
    ) -> "learning.Scores":
        """All scores on recordings, or on a window set, that had no part in the training.

        Parameters
        ----------
        X : recordings with labels, or a window set.
        y : class of each recording; its own label by default.
        split : split of the test, ``"L0"`` to ``"L5"`` (`SPLITS`); only the
            caller knows it.
        seed : seed of the bootstrap of the interval.

        Raises
        ------
        LeakError
            A recording had a part in the training, or a window is synthetic.
        InputError
            An array, which does not say which recordings it is of; or a class that was not trained.
        """
        self._require_fitted()
        if isinstance(X, WindowSet):
            return learning.evaluate(self.fitted_, X, split=split, seed=seed)
        recordings = as_recordings(X)
        if recordings is None:
            raise InputError(
                "evaluate takes recordings or a window set; an array is scored with score(X, y)."
            )
        return learning.evaluate(
            self.fitted_, self.cut_windows(relabeled(recordings, y)), split=split, seed=seed
        )

    def cut_windows(self, recordings: Sequence[Recording]) -> WindowSet:
        """Windows of recordings as the trained classifier takes them."""
        self._require_fitted()
        return self.fitted_.cut_windows(recordings)

    @property
    def manifest(self) -> Manifest:
        """Every recording that had a part in it, by id and content."""
        self._require_fitted()
        return self.fitted_.manifest

    def diagnose(
        self,
        recording: Recording,
        *,
        healthy: Iterable[Recording] = (),
        error_rate: float | None = None,
    ) -> Diagnosis:
        """The class of one recording, how sure that is, and what to doubt; see
        `swashtwin.diagnosis.diagnose`.

        Parameters
        ----------
        healthy : as in `with_healthy`, which for many recordings is called once.
        error_rate : of the prediction set and of calling a recording unknown; the classifier's own
            by default.
        """
        self._require_fitted()
        used = self.with_healthy(healthy) if (healthy := list(healthy)) else self
        answer = diagnose(used.fitted_, recording, error_rate=error_rate)
        return answer if used.resemblance_ is None else used.resemblance_.joined(answer, recording)

    def with_healthy(self, healthy: Iterable[Recording]) -> "FaultClassifier":
        """A classifier that compares recordings of machines with these healthy ones too (errors:
        `make_known`).
        """
        self._require_fitted()
        other = copy(self)
        recordings = require_recordings(healthy)
        other.fitted_, other.notes_ = make_known(self.fitted_, recordings)
        try:
            other.resemblance_ = self.resemblance_ and self.resemblance_.with_healthy(recordings)
        except DataError as cause:
            other.notes_ = (
                *other.notes_,
                f"The pump prior does not compare with these healthy recordings: {cause}",
            )
        return other

    def save(self, path: Path | str) -> Path:
        """`path`, after the trained network was written to it; classes are saved as text.

        Raises
        ------
        ArtifactError
            Its network is not registered.
        """
        self._require_fitted()
        return save_classifier(self.fitted_, path, self.resemblance_)

    @classmethod
    def load(cls, path: Path | str) -> "FaultClassifier":
        """The classifier that `save` wrote; its answers are those of the one saved. Errors:
        `load_model`.
        """
        fitted, resemblance = load_both(path)
        classifier = cls(
            **({} if fitted.choice is not None else network_parameters(fitted)),
            window=fitted.length,
            fault_of=dict(fitted.fault_of) or None,
            sample_rate=fitted.sample_rate,
            seed=fitted.seed,
        )
        classifier.fitted_, classifier.resemblance_ = fitted, resemblance
        classifier.classes_ = np.array(fitted.classes, dtype=np.str_)
        return classifier

    def _training_windows(
        self,
        X: Any,
        y: Any,
        groups: Any,
        further: Sequence[WindowSet],
        classes: Sequence[str] | None,
    ) -> tuple[WindowSet, str | Mapping[str, str]]:
        """(labeled windows, what a split keeps whole), with `classes_` set where `X` is an
        array.
        """
        if isinstance(X, WindowSet):
            require_none(y, groups, "a window set has its own labels and recordings")
            return X, self.group
        recordings = as_recordings(X)
        if recordings is None:
            return self._array_windows(X, y, groups, training=True), self.group
        require_none(None, groups, "each recording is a group")
        return windows_to_train(self, relabeled(recordings, y), further, classes)

    def _array_windows(
        self, X: Any, y: Any = None, groups: Any = None, *, training: bool = False
    ) -> WindowSet:
        from sklearn.utils.multiclass import check_classification_targets
        from sklearn.utils.validation import validate_data

        if training:
            X, y = validate_data(
                self, X, y, dtype=[np.float32, np.float64], allow_nd=True, ensure_min_samples=2
            )
            check_classification_targets(y)
            self.classes_, target = np.unique(y, return_inverse=True)
        else:
            X = validate_data(self, X, dtype=[np.float32, np.float64], allow_nd=True, reset=False)
            target = np.full(len(X), -1)
        return windows_of_array(
            X, target, tuple(map(str, self.classes_)), groups, float(self.sample_rate)
        )
