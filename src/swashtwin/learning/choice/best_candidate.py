"""Training by default: the best candidate on all windows, with a confidence from its folds."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from swashtwin.foundation import InputError, one_thread
from swashtwin.learning.choice.candidate_trials import (
    Progress,
    choose_candidate,
)
from swashtwin.learning.choice.candidates import DISTURBED_TRAINING
from swashtwin.learning.evaluation.confidence_calibration import cross_fitted_confidence
from swashtwin.learning.training.classifier import FittedClassifier
from swashtwin.learning.training.confidence import Confidence, require_validation_recordings
from swashtwin.learning.training.fitting import fit, require_trainable
from swashtwin.learning.training.out_of_fold import OutOfFoldPredictions
from swashtwin.learning.training.recording_fitting import fit_recordings
from swashtwin.learning.training.training_reference import TrainingReference
from swashtwin.learning.windows.window_set import WindowSet
from swashtwin.recordings import Manifest


def fit_best_candidate(
    windows: WindowSet,
    *,
    manifest: Manifest | Iterable[str] = (),
    error_rate: float | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> FittedClassifier:
    """Train the candidate that `choose_candidate` chooses, with a cross-fitted confidence.

    If folds leave machines out and recordings have at least 4,096 samples, heads on whole
    recordings join it (`RecordingModel`), each tempered by its answers to held-out machines.
    Without held-out machines nothing would show whether such fine features are those of the fault
    or of the machine. The same seed, windows and machine give the same choice and the same bits.

    Parameters
    ----------
    windows : training windows with labels, measured and synthetic.
    manifest : further recordings, as a manifest or by their ids, that had a part in the windows.
    error_rate : share of recordings whose prediction set may miss the true class; by default that
        of `cross_fitted_confidence`.
    progress : called with (activity, finished, total).

    Raises
    ------
    DataError
        A class has no window, a window has no label, or a sample is far too large.
    InputError
        Too few recordings for the error rate, or a negative seed.
    """
    # Checked first: the trials take much longer than these checks.
    if error_rate is not None:
        _require_recordings(windows, error_rate)
    require_trainable(windows)
    candidate, choice, predictions = choose_candidate(windows, seed=seed, progress=progress)
    fitted = fit(
        candidate.network(windows),
        windows,
        settings=DISTURBED_TRAINING,
        seed=seed,
        manifest=manifest,
        represented=None if predictions is None else predictions.represented,
    )
    reference = fitted.training_reference
    by_machine = choice.group == "specimen"

    baseline_confidence = None
    if predictions is not None and by_machine:
        if progress is not None:
            progress("training on whole recordings", 0, 1)
        with one_thread():
            recording_fit = fit_recordings(windows, predictions, seed)
        if recording_fit is not None:
            model, trial = recording_fit
            has_baseline = model.on_changes is not None
            fitted = replace(fitted, recordings=model)
            choice = replace(choice, head_recalls=trial.recalls(has_baseline))
            if has_baseline:
                with_changes = trial.answers(predictions, with_changes=True)
                baseline_confidence = _confidence(
                    reference, with_changes, error_rate, choice.n_machines
                )
            predictions = trial.answers(predictions, with_changes=False)

    confidence = _confidence(reference, predictions, error_rate, choice.n_machines)
    if confidence is None and error_rate is not None:
        raise InputError(
            f"error_rate ({error_rate:g}) needs a confidence, and without a trial there is none: "
            f"{choice.reason}.",
            field="error_rate",
            remedy="Or leave out {error_rate}.",
        )
    return replace(
        fitted, choice=choice, confidence=confidence, baseline_confidence=baseline_confidence
    )


def _require_recordings(windows: WindowSet, error_rate: float) -> None:
    """Require enough measured recordings for an error rate."""
    measured = windows.subset(~windows.synthetic)
    require_validation_recordings(len(np.unique(measured.recording_id)), error_rate)


def _confidence(
    reference: TrainingReference | None,
    predictions: OutOfFoldPredictions | None,
    error_rate: float | None,
    n_machines: int,
) -> Confidence | None:
    """Return a confidence from the folds.

    It is None without a trial, or if no class has two recordings to compare.

    Parameters
    ----------
    n_machines : machines that the folds left out; 0 if they left out others.
    """
    if reference is None or predictions is None:
        return None

    scores = reference.cross_fitted_scores()
    is_scored = np.isfinite(scores)
    scored_names = np.array(reference.recording_id)[is_scored]
    selected = np.isin(predictions.recording_id, scored_names)
    if not selected.any():
        return None
    is_predicted = np.isin(reference.recording_id, predictions.recording_id)
    return cross_fitted_confidence(
        predictions.probability[selected],
        predictions.recording_id[selected],
        predictions.target[selected],
        scores[is_scored & is_predicted],
        error_rate=error_rate,
        n_machines=n_machines,
    )
