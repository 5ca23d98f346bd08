"""Choice of a candidate by trials on inner folds, as training does by default."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64, Shaped

from swashtwin.foundation import DataError, InputError, derive_seed, one_thread, random_stream
from swashtwin.learning.choice.candidates import (
    CANDIDATES,
    DISTURBED_TRAINING,
    Candidate,
)
from swashtwin.learning.networks.feature_network import FeatureNetwork, solve_together
from swashtwin.learning.training.candidate_choice import CandidateChoice, Trial
from swashtwin.learning.training.classifier import Normalization
from swashtwin.learning.training.confidence import likeliest_class
from swashtwin.learning.training.fitting import RepresentedWindows
from swashtwin.learning.training.out_of_fold import OutOfFoldPredictions
from swashtwin.learning.training.training_settings import (
    transform_windows,
    with_gains,
    with_speed_changes,
)
from swashtwin.learning.windows.splitting import (
    Fold,
    fold_training_rows,
    group_folds,
    window_groups,
    without_overlap,
)
from swashtwin.learning.windows.window_set import WindowSet
from swashtwin.signals import NoiseKind, unit_noise

MAX_WINDOWS = 3000
"""Measured windows of a trial; if there are more, every recording lends its share."""
MAX_FOLDS = 6
"""Maximum number of inner folds: each of up to six machines is held out once."""
MIN_RANKING_MACHINES = 4
"""Held-out machines from which the highest score decides.

Bearings have one class each, so that scores of single bearings are near 0 or 1. The standard error
between them is then as large as any difference between candidates, and everything would be tied.
With two or three machines, one that a candidate suits by chance decides.
"""
TEST_SNR_DB = 5.0
"""Signal-to-noise ratio of the noisy test sides."""
TEST_GAIN_DB = 12.0
"""Largest gain of the disturbed test sides."""
TEST_STRETCH = 0.02
"""Largest relative change of speed of the disturbed test sides."""
_NOISE_KINDS: tuple[NoiseKind, ...] = ("white", "pink", "hum")

# Allowance for rounding, so that a score exactly one standard error below the best is tied.
_TIE_TOLERANCE = 1e-12

Progress = Callable[[str, int, int], None]
"""Called with (activity, finished, total)."""
LogProbability = Float64[np.ndarray, "window class"]


def choose_candidate(
    windows: WindowSet, *, seed: int = 0, progress: Progress | None = None
) -> tuple[Candidate, CandidateChoice, OutOfFoldPredictions | None]:
    """Choose one of `CANDIDATES` by trials on inner folds.

    Measured windows are dealt into folds by specimen, else by condition, else by recording: the
    hardest grouping in which every class stands in two groups. Each candidate is trained on the
    other folds and on the synthetic windows that were made without the tested fold
    (`fold_training_rows`). It is tested on the fold as it was measured, under noise at 5 dB, and
    under gains of ±12 dB with speeds of ±2 %, by recording. If the folds hold out four machines or
    more, the candidate of the highest score is chosen. Otherwise the groups are few, or the folds
    do not show what changes from machine to machine: then the first candidate is chosen whose score
    is within one standard error of the best (between the groups; Breiman and others 1984,
    "Classification and Regression Trees").

    Returns
    -------
    candidate : the chosen one.
    choice : what was tried.
    predictions : the chosen candidate's answers across the folds; None without a trial.

    Raises
    ------
    InputError
        A negative seed.
    """
    if seed < 0:
        raise InputError(f"seed ({seed}) must not be negative.")
    report = progress or _report_nothing
    # Overlapping windows would count one moment of a recording twice.
    measured = _limit_windows(without_overlap(windows.subset(~windows.synthetic)))
    group, folds = _inner_folds(measured, seed)
    if not folds:
        candidate = CANDIDATES[0]
        reason = (
            "there are too few recordings of a class to test on some of them; record more of each "
            "class"
        )
        return candidate, CandidateChoice(candidate.name, (), "", 0, 0, reason), None

    with one_thread():
        views = _Views(measured, windows.subset(windows.synthetic), seed)
        log_probability = _test_candidates(views, folds, seed, report)

    groups = window_groups(measured, group)
    trials = _score_trials(log_probability, measured, groups)
    n_machines = len(np.unique(groups)) if group == "specimen" else 0
    candidate = _select_candidate(trials, n_machines)
    predictions = _out_of_fold_predictions(
        candidate, views, windows, folds, log_probability[candidate.name][0]
    )
    choice = CandidateChoice(
        candidate=candidate.name,
        trials=tuple(trials),
        group=group,
        n_folds=len(folds),
        n_windows=len(predictions.target),
        reason="",
        n_machines=n_machines,
    )
    return candidate, choice, predictions


def _report_nothing(activity: str, finished: int, total: int) -> None:
    """Ignore the progress, if the caller does not follow it."""


def _limit_windows(measured: WindowSet) -> WindowSet:
    """Return at most `MAX_WINDOWS` windows, the same number of each recording."""
    if len(measured) <= MAX_WINDOWS:
        return measured

    # The first windows of each recording, in a row: their dependence is that of a recording.
    names, recording = np.unique(measured.recording_id, return_inverse=True)
    share = max(1, MAX_WINDOWS // len(names))
    rows = [np.flatnonzero(recording == number)[:share] for number in range(len(names))]
    return measured.subset(np.sort(np.concatenate(rows)))


def _inner_folds(measured: WindowSet, seed: int) -> tuple[str, tuple[Fold, ...]]:
    """Return what the folds keep whole, and the folds; ("", ()) if recordings cannot be dealt."""
    present = np.unique(measured.target)
    windows = measured.with_classes([measured.classes[index] for index in present])
    for group in ("specimen", "condition", "recording"):
        try:
            groups = window_groups(measured, group)
        except DataError:
            continue

        groups_by_class = [len(np.unique(groups[measured.target == index])) for index in present]
        if len(groups_by_class) < 2 or min(groups_by_class) < 2:
            continue

        # Fewer folds may succeed if a class stands in fewer groups.
        for n_folds in range(min(MAX_FOLDS, len(np.unique(groups))), 1, -1):
            try:
                return group, group_folds(windows, group=group, n_folds=n_folds, seed=seed)
            except (DataError, InputError):
                continue
    return "", ()


_VIEWS = ("clean", "noise", "gain and speed")
_WindowFeatures = Float32[np.ndarray, "window channel feature"]


class _Views:
    """Features of all windows, clean and disturbed: those to train on, and those to test under."""

    def __init__(self, measured: WindowSet, synthetic: WindowSet, seed: int) -> None:
        self.windows = measured + synthetic
        self.measured = measured
        self.synthetic = synthetic
        self._normalization = Normalization.fit("set", self.windows)
        # One network for each kind of features, which measures them for all of its candidates.
        self._networks: dict[str, FeatureNetwork] = {}
        for candidate in CANDIDATES:
            self._networks.setdefault(candidate.features, candidate.network(self.windows))

        noise_rng, change_rng = (random_stream(seed, "trial", view) for view in _VIEWS[1:])
        noisy = _add_test_noise(measured, noise_rng)
        faster = with_speed_changes(measured.signal, TEST_STRETCH, change_rng)
        changed = with_gains(faster, TEST_GAIN_DB, change_rng)

        clean = self._features(self.windows)
        self.tests = [
            {kind: features[: len(measured)] for kind, features in clean.items()},
            self._features(replace(measured, signal=noisy)),
            self._features(replace(measured, signal=changed)),
        ]
        """Features of the measured windows under each of `_VIEWS`, by `Candidate.features`."""

        passes = [clean]
        rows = [np.arange(len(self.windows))]
        for number in range(DISTURBED_TRAINING.epochs):
            epoch_rows, disturbed = transform_windows(
                self.windows, DISTURBED_TRAINING, seed, number + 1
            )
            if len(epoch_rows):
                passes.append(self._features(disturbed))
                rows.append(epoch_rows)
        self.training_features = {
            kind: np.concatenate([features[kind] for features in passes]) for kind in clean
        }
        """Features of every training pass, clean and disturbed, by `Candidate.features`."""
        self.training_rows = np.concatenate(rows)
        """Index of the window behind each."""

    def _features(self, windows: WindowSet) -> dict[str, _WindowFeatures]:
        blocks: dict[str, list[_WindowFeatures]] = {kind: [] for kind in self._networks}
        for samples, turns in self._normalization.blocks(windows):
            for kind, network in self._networks.items():
                blocks[kind].append(network.measure_at(samples, turns))
        return {kind: np.concatenate(features) for kind, features in blocks.items()}


def _add_test_noise(measured: WindowSet, rng: np.random.Generator) -> np.ndarray:
    """Return the samples with noise of each kind on a third of the windows."""
    noisy = measured.signal.copy()
    scale = np.sqrt(noisy.var(axis=-1, keepdims=True) * 10 ** (-TEST_SNR_DB / 10))
    for index, kind in enumerate(_NOISE_KINDS):
        rows = slice(index, None, len(_NOISE_KINDS))
        noise = unit_noise(noisy[rows].shape, rng, kind, measured.sample_rate)
        noisy[rows] += scale[rows] * noise.astype(np.float32)
    return noisy


def _test_candidates(
    views: _Views, folds: tuple[Fold, ...], seed: int, report: Progress
) -> dict[str, list[LogProbability]]:
    """Return log-probabilities of the measured windows under each view, by candidate.

    Each window's come from the fold that tested it.
    """
    networks = {candidate.name: candidate.network(views.windows) for candidate in CANDIDATES}
    shape = (len(views.measured), len(views.windows.classes))
    log_probability: dict[str, list[LogProbability]] = {}
    for name in networks:
        log_probability[name] = [np.full(shape, np.nan) for _ in _VIEWS]

    windows = views.windows
    for number, (_, tested) in enumerate(folds):
        report("trying candidates", number, len(folds))
        # The measured windows are the first ones, so that the indices of a fold hold for all.
        trained = fold_training_rows(windows.target, windows.specimen, windows.synthetic, tested)
        is_used = np.isin(views.training_rows, trained)
        target = windows.target[views.training_rows[is_used]]
        for kind, all_features in views.training_features.items():
            features = all_features[is_used]
            members = [networks[each.name] for each in CANDIDATES if each.features == kind]
            values = [network.shaped(features) for network in members]
            # Together, so that they share all draws and differ by the gain only.
            solve_together(members, values, target, derive_seed(seed, "trial", number))

        for candidate in CANDIDATES:
            network = networks[candidate.name]
            for view, test_features in enumerate(views.tests):
                scores = network.scores(network.shaped(test_features[candidate.features][tested]))
                log_probability[candidate.name][view][tested] = scores
    report("trying candidates", len(folds), len(folds))
    return log_probability


def _out_of_fold_predictions(
    candidate: Candidate,
    views: _Views,
    windows: WindowSet,
    folds: tuple[Fold, ...],
    log_probability: LogProbability,
) -> OutOfFoldPredictions:
    """Return the answers of the chosen candidate to the clean windows, across the folds."""
    measured = views.measured
    tested_rows = np.sort(np.concatenate([tested for _, tested in folds]))
    fold = np.full(len(measured), -1)
    for number, (_, tested) in enumerate(folds):
        fold[tested] = number

    # The final fit may reuse the features of the trial, if the trial dropped no window.
    represented = None
    has_all_windows = len(windows) == len(views.windows)
    if has_all_windows and windows.fingerprint() == views.windows.fingerprint():
        network = candidate.network(windows)
        represented = RepresentedWindows(
            network.shaped(views.training_features[candidate.features]), views.training_rows
        )
    return OutOfFoldPredictions(
        probability=np.exp(log_probability[tested_rows]),
        target=measured.target[tested_rows],
        recording_id=measured.recording_id[tested_rows],
        fold=fold[tested_rows],
        represented=represented,
    )


def _score_trials(
    log_probability: dict[str, list[LogProbability]],
    measured: WindowSet,
    groups: Shaped[np.ndarray, " window"],
) -> list[Trial]:
    """Score each candidate by the recall of recordings in each group."""
    _, first, recording = np.unique(measured.recording_id, return_index=True, return_inverse=True)
    target = measured.target[first]
    recording_groups = groups[first]
    group_masks = [recording_groups == name for name in np.unique(recording_groups)]

    recalls_by_group: dict[str, np.ndarray] = {}
    total_recalls: dict[str, np.ndarray] = {}
    for name, by_view in log_probability.items():
        group_recalls = np.empty((len(group_masks), len(by_view)))
        view_recalls = np.empty(len(by_view))
        for view, answers in enumerate(by_view):
            is_right = _recordings_right(answers, recording, target)
            view_recalls[view] = _mean_recall(is_right, target)
            for group, mask in enumerate(group_masks):
                group_recalls[group, view] = _mean_recall(is_right[mask], target[mask])
        recalls_by_group[name] = group_recalls
        total_recalls[name] = view_recalls

    # The mean of the clean view and of the disturbed ones.
    scores_by_group = {
        name: (recalls[:, 0] + recalls[:, 1:].mean(axis=1)) / 2
        for name, recalls in recalls_by_group.items()
    }
    best = max(scores_by_group.values(), key=np.mean)
    min_score = best.mean() - _standard_error(best) - _TIE_TOLERANCE
    return [
        Trial(
            candidate=name,
            score=float(scores.mean()),
            standard_error=_standard_error(scores),
            clean=float(total_recalls[name][0]),
            disturbed=float(total_recalls[name][1:].mean()),
            is_tied=bool(scores.mean() >= min_score),
        )
        for name, scores in scores_by_group.items()
    ]


def _select_candidate(trials: Sequence[Trial], n_machines: int) -> Candidate:
    """Return the candidate with the best trial, or the first one tied with it if machines are few.

    Parameters
    ----------
    trials : trials of `CANDIDATES`.
    n_machines : machines that were each held out; 0 if folds did not hold out machines.
    """
    tied = [
        (candidate, trial)
        for candidate, trial in zip(CANDIDATES, trials, strict=True)
        if trial.is_tied
    ]
    if n_machines < MIN_RANKING_MACHINES:
        return tied[0][0]

    best_score = max(trial.score for _, trial in tied)
    return next(
        candidate for candidate, trial in tied if trial.score >= best_score - _TIE_TOLERANCE
    )


def _recordings_right(
    log_probability: LogProbability,
    recording: Int64[np.ndarray, " window"],
    target: Int64[np.ndarray, " recording"],
) -> Bool[np.ndarray, " recording"]:
    """Return whether each recording is classified right by the mean log-probability."""
    pooled = np.zeros((len(target), log_probability.shape[1]))
    np.add.at(pooled, recording, log_probability)
    n_windows = np.bincount(recording)[:, None]
    return np.asarray(likeliest_class(pooled / n_windows) == target)


def _mean_recall(is_right: Bool[np.ndarray, " recording"], target: np.ndarray) -> float:
    return float(np.mean([is_right[target == index].mean() for index in np.unique(target)]))


def _standard_error(scores: Float64[np.ndarray, " group"]) -> float:
    if len(scores) < 2:
        return 0.0
    return float(scores.std(ddof=1) / np.sqrt(len(scores)))
