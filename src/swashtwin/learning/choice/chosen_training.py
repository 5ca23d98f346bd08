"""The chosen candidate, trained on everything, with a confidence from its folds."""

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np

from swashtwin.foundation import InputError
from swashtwin.learning.choice.choosing import BUDGET, FoldAnswers, choose, usual_turns
from swashtwin.learning.evaluation.confidence import cross_fitted_confidence
from swashtwin.learning.networks.level_network import LevelNetwork
from swashtwin.learning.training.classifier import FittedClassifier
from swashtwin.learning.training.confidence import Confidence, require_enough
from swashtwin.learning.training.fitting import fit, require_trainable
from swashtwin.learning.training.training_reference import TrainingReference
from swashtwin.learning.windows.window_set import WindowSet
from swashtwin.recordings import Manifest


def fit_chosen(
    windows: WindowSet,
    *,
    manifest: Manifest | Iterable[str] = (),
    budget: float = BUDGET,
    error_rate: float | None = None,
    seed: int = 0,
    progress: Callable[[str, int, int], None] | None = None,
) -> FittedClassifier:
    """Classifier of the candidate that `choose` finds, trained on all windows, with a cross-fitted confidence.

    Same seed, windows and machine: same choice, same bits.

    Parameters
    ----------
    windows : training windows with labels, measured and synthetic.
    manifest : further recordings, as a manifest or by their ids, that had a part in the windows.
    budget : seconds of one core that the choice may take; see `choose`.
    error_rate : share of recordings whose prediction set may miss the true class; by default as
        `cross_fitted_confidence` takes it.
    seed : seed of everything random.
    progress : called with (activity, finished, in all).

    Raises
    ------
    DataError
        A class has no window, a window has no label, or a sample is far too large.
    InputError
        Too few recordings for the error rate, or a negative budget or seed.
    """
    n_recordings = np.unique(windows.recording_id[~windows.synthetic]).size
    if error_rate is not None:
        require_enough(n_recordings, error_rate)
    require_trainable(windows)
    candidate, choice, answers = choose(windows, budget=budget, seed=seed, progress=progress)
    settings = candidate.network_settings(usual_turns(windows))
    network = LevelNetwork(windows.n_channels, len(windows.classes), **settings)
    fitted = fit(network, windows, settings=candidate.training, seed=seed, manifest=manifest)
    confidence = _confidence(fitted.training_reference, answers, error_rate)
    if confidence is None and error_rate is not None:
        raise InputError(
            f"error_rate ({error_rate:g}) needs a confidence, and without a trial there is none: {choice.reason}, or "
            "leave error_rate out."
        )
    return replace(fitted, choice=choice, confidence=confidence)


def _confidence(
    reference: TrainingReference | None, answers: FoldAnswers | None, error_rate: float | None
) -> Confidence | None:
    """Confidence from the folds; None without a trial, or where no class has two recordings to compare."""
    if reference is None or answers is None:
        return None
    scores = reference.cross_fitted_scores()
    scored = np.isfinite(scores)
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
