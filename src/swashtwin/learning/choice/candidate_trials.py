"""Training by default: try both candidates on inner folds, and choose one."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64, Shaped

from swashtwin.foundation import DataError, InputError, derive_seed, one_thread, random_stream
from swashtwin.learning.choice.candidates import (
    CANDIDATES,
    DISTURBED_TRAINING,
    Candidate,
    Choice,
    Trial,
)
from swashtwin.learning.networks.band_power_network import solve_together
from swashtwin.learning.networks.window_features import window_features
from swashtwin.learning.training.classifier import Normalization
from swashtwin.learning.training.confidence import likeliest_class
from swashtwin.learning.training.fitting import RepresentedWindows
from swashtwin.learning.training.settings import at_other_speeds, transform_windows, with_gains
from swashtwin.learning.windows.splitting import Fold, group_folds, window_groups, without_overlap
from swashtwin.learning.windows.window_set import WindowSet
from swashtwin.signals import NoiseKind, unit_noise

MOST_WINDOWS = 3000
"""Measured windows of a trial; of more, every recording lends its share."""
MOST_FOLDS = 6
"""Inner folds at most, so that of six machines each is left out once; fewer where a class stands in
fewer groups.
"""
SNR, GAIN, STRETCH = 5.0, 12.0, 0.02
"""Disturbances of the test sides: signal-to-noise ratio [dB], largest gain [dB], largest relative
change of speed.
"""
_KINDS: tuple[NoiseKind, ...] = ("white", "pink", "hum")


@dataclass(frozen=True, eq=False)
class OutOfFoldPredictions:
    """What the chosen candidate says of measured windows that its fold's training did not see."""

    probability: Float64[np.ndarray, "window class"]
    target: Int64[np.ndarray, " window"]
    recording_id: Shaped[np.ndarray, " window"]
    """Recording of each window, in order of time."""
    fold: Int64[np.ndarray, " window"]
    """Fold that left it out."""
    seen: RepresentedWindows | None = None
    """What the chosen candidate sees of all windows in its training; None where the trial had
    others.
    """


def choose_candidate(
    windows: WindowSet, *, seed: int = 0, progress: Callable[[str, int, int], None] | None = None
) -> tuple[Candidate, Choice, OutOfFoldPredictions | None]:
    """(candidate chosen, what was tried, the chosen one's answers across the folds or None without
    a trial).

    Measured windows are dealt into folds by specimen, else by condition, else by recording: the
    hardest grouping in which every class stands in two groups. Each of `CANDIDATES` is trained on
    the other folds and on the synthetic windows of other specimens, and tested on the fold as it
    is, under noise at 5 dB, and under gains of ±12 dB with speeds of ±2 %, by recording. The first
    whose score is within one standard error of the best (between the groups; Breiman and others
    1984, "Classification and Regression Trees") is chosen.

    Parameters
    ----------
    progress : called with (activity, finished, in all).

    Raises
    ------
    InputError
        A negative seed.
    """
    if seed < 0:
        raise InputError(f"seed ({seed}) must not be negative.")
    tell = progress or (lambda activity, finished, total: None)
    measured = without_overlap(windows.subset(~windows.synthetic))
    if (
        len(measured) > MOST_WINDOWS
    ):  # the first of each recording, in a row, whose dependence is that of a recording
        names, index = np.unique(measured.recording_id, return_inverse=True)
        share = max(1, MOST_WINDOWS // len(names))
        leading_rows = [np.flatnonzero(index == number)[:share] for number in range(len(names))]
        measured = measured.subset(np.sort(np.concatenate(leading_rows)))
    group, folds = _inner_folds(measured, seed)
    if not folds:
        reason = "there are too few recordings of a class to test on some of them; record more of each class"
        return CANDIDATES[0], Choice(CANDIDATES[0].name, (), "", 0, 0, reason), None
    with one_thread():
        views = _Views(measured, windows.subset(windows.synthetic), seed)
        log_probability = _answers(views, folds, seed, tell)
    groups = window_groups(measured, group)
    trials = _trials(log_probability, measured, groups)
    chosen = next(
        candidate for candidate, trial in zip(CANDIDATES, trials, strict=True) if trial.is_tied
    )
    tested = np.sort(np.concatenate([rows for _, rows in folds]))
    fold = np.full(len(measured), -1)
    for number, (_, left_out) in enumerate(folds):
        fold[left_out] = number
    is_all = (
        len(windows) == len(views.windows) and windows.fingerprint() == views.windows.fingerprint()
    )
    band_powers, rows = views.training
    answers = OutOfFoldPredictions(
        probability=np.exp(log_probability[chosen.name][0][tested]),
        target=measured.target[tested],
        recording_id=measured.recording_id[tested],
        fold=fold[tested],
        seen=(chosen.network(windows).shaped(band_powers), rows) if is_all else None,
    )
    n_machines = len(np.unique(groups)) if group == "specimen" else 0
    return (
        chosen,
        Choice(chosen.name, tuple(trials), group, len(folds), len(tested), "", n_machines),
        answers,
    )


def _inner_folds(measured: WindowSet, seed: int) -> tuple[str, tuple[Fold, ...]]:
    """(what the folds keep whole, the folds), or ("", ()) where not even recordings can be
    dealt.
    """
    present = measured.with_classes(
        [measured.classes[index] for index in np.unique(measured.target)]
    )
    for group in ("specimen", "condition", "recording"):
        try:
            groups = window_groups(measured, group)
        except DataError:
            continue
        counts = [
            len(np.unique(groups[measured.target == index])) for index in np.unique(measured.target)
        ]
        if len(counts) < 2 or min(counts) < 2:
            continue
        for n_folds in range(min(MOST_FOLDS, len(np.unique(groups))), 1, -1):
            try:
                folds = group_folds(present, group=group, n_folds=n_folds, seed=seed)
            except (DataError, InputError):
                continue
            return group, folds
    return "", ()


_VIEWS = ("clean", "noise", "gain and speed")
_WindowFeatures = Float32[np.ndarray, "window channel level"]


class _Views:
    """Levels of all windows, clean and disturbed: those to train on, and views to test under."""

    def __init__(self, measured: WindowSet, synthetic: WindowSet, seed: int) -> None:
        self.windows, self.measured, self.synthetic = measured + synthetic, measured, synthetic
        self._normalization = Normalization.fit("set", self.windows)
        noise, moved = (random_stream(seed, "trial", view) for view in _VIEWS[1:])
        noisy = measured.signal.copy()
        scale = np.sqrt(noisy.var(axis=-1, keepdims=True) * 10 ** (-SNR / 10))
        for index, kind in enumerate(_KINDS):
            rows = slice(index, None, len(_KINDS))
            drawn = unit_noise(noisy[rows].shape, noise, kind, measured.sample_rate)
            noisy[rows] += scale[rows] * drawn.astype(np.float32)
        faster = at_other_speeds(measured.signal, STRETCH, moved)
        clean = self._levels(self.windows)
        self.tests = [clean[: len(measured)], self._levels(replace(measured, signal=noisy)),
                      self._levels(replace(measured, signal=with_gains(faster, GAIN, moved)))]  # fmt: skip
        """Levels of the measured windows under each of `_VIEWS`."""
        band_powers, which = [clean], [np.arange(len(self.windows))]
        for number in range(DISTURBED_TRAINING.epochs):
            changed, part = transform_windows(self.windows, DISTURBED_TRAINING, seed, number + 1)
            if len(changed):
                band_powers.append(self._levels(part))
                which.append(changed)
        self.training = np.concatenate(band_powers), np.concatenate(which)
        """(levels of every training pass, index of the window behind each row)."""

    def _levels(self, windows: WindowSet) -> _WindowFeatures:
        return np.concatenate(
            [window_features(samples, None) for samples, _ in self._normalization.blocks(windows)]
        )


def _answers(
    views: _Views, folds: tuple[Fold, ...], seed: int, tell: Callable[[str, int, int], None]
) -> dict[str, list[Float64[np.ndarray, "window class"]]]:
    """Log-probabilities of the measured windows under each view, by candidate, from the fold that
    tested them.
    """
    shape = len(views.measured), len(views.windows.classes)
    answers = {candidate.name: [np.full(shape, np.nan) for _ in _VIEWS] for candidate in CANDIDATES}
    band_powers, rows = views.training
    networks = {candidate.name: candidate.network(views.windows) for candidate in CANDIDATES}
    for fold, (trained, tested) in enumerate(folds):
        tell("trying candidates", fold, len(folds))
        used = np.flatnonzero(np.isin(rows, _training_rows(views, trained, tested)))
        values = [network.shaped(band_powers[used]) for network in networks.values()]
        target = views.windows.target[rows[used]]
        solve_together(list(networks.values()), values, target, derive_seed(seed, "trial", fold))
        for view, test in enumerate(views.tests):
            for name, network in networks.items():
                answers[name][view][tested] = network.scores(network.shaped(test[tested]))
    tell("trying candidates", len(folds), len(folds))
    return answers


def _training_rows(views: _Views, trained: np.ndarray, tested: np.ndarray) -> np.ndarray:
    """Windows to train a fold on: the measured ones of the other folds, and the synthetic ones of
    other specimens, or all of these where a class would be missing.
    """
    others = is_made_without(views.synthetic.specimen, views.measured.specimen[tested])
    rows = np.concatenate([trained, len(views.measured) + np.flatnonzero(others)])
    if len(np.unique(views.windows.target[rows])) < len(np.unique(views.windows.target)):
        rows = np.concatenate([trained, np.arange(len(views.measured), len(views.windows))])
    return rows


def is_made_without(
    synthetic: Shaped[np.ndarray, " synthetic"], tested: Shaped[np.ndarray, " tested"]
) -> Bool[np.ndarray, " synthetic"]:
    """Whether each synthetic specimen was made without the tested ones: "... of" a specimen is what
    was made from windows of it; a twin is called after its pump's type.
    """
    names = set(tested.tolist())
    endings = tuple(f" of {name}" for name in names)
    return np.array(
        [not name or not (name in names or name.endswith(endings)) for name in synthetic.tolist()],
        bool,
    )


def _trials(
    log_probability: dict[str, list[Float64[np.ndarray, "window class"]]],
    measured: WindowSet,
    groups: Shaped[np.ndarray, " window"],
) -> list[Trial]:
    first, recording = np.unique(measured.recording_id, return_index=True, return_inverse=True)[1:]
    count, groups, target = np.bincount(recording)[:, None], groups[first], measured.target[first]
    masks = [groups == name for name in np.unique(groups)]

    def recall(answer: np.ndarray, mask: np.ndarray) -> float:
        pooled = np.zeros((len(first), answer.shape[1]))
        np.add.at(pooled, recording, answer)
        right = likeliest_class(pooled / count) == target
        return float(
            np.mean([right[mask & (target == index)].mean() for index in np.unique(target[mask])])
        )

    def error(scores: np.ndarray) -> float:
        return float(scores.std(ddof=1) / np.sqrt(len(scores))) if len(scores) > 1 else 0.0

    tables = {
        name: np.array(
            [
                [recall(view, mask) for view in part]
                for mask in (*masks, np.ones(len(first), dtype=bool))
            ]
        )
        for name, part in log_probability.items()
    }
    by_group = {
        name: (table[:-1, 0] + table[:-1, 1:].mean(axis=1)) / 2 for name, table in tables.items()
    }
    best = max(by_group.values(), key=np.mean)
    least = best.mean() - error(best)
    return [
        Trial(
            candidate=name,
            score=float(scores.mean()),
            standard_error=error(scores),
            clean=float(tables[name][-1, 0]),
            disturbed=float(tables[name][-1, 1:].mean()),
            is_tied=bool(scores.mean() >= least - 1e-12),
        )
        for name, scores in by_group.items()
    ]
