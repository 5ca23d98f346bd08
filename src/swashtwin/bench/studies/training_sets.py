"""Training sets by name: what was measured, and what fills the scarce cells beside it."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from swashtwin.bench.fillers.registry import FILLERS
from swashtwin.bench.studies.dataset import Material, again_cut
from swashtwin.calibration import Posterior
from swashtwin.foundation import InputError, derive_seed, stream
from swashtwin.learning import WindowSet
from swashtwin.physics import Twin
from swashtwin.pump import Fault
from swashtwin.signals import add_noise
from swashtwin.synthesis import DEFAULT_VARIATION, Background, Filler, TwinFiller, discriminative_score

TWINS = ("nominal", "calibrated", "posterior")
"""What twins may fill with: as drawn, as calibrated, as drawn from what the calibrations leave open."""


CALIBRATED_TWINS = TWINS[1:]
"""Those that need a calibration."""

FURTHER = {"discriminator": "AUROC measured/synthetic"}
"""Headings of what is known of synthetic windows themselves."""


TRAINING_SNRS = (0.0, 25.0)
"""Range of the ratios of noise in training [dB], a little wider than the tests'."""


@dataclass(frozen=True)
class Filling:
    """What a training set holds besides the measured windows."""

    by: str | None = None
    """A name in `TWINS` or in `synthesis.FILLERS`, or None for nothing."""
    count: int | None = None
    """Windows for each cell that is filled; None takes the scenario's."""
    every_class: bool = False
    """Fill every class at the scarce cells' pressure and not the scarce ones alone: the control of the fingerprint
    trap, for then "synthetic" tells no class."""
    noise: bool = False
    """Learn from a noisy copy of everything too, measured and synthetic windows alike."""

    background: Background = "spectrum"
    """What a twin's windows are laid over."""
    class_weights: bool = False
    """Let every class count the same in a network's loss, in place of windows."""

    def described(self, faults: Mapping[str, Sequence[Fault]]) -> dict[str, Any]:
        """Settings as JSON can hold them, those of whatever fills among them.

        Parameters
        ----------
        faults : what twins simulate of each class, where they fill all of them.
        """
        filler = repr(FILLERS[self.by]) if self.by in FILLERS else repr(DEFAULT_VARIATION) if self.by else None
        told = {**asdict(self), "filler": filler}
        if self.every_class:
            told["faults"] = {name: [repr(one) for one in faults[name]] for name in sorted(faults)}
        if self.noise:
            told["snrs"] = list(TRAINING_SNRS)
        return told


PAPER_FILLINGS: Mapping[str, Filling] = MappingProxyType(
    {"measured": Filling(), "nominal": Filling("nominal"), "calibrated": Filling("calibrated")}
)
"""The paper's three training sets."""


def filled_cells(material: Material, filling: Filling) -> tuple[WindowSet, dict[str, float]]:
    """(synthetic windows that a filling adds, what is known of them)."""
    made = synthetic_windows_of(material, filling)
    value = told_apart(material, made) if len(made) else math.nan
    values = {} if math.isnan(value) else {"discriminator": value}
    if filling.noise:
        made = made + _noisy(material, made) + noisy_training(material)
    return made, values


def _noisy(material: Material, made: WindowSet) -> WindowSet:
    """A copy of each synthetic window with noise; each is a recording of its own."""
    signal = [
        add_noise(window.astype(np.float64), _training_snr(material.seed, name), material.seed, "training", name)
        for window, name in zip(made.signal, made.recording_id.tolist(), strict=True)
    ]
    return replace(made, signal=np.array(signal, dtype=np.float32).reshape(made.signal.shape))


def noisy_training(material: Material) -> WindowSet:
    """The measured training windows once more, cut from their recordings after noise was added to these."""
    noisy = [
        replace(one, signal=add_noise(one.signal, _training_snr(material.seed, name), material.seed, "training", name))
        for one in material.train_recordings
        for name in [one.recording_id]
    ]
    return again_cut(noisy, material.measured)


def _training_snr(seed: int, name: str) -> float:
    """Signal-to-noise ratio of one recording's noisy copy in training [dB]."""
    return float(stream(seed, "training noise", name).uniform(*TRAINING_SNRS))


def told_apart(material: Material, made: WindowSet) -> float:
    """AUROC of trees that tell measured windows of the filled cells from synthetic ones: the fingerprint trap.

    0.5 is not at all, 1 always; NaN where there are too few windows or recordings. The measured windows are those of
    the nearer test, which no filler saw; nothing is chosen by it.
    """
    test, scarce = material.tests[material.scenario.levels[0]], material.scenario.scarce
    measured, made = test.subset(np.isin(test.label, scarce)), made.subset(np.isin(made.label, scarce))
    if len(set(measured.recording_id.tolist())) < 2 or len(made) < 2:
        return math.nan
    return discriminative_score(measured, made, seed=material.seed)


def synthetic_windows_of(material: Material, filling: Filling) -> WindowSet:
    """The synthetic windows that a filling adds; none of a filling by nothing."""
    measured = material.measured
    made = measured.subset(np.zeros(len(measured), dtype=bool))
    count = material.scenario.synthetic if filling.count is None else filling.count
    if filling.by is None or count == 0:
        return made
    for label in measured.classes if filling.every_class else material.scenario.scarce:
        filler = _filler(material, filling, label)
        seed = derive_seed(material.seed, "filling", label) % 2**31
        made = made + filler(measured, label=label, pressure=material.scenario.pressure, count=count, seed=seed)
    return made


def _filler(material: Material, filling: Filling, label: str) -> Filler:
    if filling.by in FILLERS:
        return FILLERS[filling.by]
    if filling.by not in TWINS:
        raise InputError(f"nothing fills by {filling.by!r}; there are {', '.join((*TWINS, *FILLERS))}.")
    twins, posteriors = twins_of(material, filling.by, label)
    return TwinFiller(twins, posteriors, background=filling.background)


def twins_of(material: Material, by: str, label: str) -> tuple[list[Twin], list[Posterior] | None]:
    """Twins of a class at the scarce cells' pressure, one of each kind of fault for each training specimen, and what
    their calibrations leave open, where it is to be drawn from."""
    scenario, condition = material.scenario, material.condition()
    faults = scenario.faults[label] if label != "normal" else (None,)
    if by == "nominal":
        return [Twin(scenario.pump, condition, fault) for fault in faults], None
    known = material.own_calibrations(label)
    twins = [one.twin.at(condition).with_fault(fault) for fault in faults for one in known]
    return twins, [one.posterior for _ in faults for one in known] if by == "posterior" else None
