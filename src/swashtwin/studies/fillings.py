"""Training sets by name: what was measured, and what fills the scarce cells beside it."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np
from sklearn.ensemble import ExtraTreesClassifier
from sklearn.metrics import roc_auc_score
from sklearn.model_selection import StratifiedKFold, cross_val_predict

from swashtwin.augmentation import synthesize
from swashtwin.calibration import Posterior
from swashtwin.features import extract_features
from swashtwin.seeding import derive_seed, stream
from swashtwin.signals import add_noise
from swashtwin.studies.material import Material, again_cut
from swashtwin.studies.scenario import NEAR
from swashtwin.twin import Twin
from swashtwin.windows import WindowSet

TWINS = ("nominal", "calibrated", "posterior")
"""What twins may fill with: as drawn, as calibrated, as drawn from what the calibrations leave open."""


CALIBRATED_TWINS = TWINS[1:]
"""Those that need a calibration."""

FURTHER = {"discriminator": "AUROC measured/synthetic"}
"""Headings of what is known of synthetic windows themselves."""


FOLDS = 5

TRAINING_SNRS = (0.0, 25.0)
"""Range of the ratios of noise in training [dB], a little wider than the tests'."""


@dataclass(frozen=True)
class Filling:
    """What a training set holds besides the measured windows."""

    by: str | None = None
    """A name in `TWINS`, or None for nothing."""
    count: int | None = None
    """Windows for each cell that is filled; None takes the scenario's."""
    every_class: bool = False
    """Fill every class at the scarce cells' pressure and not the scarce ones alone: the control of the fingerprint
    trap, for then "synthetic" tells no class."""
    noise: bool = False
    """Learn from a noisy copy of everything too, measured and synthetic windows alike."""

    def described(self) -> dict[str, Any]:
        """Settings as JSON can hold them."""
        return asdict(self)


PAPER_FILLINGS: Mapping[str, Filling] = MappingProxyType(
    {"measured": Filling(), "nominal": Filling("nominal"), "calibrated": Filling("calibrated")}
)
"""The paper's three training sets."""


def filled_cells(material: Material, filling: Filling) -> tuple[WindowSet, dict[str, float]]:
    """(synthetic windows that a filling adds, what is known of them)."""
    made = synthetic_windows_of(material, filling)
    values = {"discriminator": told_apart(material, made)} if len(made) else {}
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
    """AUROC of trees that tell measured windows of the scarce classes from synthetic ones: the fingerprint trap.

    0.5 is not at all, 1 always. Against the measured windows of the filled cells, or, where there are fewer than the
    folds, of their classes at any pressure. Folds are of windows, so windows of one recording stand on both sides: a
    value near 0.5 is safe to believe, one near 1 may be the recording's own.
    """
    measured = material.measured
    own = measured.subset(np.isin(measured.label, material.scenario.scarce))
    near = np.abs(own.discharge_pressure / material.scenario.pressure - 1) < NEAR
    own = own.subset(near) if near.sum() >= FOLDS else own
    both = own + made.subset(np.isin(made.label, material.scenario.scarce))
    if min(len(own), int(both.synthetic.sum())) < FOLDS:
        return float("nan")
    seed = derive_seed(material.seed, "discriminator") % 2**32
    trees = ExtraTreesClassifier(100, random_state=seed, class_weight="balanced", n_jobs=1)
    folds = StratifiedKFold(FOLDS, shuffle=True, random_state=seed)
    probability = cross_val_predict(
        trees, extract_features(both).values, both.synthetic, cv=folds, method="predict_proba"
    )
    return float(roc_auc_score(both.synthetic, probability[:, 1]))


def synthetic_windows_of(material: Material, filling: Filling) -> WindowSet:
    """The synthetic windows that a filling adds; none of a filling by nothing."""
    measured = material.measured
    made = measured.subset(np.zeros(len(measured), dtype=bool))
    count = material.scenario.synthetic if filling.count is None else filling.count
    if filling.by is None or count == 0:
        return made
    for label in measured.classes if filling.every_class else material.scenario.scarce:
        twins, posteriors = twins_of(material, filling.by, label)
        made = made + synthesize(
            twins,
            label=label,
            count=count,
            like=measured,
            seed=derive_seed(material.seed, "filling", label) % 2**31,
            posterior=posteriors,
        )
    return made


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
