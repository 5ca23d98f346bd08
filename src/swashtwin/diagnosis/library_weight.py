"""How much the classifier of a machine learns from a library of changes.

Only machines of the library that resemble the machine teach: those whose healthy spectrum is as
near to its own as machines of the library are to their nearest neighbor. The weight of their
recordings is the one with which a network, trained without some of them, recognizes their faults
best. It is zero unless that is better than the prior alone, so that a library that does not help is
not used.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float64, Int64
from scipy.optimize import linear_sum_assignment

from swashtwin.diagnosis.change_library import ChangeLibrary, LibraryPump
from swashtwin.diagnosis.prior_classifier import PriorClassifier
from swashtwin.diagnosis.prior_head import (
    BACKGROUND_WEIGHT,
    MeasuredChanges,
    PriorHead,
    VirtualChanges,
    fit_head,
    join_measured,
    machine_scatter,
)
from swashtwin.diagnosis.progress import Progress, ignore_progress
from swashtwin.foundation import plural
from swashtwin.recordings import Manifest, Recording, find_copies, join_manifests

WEIGHTS = (5.0, 20.0)
"""Weights of a library's recordings that are tried; a virtual recording of a fault counts 1."""
MIN_PUMPS = 3
"""Machines that must resemble the machine. A single one lowered the balanced accuracy on fleet 112
of version 2 of the rig by 0.02 to 0.05, and with two, only one is left to learn from."""
MAX_DISTANCE_RATIO = 1.5
"""Distance of spectra, over the median distance to the nearest neighbor in the library, up to which
machines are alike. On fleets 110 to 112 of the rig, the nearest machine of the same version is at
up to 1.3, that of another version at 1.4 (versions 1 and 2) to 7 (version 3), for the mean spectrum
of a fleet. Of six single pumps of fleet 110 of version 2, five have at least three of the five
others within this limit, one has two."""

# Share of a machine's bands that another one may lack: the exact speed decides whether the highest
# band lies below half the sample rate.
_MAX_MISSING_BANDS = 0.1

# Parts into which the machines are split to be held out; more take longer and teach little.
_MAX_FOLDS = 4

# Least probability that counts, so that one sure error does not decide.
_MIN_PROBABILITY = 1e-3

# Standard errors over the machines by which exchanged labels must agree better with the prior than
# those of a library. The best of the 23 exchanges of four faults often gains two by chance.
_EXCHANGE_ERRORS = 3.0

# Minimum gain: a prior that confuses two faults prefers their exchange alike in all machines, and
# one that knows nothing gains 1.3 with four invented machines. On fleet 110 of version 2 of the
# rig, exchanging piston and cylinder block in the labels gains 0.5, exchanging all faults 6.7.
_MIN_EXCHANGE_GAIN = 2.0

# Standard errors over the machines that the gain in accuracy must exceed, and the same if an
# exchange agrees more with the prior: labels that were drawn at random help by 2.2 by chance.
_HELP_ERRORS = 1.0
_DOUBTED_HELP_ERRORS = 3.0


@dataclass(frozen=True, eq=False)
class LibraryUse:
    """What a machine's classifier learns from a library, and why."""

    weight: float
    """Weight of each recording; 0 if the library is not used."""
    n_pumps: int
    """Machines of the library that resemble the machine."""
    changes: MeasuredChanges | None
    """Their changes; None if the library is not used."""
    taught: Mapping[str, int]
    """Number of their recordings of each fault; empty if the library is not used."""
    manifest: Manifest
    """Their recordings, by id and content; empty if the library is not used."""
    accuracy: Mapping[float, float]
    """Balanced accuracy on machines held out, by weight; 0 is the prior alone. Empty if it was not
    determined."""
    sentence: str
    """Whether the library is used, and why."""
    notes: tuple[str, ...] = ()
    """Which machines were left out, and why."""

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON can hold."""
        return {
            "weight": self.weight,
            "machines": self.n_pumps if self.weight else 0,
            "faults": dict(self.taught),
            "recordings": sorted(self.manifest),
            "accuracy": {f"{weight:g}": value for weight, value in self.accuracy.items()},
            "sentence": self.sentence,
            "notes": list(self.notes),
        }


def fit_with_library(
    prior: PriorClassifier,
    recordings: Sequence[Recording],
    library: ChangeLibrary,
    *,
    pistons: int | None = None,
    fault_of: Mapping[str, str] | None = None,
    seed: int = 0,
    progress: Progress = ignore_progress,
) -> tuple[PriorClassifier, LibraryUse]:
    """Adapt a prior to a machine with the help of other machines' measured faults.

    Parameters and errors: see `PriorClassifier.fit`.
    """
    machine, changes, fault_classes = prior.compare_with(recordings, pistons, fault_of, progress)
    use = weigh_library(machine, library, seed=seed, progress=progress)
    model = machine.fit_band_powers(changes, fault_classes, library=use.changes, seed=seed)
    return add_provenance(model, use), use


def add_provenance(model: PriorClassifier, use: LibraryUse) -> PriorClassifier:
    """Return a classifier that lists the recordings of a library among those it learned from."""
    return replace(model, manifest=join_manifests([model.manifest, use.manifest]))


def weigh_library(
    machine: PriorClassifier,
    library: ChangeLibrary,
    *,
    seed: int = 0,
    progress: Progress = ignore_progress,
) -> LibraryUse:
    """Return what the classifier of a machine should learn from a library.

    Parameters
    ----------
    machine : prior that holds the machine's healthy recordings (`PriorClassifier.compare_with`).
    progress : reports the trained networks.
    """
    usable, notes = _select_usable(machine, library)
    alike = _select_alike(machine, usable)
    if len(alike) < MIN_PUMPS:
        reason = (
            f"{len(alike)} of its {plural(len(library.pumps), 'machine')} can be used and resemble "
            f"this machine; {MIN_PUMPS} are needed."
        )
        return _refuse(len(alike), reason, notes)

    assert machine.virtual is not None
    is_measured = np.isfinite(machine.band_powers).all(axis=0)
    virtual = machine.virtual.keep_measured(is_measured)
    parts = [_changes_of(pump, machine, virtual) for pump in alike]
    trial = _Trial(machine, virtual, tuple(parts), seed, progress)

    alone = trial.answer(0.0)
    exchange_gain, exchange_error = _exchange_gain(parts, alone)
    if exchange_gain > max(_MIN_EXCHANGE_GAIN, _EXCHANGE_ERRORS * exchange_error):
        reason = (
            "the prior recognizes its faults clearly better with exchanged classes. Either the "
            "prior does not suit these machines, or classes were exchanged in the index."
        )
        return _refuse(len(alike), reason, notes)

    scores = {0.0: _balanced_accuracies(parts, alone)}
    for weight in WEIGHTS:
        scores[weight] = _balanced_accuracies(parts, trial.answer(weight))
    accuracy = {weight: float(values.mean()) for weight, values in scores.items()}
    best = max(accuracy, key=accuracy.__getitem__)

    gain = scores[best] - scores[0.0]
    error = float(gain.std(ddof=1)) / len(gain) ** 0.5
    comparison = (
        f"balanced accuracy on {len(alike)} machines of it, each held out: {accuracy[best]:.2f} "
        f"with the others, {accuracy[0.0]:.2f} with the prior alone"
    )
    # Labels that the prior rather contradicts must help more.
    min_errors = _DOUBTED_HELP_ERRORS if exchange_gain > 0 else _HELP_ERRORS
    if best == 0 or gain.mean() <= min_errors * error:
        return replace(
            _refuse(len(alike), f"it does not help ({comparison}).", notes), accuracy=accuracy
        )

    labels = [label for pump in alike for label in _known_labels(pump, machine)]
    return LibraryUse(
        weight=best,
        n_pumps=len(alike),
        changes=_weighted(parts, best),
        taught={name: labels.count(name) for name in dict.fromkeys(labels)},
        manifest=join_manifests([pump.manifest for pump in alike]),
        accuracy=accuracy,
        sentence=f"The library is used with weight {best:g}; {comparison}.",
        notes=notes,
    )


def _refuse(n_pumps: int, reason: str, notes: tuple[str, ...]) -> LibraryUse:
    return LibraryUse(0.0, n_pumps, None, {}, {}, {}, f"The library is not used: {reason}", notes)


def _known_labels(pump: LibraryPump, machine: PriorClassifier) -> list[str]:
    """Return the faults of a machine of the library that the prior knows."""
    return [label for label in pump.label if label in machine.classes[1:-1]]


def _select_usable(
    machine: PriorClassifier, library: ChangeLibrary
) -> tuple[list[LibraryPump], tuple[str, ...]]:
    """Return the machines of a library that can be compared with a machine, and notes."""
    is_measured = np.isfinite(machine.band_powers).all(axis=0)
    usable = []
    notes = []
    for pump in library.pumps:
        missing = [name for name in machine.channels if name not in pump.channels]
        if missing:
            notes.append(f"{pump.name} of the library is left out: it has no channel {missing[0]}.")
            continue

        if find_copies(pump.manifest, machine.manifest):
            notes.append(f"{pump.name} of the library is left out: it is this machine.")
            continue

        spectrum = pump.spectrum[_channel_rows(pump, machine)]
        if np.isnan(spectrum[is_measured]).mean() > _MAX_MISSING_BANDS:
            notes.append(
                f"{pump.name} of the library is left out: it was sampled at a lower rate than this "
                "machine."
            )
            continue
        if not _known_labels(pump, machine) or not len(pump.healthy):
            notes.append(
                f"{pump.name} of the library is left out: it has no fault that the prior knows, or "
                "no two healthy recordings at one pressure."
            )
            continue
        usable.append(pump)
    return usable, tuple(notes)


def _channel_rows(pump: LibraryPump, machine: PriorClassifier) -> list[int]:
    return [pump.channels.index(name) for name in machine.channels]


def _select_alike(machine: PriorClassifier, pumps: Sequence[LibraryPump]) -> list[LibraryPump]:
    """Return the machines of a library whose healthy spectrum resembles that of a machine."""
    if len(pumps) < MIN_PUMPS:
        return list(pumps)

    spectra = np.stack([pump.spectrum[_channel_rows(pump, machine)] for pump in pumps])
    own_spectrum = machine.band_powers.mean(axis=0)
    is_common = np.isfinite(spectra).all(axis=0) & np.isfinite(own_spectrum)
    shapes = np.stack([_spectrum_shape(spectrum, is_common) for spectrum in spectra])
    own_shape = _spectrum_shape(own_spectrum, is_common)

    distances = np.sqrt(np.mean((shapes[:, None] - shapes) ** 2, axis=-1))
    np.fill_diagonal(distances, np.inf)
    limit = MAX_DISTANCE_RATIO * np.median(distances.min(axis=1))
    distance = np.sqrt(np.mean((shapes - own_shape) ** 2, axis=-1))
    return [pump for pump, value in zip(pumps, distance, strict=True) if value <= limit]


def _spectrum_shape(
    band_powers: Float64[np.ndarray, "channel band"], is_common: Bool[np.ndarray, "channel band"]
) -> Float64[np.ndarray, " column"]:
    """Return band powers less their mean in each channel, which a sensor's gain shifts."""
    rows = [
        powers[mask] - powers[mask].mean()
        for powers, mask in zip(band_powers, is_common, strict=True)
        if mask.any()
    ]
    return np.concatenate(rows)


def _changes_of(
    pump: LibraryPump, machine: PriorClassifier, virtual: VirtualChanges
) -> MeasuredChanges:
    """Return the changes of a machine of the library, with the weight of virtual recordings."""
    rows = _channel_rows(pump, machine)
    is_measured = np.isfinite(machine.band_powers).all(axis=0)
    is_known = np.array([label in machine.classes[1:-1] for label in pump.label], dtype=bool)
    healthy = np.nan_to_num(np.where(is_measured, pump.healthy[:, rows], 0.0))
    faulty = np.nan_to_num(np.where(is_measured, pump.change[is_known][:, rows], 0.0))
    targets = [machine.classes.index(label) for label in _known_labels(pump, machine)]
    n_rows = len(faulty) + len(healthy)
    return MeasuredChanges(
        change=np.concatenate([faulty, healthy]),
        target=np.array(targets + [0] * len(healthy), dtype=np.int64),
        scatter=np.tile(machine_scatter(virtual, healthy), (n_rows, 1)),
        weight=np.repeat([1.0, BACKGROUND_WEIGHT], [len(faulty), len(healthy)]),
    )


def _weighted(parts: Sequence[MeasuredChanges], weight: float) -> MeasuredChanges:
    joined = join_measured(parts)
    return replace(joined, weight=weight * joined.weight)


@dataclass(frozen=True, eq=False)
class _Trial:
    """Training of a machine's network without some machines of a library."""

    machine: PriorClassifier
    virtual: VirtualChanges
    parts: tuple[MeasuredChanges, ...]
    seed: int
    progress: Progress

    def answer(self, weight: float) -> list[Float64[np.ndarray, "row class"]]:
        """Return the probabilities for each machine by a network that was trained without it."""
        n_parts = len(self.parts)
        max_folds = min(_MAX_FOLDS, n_parts)
        n_folds = max_folds if weight else 1
        # The prior alone is the first network; then the weights are tried in their order.
        n_trained = 1 + WEIGHTS.index(weight) * max_folds if weight else 0
        fold_of = np.arange(n_parts) % n_folds
        answers: list[Float64[np.ndarray, "row class"]] = [np.empty(0)] * n_parts
        for fold in range(n_folds):
            taught = [self.parts[i] for i in np.flatnonzero(fold_of != fold)]
            head = self._train(taught, weight)
            n_networks = 1 + len(WEIGHTS) * max_folds
            self.progress(n_trained + fold + 1, n_networks, "weighing the library")
            for i in np.flatnonzero(fold_of == fold):
                part = self.parts[i]
                answers[i] = head.answer_machine(part.change, part.scatter[0])
        return answers

    def _train(self, taught: Sequence[MeasuredChanges], weight: float) -> PriorHead:
        measured = _weighted(taught, weight) if taught else _no_rows(self.parts[0])
        return fit_head(
            self.virtual,
            self.machine.healthy_changes(),
            self.machine.bands,
            measured,
            seed=self.seed,
        )


def _no_rows(part: MeasuredChanges) -> MeasuredChanges:
    return MeasuredChanges(part.change[:0], part.target[:0], part.scatter[:0], part.weight[:0])


def _balanced_accuracies(
    parts: Sequence[MeasuredChanges], answers: Sequence[Float64[np.ndarray, "row class"]]
) -> Float64[np.ndarray, " pump"]:
    """Return the balanced accuracy on each machine; the last class is never a true one."""
    accuracies = []
    for part, answer in zip(parts, answers, strict=True):
        is_right = answer[:, :-1].argmax(axis=1) == part.target
        recalls = [is_right[part.target == target].mean() for target in np.unique(part.target)]
        accuracies.append(np.mean(recalls))
    return np.array(accuracies)


def _exchange_gain(
    parts: Sequence[MeasuredChanges], answers: Sequence[Float64[np.ndarray, "row class"]]
) -> tuple[float, float]:
    """Return how much more the prior alone agrees with exchanged labels of a library.

    The gain [log probability, summed over the faults] is that of the best exchange, 0 if no
    exchange agrees more. Its standard error over the machines follows.

    Labels that are exchanged alike in all machines agree with each other, so that holding machines
    out does not show them. A preference of the prior for a class does not count, because every
    exchange gives each class once.
    """
    faults = np.unique(np.concatenate([part.target[part.target > 0] for part in parts]))
    agreement = np.array(
        [_agreement(part, answer, faults) for part, answer in zip(parts, answers, strict=True)]
    )
    rows, columns = linear_sum_assignment(np.nanmean(agreement, axis=0), maximize=True)
    agreement_as_labeled = np.nansum(agreement[:, rows, rows], axis=1)
    gain = np.nansum(agreement[:, rows, columns], axis=1) - agreement_as_labeled
    error = float(gain.std(ddof=1)) / len(gain) ** 0.5
    return float(gain.mean()), error


def _agreement(
    part: MeasuredChanges,
    answer: Float64[np.ndarray, "row class"],
    faults: Int64[np.ndarray, " fault"],
) -> Float64[np.ndarray, "fault answered"]:
    """Return the mean log probability of each fault for a machine's recordings of each fault.

    A fault that the machine does not have is NaN.
    """
    log_probability = np.log(np.maximum(answer[:, faults], _MIN_PROBABILITY))
    agreement = np.full((len(faults), len(faults)), np.nan)
    for row, fault in enumerate(faults):
        is_fault = part.target == fault
        if is_fault.any():
            agreement[row] = log_probability[is_fault].mean(axis=0)
    return agreement
