"""The chosen candidate, trained on everything, with a confidence from its folds."""

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np

from swashtwin.foundation import InputError, one_thread
from swashtwin.learning.choice.candidate_trials import OutOfFoldPredictions, choose_candidate
from swashtwin.learning.choice.candidates import DISTURBED_TRAINING
from swashtwin.learning.evaluation.confidence_calibration import cross_fitted_confidence
from swashtwin.learning.recordings.recording_fitting import fit_recordings
from swashtwin.learning.training.classifier import FittedClassifier
from swashtwin.learning.training.confidence import Confidence, require_validation_recordings
from swashtwin.learning.training.fitting import fit, require_trainable
from swashtwin.learning.training.training_reference import TrainingReference
from swashtwin.learning.windows.window_set import WindowSet
from swashtwin.recordings import Manifest

_LEAST_RECORDINGS = 20
"""Recordings of one machine from which a confidence is learned from it alone."""


def fit_best_candidate(
    windows: WindowSet,
    *,
    manifest: Manifest | Iterable[str] = (),
    error_rate: float | None = None,
    seed: int = 0,
    progress: Callable[[str, int, int], None] | None = None,
) -> FittedClassifier:
    """Classifier of the candidate that `choose_candidate` finds and of heads on whole recordings, with a
    cross-fitted confidence.

    Where folds leave machines out and recordings have 4,096 samples or more, heads on their levels
    join (`RecordingModel`), each tempered by what it said of the machines left out; where none is
    left out, nothing says how far levels so fine are the machine's own. Same seed, windows and
    machine: same choice, same bits.

    Parameters
    ----------
    windows : training windows with labels, measured and synthetic.
    manifest : further recordings, as a manifest or by their ids, that had a part in the windows.
    progress : as in `choose_candidate`.
    error_rate : share of recordings whose prediction set may miss the true class; by default as
        `cross_fitted_confidence` takes it.

    Raises
    ------
    DataError
        A class has no window, a window has no label, or a sample is far too large.
    InputError
        Too few recordings for the error rate, or a negative seed.
    """
    first = np.unique(np.where(windows.synthetic, "", windows.recording_id), return_index=True)[1]
    first = first[~windows.synthetic[first]]
    if (
        error_rate is not None
    ):  # a machine may be the hardest to name, whose recordings it then rests on
        counts = np.unique(windows.specimen[first], return_counts=True)[1]
        require_validation_recordings(
            len(first), error_rate, min(counts[counts >= _LEAST_RECORDINGS].tolist(), default=None)
        )
    require_trainable(windows)
    candidate, choice, answers = choose_candidate(windows, seed=seed, progress=progress)
    network, seen = candidate.network(windows), answers.seen if answers else None
    fitted = fit(
        network, windows, settings=DISTURBED_TRAINING, seed=seed, manifest=manifest, seen=seen
    )
    reference, by_machine = fitted.training_reference, choice.group == "specimen"
    whole, baseline_confidence = None, None
    if answers is not None and by_machine:
        if progress is not None:
            progress("listening to whole recordings", 0, 1)
        with one_thread():
            whole = fit_recordings(windows, answers, seed)
    if whole is not None and answers is not None:
        model, trial = whole
        fitted = replace(fitted, recordings=model)
        with_own = model.on_changes is not None
        choice = replace(choice, head_recalls=trial.recalls(with_own))
        if with_own:
            baseline_confidence = _confidence(
                reference, trial.answers(answers, own=True), error_rate, by_machine
            )
        answers = trial.answers(answers, own=False)
    confidence = _confidence(reference, answers, error_rate, by_machine)
    if confidence is None and error_rate is not None:
        raise InputError(
            f"error_rate ({error_rate:g}) needs a confidence, and without a trial there is none: {choice.reason}, or "
            "leave error_rate out."
        )
    return replace(
        fitted, choice=choice, confidence=confidence, baseline_confidence=baseline_confidence
    )


def _confidence(
    reference: TrainingReference | None,
    answers: OutOfFoldPredictions | None,
    error_rate: float | None,
    by_machine: bool,
) -> Confidence | None:
    """Confidence from the folds; None without a trial, or where no class has two recordings to
    compare.

    Of folds by machine it is that of the machine that was hardest to name: the next one may be as
    unlike the others, and the mean over a few machines says nothing of how far machines differ.
    """
    if reference is None or answers is None:
        return None
    scores = reference.cross_fitted_scores()
    scored = np.isfinite(scores)
    if by_machine and (machine := _hardest_machine(reference, answers)):
        scored &= np.array(reference.specimen) == machine
    chosen = np.isin(answers.recording_id, np.array(reference.recording_id)[scored])
    if not chosen.any():
        return None
    return cross_fitted_confidence(
        answers.probability[chosen],
        answers.recording_id[chosen],
        answers.target[chosen],
        scores[scored & np.isin(reference.recording_id, answers.recording_id)],
        error_rate=error_rate,
    )


def _hardest_machine(reference: TrainingReference, answers: OutOfFoldPredictions) -> str:
    """Machine whose recordings the folds gave the least probability; empty where it has too few for
    a confidence.
    """
    specimen = dict(zip(reference.recording_id, reference.specimen, strict=True))
    of_window = np.array([specimen.get(name, "") for name in answers.recording_id.tolist()])
    right = np.log(
        np.maximum(answers.probability[np.arange(len(answers.target)), answers.target], 1e-12)
    )
    hardest = min(
        np.unique(of_window).tolist(), key=lambda name: float(right[of_window == name].mean())
    )
    return (
        hardest
        if np.unique(answers.recording_id[of_window == hardest]).size >= _LEAST_RECORDINGS
        else ""
    )
