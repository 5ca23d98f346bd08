"""`FaultClassifier`: from recordings, windows or arrays to classes, as scikit-learn does it."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import KW_ONLY, asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

# Through the room, whose door imports a training function only when it is called.
import swashtwin.learning as learning
from swashtwin.diagnosis.classifier_file import load_classifier_parts, save_classifier
from swashtwin.diagnosis.estimator import Estimator
from swashtwin.diagnosis.prior_classifier import PriorClassifier
from swashtwin.diagnosis.reasons import (
    UNNAMED_MACHINE,
    describe_missing_comparison,
    describe_single_machine_faults,
)
from swashtwin.diagnosis.recording_arguments import (
    as_recordings,
    relabel_recordings,
    require_recordings,
)
from swashtwin.diagnosis.recording_diagnosis import (
    add_healthy_recordings,
    diagnose,
    recording_probability,
)
from swashtwin.diagnosis.resemblance import NO_CONFIDENCE_NOTE, find_resemblance
from swashtwin.diagnosis.training_windows import (
    cut_training_windows,
    list_synthetic_sets,
    measured_classes,
    require_array_arguments,
    require_plain_array,
    unify_class_names,
    windows_of_array,
)
from swashtwin.diagnosis.verdict import Diagnosis
from swashtwin.foundation import DataError, InputError
from swashtwin.learning import RECOMMENDED_TRAINING, FittedClassifier, WindowSet, require_verdicts
from swashtwin.pump import is_healthy
from swashtwin.recordings import Manifest, Recording, recording_groups

Progress = Callable[[str, int, int], None]
"""Called with the activity, and with how many of how many steps are finished."""

# Fields of `TrainingSettings` that are parameters of a `FaultClassifier`.
_TRAINING_PARAMETERS = ("epochs", "batch_size", "learning_rate", "decay", "normalization")

# Settings of a network that follow from the windows.
_SIZE_SETTINGS = ("n_channels", "n_classes", "length")


@dataclass(eq=False, repr=False)
class FaultClassifier(Estimator):
    """Classifier of pump faults from vibration, an estimator of scikit-learn.

    `fit`, `predict`, `predict_proba` and `score` take recordings, a `WindowSet`, or an array
    ``(window, channel, sample)`` or ``(window, sample)``. Each recording gets one answer, pooled
    over its windows; of window sets and arrays, each window gets one.

    `score` and `evaluate` raise a `LeakError` for a recording that had a part in the training.
    Cross-validation of arrays needs `groups` (``StratifiedGroupKFold``).

    Parameters
    ----------
    network : name of a network (`NETWORKS`; `register_network` adds one). By default the training
        selects among `CANDIDATES` by trials on inner folds, and learns its confidence from them
        (`fit_best_candidate`).
    window : samples per window and channel that recordings are cut into; a `WindowSet` or an array
        is cut already. By default `default_window` of the recordings, or 2048 for the paper's
        ``"bitcn"``.
    stride : samples from one window of a training recording to the next; None for no overlap.
    allow_partial_revolution : accept windows shorter than one revolution of the shaft.
    epochs, batch_size, learning_rate, decay, normalization : see `TrainingSettings`; for networks
        only.
    training_settings : further fields of `TrainingSettings` by name, such as
        ``{"noise_snr": 0.0}``.
    network_settings : settings of the network by name, such as ``{"dropout": 0.2}``.
    test_fraction : share of the windows whose recordings are held out (`held_out_`); 0 to train on
        all.
    validation_fraction : share of the remaining recordings that calibrate the confidence
        (`learn_confidence`); 0 for none. A named network has no confidence without it.
    group : what both splits keep whole, and what the confidence is calibrated for:
        ``"recording"``, ``"specimen"``, ``"condition"``, an attribute of the recordings, or a group
        by recording id.
    error_rate : target miscoverage of the prediction sets; by default 0.1, or the lowest rate that
        the recordings allow.
    fault_of : fault that a class of the recordings stands for, so that synthetic windows of that
        fault are of this class: ``{"Kolbenverschleiss": "piston"}``.
    prior : pump prior, or the design of a shipped one, for faults that no training recording shows.
        A recording that it takes for such a fault is unknown, and the answer states what it
        resembles. Needs recordings, healthy ones of each machine among them.
    sample_rate : samples per second [Hz] of arrays; recordings and window sets specify theirs.
    device : ``"cpu"``, or a GPU such as ``"cuda"``.
    seed : seed of everything random. The same seed, data and machine give the same bits.

    Attributes
    ----------
    classes_ : classes, in the order of the probabilities.
    fitted_ : the `FittedClassifier`, with its manifest, history, choice and confidence.
    held_out_, validation_ : recordings that were held out to test it, and to calibrate its
        confidence.
    n_windows_, n_synthetic_ : number of training windows, and how many of them were synthetic.
    resemblance_ : the adapted prior for faults that were not trained; None without `prior`.
    notes_ : deviations from what was requested, and limits of the data, as sentences.
    n_features_in_ : number of channels; after an array ``(window, sample)`` the number of samples.

    Examples
    --------
    >>> time = np.arange(64) / 1000
    >>> frequencies = (100, 101, 102, 200, 201, 202)
    >>> X = np.stack([np.sin(2 * np.pi * f * time) for f in frequencies])[:, None]
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
        synthetic: WindowSet | Iterable[WindowSet] | learning.TrainingFiller | None = None,
        classes: Sequence[str] | None = None,
        checkpoint: Path | str | None = None,
        resume: bool = False,
        progress: Progress | None = None,
    ) -> "FaultClassifier":
        """Train the classifier and return it.

        Parameters
        ----------
        X : recordings, a window set, or an array.
        y : class of each recording, or of each window of an array. By default recordings have their
            own labels; a window set always has its own.
        groups : recording of each window of an array.
        synthetic : further training windows that nobody measured (`synthesize`), one set or
            several; or a `Filling`, which makes them for the recordings that are not held out.
        classes : class names of recordings in their order; by default those of the synthetic
            windows, or the labels, sorted.
        checkpoint : file to which the training of a named network is saved after each epoch.
        resume : continue from `checkpoint` if it exists; the result has the same bits as a run
            without interruption.
        progress : called with the activity, and with how many of how many steps are finished.

        Raises
        ------
        InputError
            A parameter is invalid, or data do not fit together.
        DataError
            A recording cannot be used or is too short, a label is missing, or a class has no
            window.
        LeakError
            A recording that was held out had a part in synthetic windows.
        """
        self._require_parameters()
        settings = self.make_training_settings()
        checkpoint = _checkpoint_path(checkpoint, resume)
        report = progress or _ignore_progress
        X = list(X) if isinstance(X, Iterator) else X

        filler = None
        filler_notes: tuple[str, ...] = ()
        if isinstance(synthetic, learning.TrainingFiller):
            filler = synthetic
            synthetic = None
            recordings = as_recordings(X)
            if recordings is not None:
                filler_notes = filler.check(recordings)
        synthetic_sets, class_notes = unify_class_names(
            list_synthetic_sets(synthetic), measured_classes(X, y, classes), self.fault_of or {}
        )
        measured, group = self._measured_windows(X, y, groups, synthetic_sets, classes)
        data = learning.prepare_training_data(
            measured,
            synthetic_sets,
            filler=filler,
            test_fraction=self.test_fraction,
            validation_fraction=self.validation_fraction,
            group=group,
            error_rate=self.error_rate,
            seed=self.seed,
        )

        resemblance = None
        prior_note = ""
        if self.prior is not None:
            resemblance, prior_note = find_resemblance(
                self.prior, X, y, data.training, self.fault_of or {}
            )

        fitted: FittedClassifier
        if self.network is None:
            fitted = self._fit_best_candidate(data, report)
        else:
            fitted = self._fit_network(self.network, data, settings, checkpoint, resume, report)
        if data.validation is not None:
            fitted = learning.learn_confidence(fitted, data.validation, error_rate=data.error_rate)
        if resemblance is not None and fitted.confidence is None:
            resemblance = None
            prior_note = NO_CONFIDENCE_NOTE

        machine_notes: tuple[str, ...] = ()
        if as_recordings(X) is not None:
            machine_notes = (
                describe_single_machine_faults(fitted.training_reference),
                describe_missing_comparison(fitted),
            )

        self.fitted_ = replace(fitted, fault_of=dict(self.fault_of or {}))
        self.resemblance_ = resemblance
        self.n_windows_ = len(data.training)
        self.n_synthetic_ = int(data.training.synthetic.sum())
        self.held_out_ = data.test_recordings
        self.validation_ = data.validation_recordings
        notes = (*filler_notes, *data.notes, *class_notes, prior_note, *machine_notes)
        self.notes_ = tuple(note for note in notes if note)
        self._set_classes(data.training.classes)
        return self

    def predict_proba(self, X: Any) -> np.ndarray:
        """Return the probability of each class, for each recording, or else for each window.

        Raises
        ------
        DataError
            A recording or a window has no verdict, because a number of its answer is not finite;
            `diagnose` gives the reason and leaves the others their verdict.
        """
        self._require_fitted()
        recordings = as_recordings(X)
        if recordings is not None:
            return np.stack(
                [recording_probability(self.fitted_, recording) for recording in recordings]
            )

        windows = X if isinstance(X, WindowSet) else self._unlabeled_windows(X)
        probability = np.asarray(self.fitted_.predict_proba(windows))
        require_verdicts(probability, windows.recording_id)
        return probability

    def predict(self, X: Any) -> np.ndarray:
        """Return the likeliest class of each recording, or else of each window."""
        probability = self.predict_proba(X)
        return np.asarray(self.classes_[probability.argmax(axis=1)])

    def score(self, X: Any, y: Any = None, sample_weight: Any = None) -> float:
        """Return the accuracy on recordings, or on windows.

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
        """Return all scores on recordings or windows that had no part in the training.

        Parameters
        ----------
        X : recordings with labels, or a window set.
        y : class of each recording; its own label by default.
        split : split of the test, ``"L0"`` to ``"L5"`` (`SPLITS`), which only the caller knows.
        seed : seed of the bootstrap of the interval.

        Raises
        ------
        LeakError
            A recording had a part in the training, or a window is synthetic.
        InputError
            `X` is an array, which does not name its recordings; or a class was not trained.
        """
        self._require_fitted()
        if isinstance(X, WindowSet):
            return learning.evaluate(self.fitted_, X, split=split, seed=seed)

        recordings = as_recordings(X)
        if recordings is None:
            raise InputError(
                "evaluate takes recordings or a window set; an array is scored with score(X, y)."
            )
        windows = self.cut_windows(relabel_recordings(recordings, y))
        return learning.evaluate(self.fitted_, windows, split=split, seed=seed)

    def cut_windows(self, recordings: Sequence[Recording]) -> WindowSet:
        """Return recordings as windows that the trained classifier takes."""
        self._require_fitted()
        return self.fitted_.cut_windows(recordings)

    @property
    def manifest(self) -> Manifest:
        """Every recording that had a part in it, by id and content."""
        self._require_fitted()
        return self.fitted_.manifest

    def diagnose(self, recording: Recording, *, error_rate: float | None = None) -> Diagnosis:
        """Return the class of one recording, its certainty, and what limits it.

        See `swashtwin.diagnosis.diagnose`; `with_healthy` adds recordings to compare with.

        Parameters
        ----------
        error_rate : of the prediction set and of calling a recording unknown; the classifier's own
            by default.
        """
        self._require_fitted()
        diagnosis = diagnose(self.fitted_, recording, error_rate=error_rate)
        if self.resemblance_ is None:
            return diagnosis
        return self.resemblance_.extend_diagnosis(diagnosis, recording)

    def with_healthy(self, healthy: Iterable[Recording]) -> "FaultClassifier":
        """Return a classifier that also compares with these healthy recordings of machines.

        Errors: see `add_healthy_recordings`.
        """
        self._require_fitted()
        recordings = require_recordings(healthy)
        classifier = copy(self)
        classifier.fitted_, classifier.notes_ = add_healthy_recordings(self.fitted_, recordings)

        if self.resemblance_ is not None:
            try:
                classifier.resemblance_ = self.resemblance_.with_healthy(recordings)
            except DataError as cause:
                note = f"The pump prior does not compare with these healthy recordings: {cause}"
                classifier.notes_ = (*classifier.notes_, note)
        return classifier

    def save(self, path: Path | str) -> Path:
        """Write the trained classifier to `path` and return the path; classes become text.

        Raises
        ------
        ArtifactError
            Its network is not registered.
        """
        self._require_fitted()
        return save_classifier(self.fitted_, path, self.resemblance_, self.group)

    @classmethod
    def load(cls, path: Path | str) -> "FaultClassifier":
        """Return the classifier that `save` wrote, with the same answers.

        Errors: see `load_model`.
        """
        fitted, resemblance, group = load_classifier_parts(path)
        was_selected = fitted.choice is not None
        parameters = {} if was_selected else _network_parameters(fitted)

        classifier = cls(
            **parameters,
            window=fitted.layout.length,
            group=group,
            fault_of=dict(fitted.fault_of) or None,
            sample_rate=fitted.layout.sample_rate,
            seed=fitted.seed,
        )
        classifier.fitted_ = fitted
        classifier.resemblance_ = resemblance
        classifier.n_features_in_ = len(fitted.layout.channels)
        classifier._set_classes(fitted.classes)
        return classifier

    def make_training_settings(self) -> learning.TrainingSettings:
        """Return the settings of the training that the parameters specify.

        Raises
        ------
        InputError
            A parameter belongs to a network, but none is named; or a setting does not exist.
        """
        if self.network is None:
            network_parameters = (
                *_TRAINING_PARAMETERS,
                "training_settings",
                "network_settings",
                "device",
            )
            for name in self.changed_params():
                if name in network_parameters:
                    raise InputError(
                        f"{name} belongs to a network.",
                        field="network",
                        remedy="Name it, such as {network='bitcn'}.",
                    )

        parameters = {name: getattr(self, name) for name in _TRAINING_PARAMETERS}
        further_settings = dict(self.training_settings or {})
        for name in further_settings:
            if name not in asdict(RECOMMENDED_TRAINING) or name in parameters:
                raise InputError(
                    f"training_settings has no field {name!r}; it takes fields of TrainingSettings "
                    f"other than {', '.join(parameters)}, which are parameters of FaultClassifier."
                )
        return learning.TrainingSettings(**parameters, **further_settings)

    def _measured_windows(
        self,
        X: Any,
        y: Any,
        groups: Any,
        synthetic_sets: Sequence[WindowSet],
        classes: Sequence[str] | None,
    ) -> tuple[WindowSet, str | Mapping[str, str]]:
        """Return labeled windows, and what a split keeps whole; set `n_features_in_`."""
        if isinstance(X, WindowSet):
            require_array_arguments(y, groups, "a window set has its own labels and recordings")
            self.n_features_in_ = X.n_channels
            return X, self.group

        recordings = as_recordings(X)
        if recordings is None:
            return self._labeled_windows(X, y, groups), self.group

        require_array_arguments(None, groups, "each recording is a group")
        labeled = relabel_recordings(recordings, y)
        group = self.group
        if not isinstance(group, Mapping):
            group = recording_groups(labeled, group)
        windows = cut_training_windows(
            labeled,
            synthetic_sets,
            network=self.network,
            length=self.window,
            stride=self.stride,
            classes=classes,
            allow_partial_revolution=self.allow_partial_revolution,
        )
        self.n_features_in_ = windows.n_channels
        return windows, group

    def _labeled_windows(self, X: Any, y: Any, groups: Any) -> WindowSet:
        """Return the windows of an array to train on, and set `classes_` by its labels `y`."""
        from sklearn.utils.multiclass import check_classification_targets
        from sklearn.utils.validation import validate_data

        require_plain_array(X)
        X, y = validate_data(
            self, X, y, dtype=[np.float32, np.float64], allow_nd=True, ensure_min_samples=2
        )
        check_classification_targets(y)
        self.classes_, target = np.unique(y, return_inverse=True)
        return self._array_windows(X, target, groups)

    def _unlabeled_windows(self, X: Any) -> WindowSet:
        from sklearn.utils.validation import validate_data

        require_plain_array(X)
        if self.n_features_in_ == 1 and np.ndim(X) == 2:
            # the only channel may be left out
            X = np.asarray(X)[:, None]
        X = validate_data(self, X, dtype=[np.float32, np.float64], allow_nd=True, reset=False)
        return self._array_windows(X, np.full(len(X), -1), None)

    def _array_windows(self, X: np.ndarray, target: np.ndarray, groups: Any) -> WindowSet:
        classes = tuple(map(str, self.classes_))
        return windows_of_array(X, target, classes, groups, float(self.sample_rate))

    def _fit_best_candidate(
        self, data: learning.TrainingData, report: Progress
    ) -> FittedClassifier:
        # A validation set calibrates the confidence in place of the folds.
        error_rate = self.error_rate if data.validation is None else None
        return learning.fit_best_candidate(
            data.training, error_rate=error_rate, seed=self.seed, progress=report
        )

    def _fit_network(
        self,
        name: str,
        data: learning.TrainingData,
        settings: learning.TrainingSettings,
        checkpoint: Path | None,
        resume: bool,
        report: Progress,
    ) -> FittedClassifier:
        training = data.training
        network_settings = {**(self.network_settings or {}), "length": training.length}
        network = learning.build_network(
            name, training.n_channels, len(training.classes), **network_settings
        )

        def report_epoch(epoch: learning.Epoch) -> None:
            report(f"training, loss {epoch.loss:.4f}", epoch.number, settings.epochs)

        return learning.fit(
            network,
            training,
            settings=settings,
            seed=self.seed,
            device=self.device,
            checkpoint=checkpoint,
            resume=resume,
            progress=report_epoch,
        )

    def _set_classes(self, classes: tuple[str, ...]) -> None:
        """Set `classes_`, unless an array has set the same classes in the type of its labels."""
        if classes != tuple(str(name) for name in getattr(self, "classes_", ())):
            self.classes_ = np.array(classes, dtype=np.str_)


def compare_with_healthy(
    model: object, reference: Iterable[Recording], recordings: Iterable[Recording]
) -> tuple[FaultClassifier, list[Recording]]:
    """Return a classifier that compares with the healthy ones of some recordings.

    If these are of one machine, recordings that specify no machine are of it too. They are also
    returned, as the classifier takes them.

    Parameters
    ----------
    reference : recordings of which those of another class than healthy are ignored.
    recordings : recordings to diagnose.

    Raises
    ------
    InputError
        The model is not a classifier, or no recording is healthy; further errors: see
        `FaultClassifier.with_healthy`.
    """
    if not isinstance(model, FaultClassifier):
        raise InputError(
            "Only a classifier compares with healthy recordings.",
            field="healthy",
            remedy="Omit {healthy}.",
        )
    healthy = [
        recording
        for recording in reference
        if recording.label is None or is_healthy(recording.label)
    ]
    if not healthy:
        raise InputError(
            "No recording to compare with is healthy. Specify a folder or an index that has one.",
            field="healthy",
        )

    compared = list(recordings)
    machines = {recording.specimen or "" for recording in healthy}
    if len(machines) == 1:
        machine = machines.pop() or UNNAMED_MACHINE
        healthy = [recording.replace(specimen=machine) for recording in healthy]
        compared = [
            recording if recording.specimen else recording.replace(specimen=machine)
            for recording in compared
        ]
    return model.with_healthy(healthy), compared


def _checkpoint_path(checkpoint: Path | str | None, resume: bool) -> Path | None:
    if checkpoint is None:
        return None
    path = Path(checkpoint)
    if path.exists() and not resume:
        raise InputError(
            f"{path} exists.",
            field="resume",
            remedy="Set {resume} to continue it, or delete it to start again.",
        )
    return path


def _ignore_progress(activity: str, n_finished: int, n_steps: int) -> None:
    pass


def _network_parameters(fitted: FittedClassifier) -> dict[str, Any]:
    """Return the parameters of a `FaultClassifier` that trains such a network."""
    settings = asdict(fitted.settings)
    default_settings = asdict(RECOMMENDED_TRAINING)
    further_settings = {
        name: settings[name]
        for name, default in default_settings.items()
        if name not in _TRAINING_PARAMETERS and settings[name] != default
    }

    network = fitted.network
    default_network = learning.default_settings(learning.network_class(network.name))
    network_settings = {
        name: value
        for name, value in network.settings.items()
        if name not in _SIZE_SETTINGS and value != default_network.get(name)
    }

    parameters = {name: settings[name] for name in _TRAINING_PARAMETERS}
    return {
        "network": network.name,
        **parameters,
        "training_settings": further_settings or None,
        "network_settings": network_settings or None,
    }
