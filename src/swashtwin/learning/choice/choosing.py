"""Training by default: try every candidate on inner folds, choose one, train it on everything."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64, Shaped

from swashtwin.foundation import DataError, InputError, derive_seed, one_thread, stream
from swashtwin.learning.choice.choice import CANDIDATES, Candidate, Choice, Trial
from swashtwin.learning.networks.level_network import mean_of_heads, solve_alike
from swashtwin.learning.networks.window_levels import levels_along
from swashtwin.learning.training.classifier import Normalization
from swashtwin.learning.training.confidence import likeliest_class
from swashtwin.learning.training.fitting import Seen
from swashtwin.learning.training.settings import TrainingSettings, at_other_speeds, transform_windows, with_gains
from swashtwin.learning.windows.splitting import Fold, group_folds, window_groups, without_overlap
from swashtwin.learning.windows.window_set import WindowSet
from swashtwin.signals import NoiseKind, unit_noise

MOST_WINDOWS = 3000
"""Measured windows of a trial; of more, every recording lends its share."""
MOST_FOLDS = 6
"""Inner folds at most, so that of six machines each is left out once; fewer where a class stands in fewer groups."""
FEW_MACHINES = 3
"""Machines up to which the scatter between them tells nothing, so that ties go by `Candidate.rank`."""
BUDGET = 600.0
"""Seconds of one core that a choice may take, by the model of its cost."""
SNR, GAIN, STRETCH = 5.0, 12.0, 0.02
"""Disturbances of the test sides: signal-to-noise ratio [dB], largest gain [dB], largest relative change of speed."""
_KINDS: tuple[NoiseKind, ...] = ("white", "pink", "hum")
_COST = {"representation": 1.5e-7, "solution": 2.5e-7}
"""Seconds of one core: of the levels of a sample; of one head per training window and level."""


@dataclass(frozen=True, eq=False)
class FoldAnswers:
    """What the chosen candidate says of measured windows that its fold's training did not see."""

    probability: Float64[np.ndarray, "window class"]
    target: Int64[np.ndarray, " window"]
    recording_id: Shaped[np.ndarray, " window"]
    """Recording of each window, in order of time."""
    fold: Int64[np.ndarray, " window"]
    """Fold that left it out."""
    seen: Seen | None = None
    """What the chosen candidate sees of all windows in its training; None where the trial had others."""


def choose(
    windows: WindowSet,
    *,
    candidates: Sequence[Candidate] = CANDIDATES,
    budget: float = BUDGET,
    seed: int = 0,
    progress: Callable[[str, int, int], None] | None = None,
) -> tuple[Candidate, Choice, FoldAnswers | None]:
    """(candidate chosen, what was tried, the chosen one's answers across the folds or None without a trial).

    Measured windows are dealt into folds by specimen, else by condition, else by recording: the hardest grouping in
    which every class stands in two groups. Each candidate is trained on the other folds and on the synthetic windows of
    other specimens, and tested on the fold as it is, under noise at 5 dB, and under gains of ±12 dB with speeds of
    ±2 %, by recording. Of the candidates whose score is within one standard error of the best (between the groups;
    Breiman and others 1984, "Classification and Regression Trees") the first in the declared order is chosen; with two
    or three machines, whose scatter tells little, the one of the least `Candidate.rank`.

    Parameters
    ----------
    candidates : from the most invariant to the least.
    budget : seconds of one core, by a model of the cost and not by the clock, so that the same seed chooses the same;
        candidates that do not fit are left out, the last first.
    progress : called with (activity, finished, in all).

    Raises
    ------
    InputError
        A negative budget or seed.
    """
    if not budget >= 0:
        raise InputError(f"budget ({budget:g} s) must be a time, such as {BUDGET:g}; 0 chooses without a trial.")
    if seed < 0:
        raise InputError(f"seed ({seed}) must not be negative.")
    tell = progress or (lambda activity, finished, total: None)
    turns = windows.turns_per_sample  # candidates on orders need every speed, and a whole turn in a window
    has_orders = bool(np.isfinite(turns).all() and (turns * windows.length >= 1).all())
    possible = [candidate for candidate in candidates if has_orders or candidate.axis != "order"]
    measured = without_overlap(windows.subset(~windows.synthetic))
    if len(measured) > MOST_WINDOWS:  # the first of each recording, in a row, whose dependence is that of a recording
        names, index = np.unique(measured.recording_id, return_inverse=True)
        share = max(1, MOST_WINDOWS // len(names))
        kept = [np.flatnonzero(index == number)[:share] for number in range(len(names))]
        measured = measured.subset(np.sort(np.concatenate(kept)))
    group, folds = _inner_folds(measured, seed)
    if not folds:
        reason = "there are too few recordings of a class to test on some of them; record more of each class"
        return possible[0], Choice(possible[0].name, (), "", 0, 0, reason), None
    tried, reason = _within_budget(possible, measured, windows, len(folds), budget)
    if len(tried) < 2:
        return tried[0], Choice(tried[0].name, (), "", 0, 0, reason), None
    with one_thread():
        views = _Views(measured, windows.subset(windows.synthetic), [candidate.axis for candidate in tried], seed)
        log_probability = _answers(tried, views, folds, seed, tell)
    groups = window_groups(measured, group)
    trials = _trials(tried, log_probability, measured, groups)
    tied = [candidate for candidate, trial in zip(tried, trials, strict=True) if trial.is_tied]
    n_machines = len(np.unique(groups)) if group == "specimen" else 0
    chosen = min(tied, key=lambda candidate: candidate.rank) if 0 < n_machines <= FEW_MACHINES else tied[0]
    tested = np.sort(np.concatenate([rows for _, rows in folds]))
    fold = np.full(len(measured), -1)
    for number, (_, left_out) in enumerate(folds):
        fold[left_out] = number
    is_all = len(windows) == len(views.windows) and windows.fingerprint() == views.windows.fingerprint()
    levels, rows = views.training(chosen.axis, chosen.training)
    answers = FoldAnswers(
        probability=np.exp(log_probability[chosen.name][0][tested]),
        target=measured.target[tested],
        recording_id=measured.recording_id[tested],
        fold=fold[tested],
        seen=(chosen.network(windows).shaped(levels), rows) if is_all else None,
    )
    choice = Choice(chosen.name, tuple(trials), group, len(folds), len(tested), reason, n_machines)
    return chosen, choice, answers


def _inner_folds(measured: WindowSet, seed: int) -> tuple[str, tuple[Fold, ...]]:
    """(what the folds keep whole, the folds), or ("", ()) where not even recordings can be dealt."""
    present = measured.with_classes([measured.classes[index] for index in np.unique(measured.target)])
    for group in ("specimen", "condition", "recording"):
        try:
            groups = window_groups(measured, group)
        except DataError:
            continue
        counts = [len(np.unique(groups[measured.target == index])) for index in np.unique(measured.target)]
        if len(counts) < 2 or min(counts) < 2:
            continue
        for n_folds in range(min(MOST_FOLDS, len(np.unique(groups))), 1, -1):
            try:
                folds = group_folds(present, group=group, n_folds=n_folds, seed=seed)
            except (DataError, InputError):
                continue
            return group, folds
    return "", ()


def _within_budget(
    candidates: list[Candidate], measured: WindowSet, windows: WindowSet, n_folds: int, budget: float
) -> tuple[list[Candidate], str]:
    rows = len(measured) + int(windows.synthetic.sum())
    samples = rows * windows.n_channels * windows.length
    spent, paid, tried = 0.0, set[tuple[str, TrainingSettings | None]](), list[Candidate]()
    for candidate in candidates:
        passes = {(candidate.axis, None): 3, (candidate.axis, candidate.training): candidate.training.epochs}
        cost = sum(n * samples * _COST["representation"] for key, n in passes.items() if key not in paid)
        if len(candidate.heads) == 1:
            cost += n_folds * rows * (1 + candidate.training.epochs) * 350 * windows.n_channels * _COST["solution"]
        if tried and spent + cost > budget:
            left_out = f"{len(candidates) - len(tried)} of {len(candidates)} candidates"
            return tried, f"the budget of {budget:g} s left out {left_out}; a longer one tries them"
        spent += cost
        paid.update(passes)
        tried.append(candidate)
    return tried, ""


_VIEWS = ("clean", "noise", "gain and speed")
_Levels = Float32[np.ndarray, "window channel level"]


class _Views:
    """Levels of all windows, clean and disturbed, each computed once along all axes: training passes, and views to test
    under."""

    def __init__(self, measured: WindowSet, synthetic: WindowSet, axes: Sequence[str], seed: int) -> None:
        self._axes = tuple(dict.fromkeys(axes))
        self.windows, self.measured, self.synthetic = measured + synthetic, measured, synthetic
        self._seed = seed
        self._normalization = Normalization.fit("set", self.windows)
        views = {"clean": self.windows}
        noise, moved = (stream(seed, "trial", view) for view in _VIEWS[1:])
        noisy = measured.signal.copy()
        scale = np.sqrt(noisy.var(axis=-1, keepdims=True) * 10 ** (-SNR / 10))
        for index, kind in enumerate(_KINDS):
            rows = slice(index, None, len(_KINDS))
            drawn = unit_noise(noisy[rows].shape, noise, kind, measured.sample_rate)
            noisy[rows] += scale[rows] * drawn.astype(np.float32)
        views["noise"] = replace(measured, signal=noisy)
        faster = at_other_speeds(measured.signal, STRETCH, moved)
        views["gain and speed"] = replace(measured, signal=with_gains(faster, GAIN, moved))
        self.levels = {name: self._computed(view) for name, view in views.items()}
        """Levels by view, of the measured windows and, where clean, of the synthetic ones after them; then by axis."""
        self._changed: dict[TrainingSettings, list[tuple[dict[str, _Levels], np.ndarray]]] = {}

    def training(self, axis: str, training: TrainingSettings) -> tuple[_Levels, np.ndarray]:
        """(levels of every training pass, index of the window behind each row)."""
        if training not in self._changed:
            passes = (transform_windows(self.windows, training, self._seed, n + 1) for n in range(training.epochs))
            self._changed[training] = [(self._computed(changed), which) for which, changed in passes if len(which)]
        levels, rows = zip((self.levels["clean"], np.arange(len(self.windows))), *self._changed[training], strict=True)
        return np.concatenate([part[axis] for part in levels]), np.concatenate(rows)

    def _computed(self, windows: WindowSet) -> dict[str, _Levels]:
        computed = [
            levels_along(samples, [turns if axis == "order" else None for axis in self._axes])
            for samples, turns in self._normalization.blocks(windows)
        ]
        return {axis: np.concatenate(part) for axis, part in zip(self._axes, zip(*computed, strict=True), strict=True)}


def _answers(
    candidates: list[Candidate],
    views: _Views,
    folds: tuple[Fold, ...],
    seed: int,
    tell: Callable[[str, int, int], None],
) -> dict[str, list[Float64[np.ndarray, "window class"]]]:
    """Log-probabilities of the measured windows under each view, by candidate, from the fold that tested them."""
    n_classes = len(views.windows.classes)
    answers = {
        candidate.name: [np.full((len(views.measured), n_classes), np.nan) for _ in _VIEWS] for candidate in candidates
    }
    paths = list(dict.fromkeys((candidate.axis, candidate.training) for candidate in candidates))
    for number, (axis, training) in enumerate(paths):
        tell("trying candidates", number, len(paths))
        levels, rows = views.training(axis, training)
        tests = [views.levels[view][axis] for view in _VIEWS]
        members = [candidate for candidate in candidates if (candidate.axis, candidate.training) == (axis, training)]
        heads = tuple(dict.fromkeys(head for candidate in members for head in candidate.heads))
        networks = {each.shape: replace(each, heads=heads).network(views.windows) for each in members}
        for fold, (trained, tested) in enumerate(folds):
            chosen = np.flatnonzero(np.isin(rows, _training_rows(views, trained, tested)))
            values = [network.shaped(levels[chosen]) for network in networks.values()]
            target = views.windows.target[rows[chosen]]
            solve_alike(list(networks.values()), values, target, derive_seed(seed, "trial", fold))
            for view, test in enumerate(tests):
                by_head = {shape: net.log_probabilities(net.shaped(test[tested])) for shape, net in networks.items()}
                for candidate in members:
                    mean = mean_of_heads([by_head[candidate.shape][head] for head in candidate.heads])
                    answers[candidate.name][view][tested] = mean
    tell("trying candidates", len(paths), len(paths))
    return answers


def _training_rows(views: _Views, trained: np.ndarray, tested: np.ndarray) -> np.ndarray:
    """Windows to train a fold on: the measured ones of the other folds, and the synthetic ones of other specimens, or
    all of these where a class would be missing."""
    others = made_without(views.synthetic.specimen, views.measured.specimen[tested])
    rows = np.concatenate([trained, len(views.measured) + np.flatnonzero(others)])
    if len(np.unique(views.windows.target[rows])) < len(np.unique(views.windows.target)):
        rows = np.concatenate([trained, np.arange(len(views.measured), len(views.windows))])
    return rows


def made_without(
    made: Shaped[np.ndarray, " synthetic"], specimens: Shaped[np.ndarray, " tested"]
) -> Bool[np.ndarray, " synthetic"]:
    """Whether each synthetic specimen was made without the others: what was made from windows of a specimen is called
    "... of" it; a twin is called after its pump's type.
    """
    tested = set(specimens.tolist())
    endings = tuple(f" of {name}" for name in tested)
    return np.array([not name or (name not in tested and not name.endswith(endings)) for name in made.tolist()], bool)


def _trials(
    candidates: list[Candidate],
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
        return float(np.mean([right[mask & (target == index)].mean() for index in np.unique(target[mask])]))

    def error(scores: np.ndarray) -> float:
        return float(scores.std(ddof=1) / np.sqrt(len(scores))) if len(scores) > 1 else 0.0

    tables = {
        candidate.name: np.array(
            [
                [recall(view, mask) for view in log_probability[candidate.name]]
                for mask in (*masks, np.ones(len(first), dtype=bool))
            ]
        )
        for candidate in candidates
    }
    by_group = {name: (table[:-1, 0] + table[:-1, 1:].mean(axis=1)) / 2 for name, table in tables.items()}
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
