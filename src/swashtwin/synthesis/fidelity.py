"""Fidelity of synthetic windows to measured ones.

The docstring of each metric names the measured windows it needs: held-out windows, which no filler
saw, or the training windows that the filler drew from.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from jaxtyping import Float64
from scipy.stats import rankdata
from sklearn.ensemble import ExtraTreesClassifier
from sklearn.metrics import roc_auc_score
from sklearn.model_selection import StratifiedGroupKFold, cross_val_predict

from swashtwin.foundation import DataError, InputError, derive_seed
from swashtwin.learning import WindowSet, feature_names, feature_values
from swashtwin.signals import power_density

_FOLDS = 5
"""Folds of the discriminator; fewer where there are fewer measured recordings."""
_TELLING = 5
"""Features that are named of those that give synthetic windows away."""


@dataclass(frozen=True)
class DistinguishingFeature:
    """A vibration feature by which synthetic windows differ from measured ones."""

    name: str
    """Channel, part, feature, as `feature_names` names it."""
    auroc: float
    """AUROC of this feature alone, above 0.5 in either direction."""
    shift: float
    """Mean of the synthetic windows less that of the measured ones, in standard deviations of the
    measured.
    """


@dataclass(frozen=True)
class Fidelity:
    """How well synthetic windows are told from measured ones, and by what."""

    auroc: float | None
    """`discriminative_score`; None where the measured or the synthetic windows are of one
    recording.
    """
    spectral_distance_db: Mapping[str, float]
    features: tuple[DistinguishingFeature, ...]
    """The features that tell most, the first most."""
    n_measured: int
    n_recordings: int
    n_synthetic: int
    pressures: tuple[float, ...]
    """Discharge pressures of the measured windows [Pa], as far as stated."""
    causes_db: Mapping[str, float]
    """What gives the windows away [dB], by cause; see `causes`."""

    def __repr__(self) -> str:
        auroc = "no AUROC" if self.auroc is None else f"AUROC {self.auroc:.2f}"
        first = f", first told by {self.features[0].name}" if self.features else ""
        return f"<Fidelity: {auroc} against {self.n_measured} measured windows{first}>"

    def to_dict(self) -> dict[str, Any]:
        """All of it as JSON can hold it."""
        return asdict(self)


def measure_fidelity(
    measured: WindowSet,
    synthetic: WindowSet,
    *,
    seed: int,
    pistons: int = 0,
    healthy: tuple[WindowSet, WindowSet] | None = None,
) -> Fidelity:
    """How well synthetic windows are told from measured ones of the class, and by which features.

    Parameters
    ----------
    measured : windows of the cell that the filler did not draw from.
    pistons : number of pistons of the twin; 0 leaves the causes out.
    healthy : measured and synthetic healthy windows, to tell the fault's law from the sensors'
        path.
    """
    _require_both(measured, synthetic)
    several = min(len(np.unique(windows.recording_id)) for windows in (measured, synthetic)) > 1
    stated = measured.discharge_pressure[~np.isnan(measured.discharge_pressure)]
    distance = spectral_distance(measured, synthetic)
    return Fidelity(
        auroc=discriminative_score(measured, synthetic, seed=seed) if several else None,
        spectral_distance_db=dict(zip(measured.channels, distance.tolist(), strict=True)),
        features=_telling_features(measured, synthetic),
        n_measured=len(measured),
        n_recordings=len(np.unique(measured.recording_id)),
        n_synthetic=len(synthetic),
        pressures=tuple(np.unique(stated).tolist()),
        causes_db=causes(measured, synthetic, pistons, healthy) if pistons else {},
    )


def causes(
    measured: WindowSet,
    synthetic: WindowSet,
    pistons: int,
    healthy: tuple[WindowSet, WindowSet] | None = None,
) -> dict[str, float]:
    """By how much synthetic windows miss measured ones [dB, root mean square over lines and
    channels], by cause.

    ``path``: mean levels of the piston-pass lines of healthy windows; ``law``: those of the windows
    themselves beyond that, which the fault must explain; without healthy windows both together are
    ``law and path``. ``floor``: levels between the lines. ``variation``: the lines' standard
    deviation from window to window.
    """
    faulty = [_levels(windows, pistons) for windows in (measured, synthetic)]
    shift = faulty[1][0].mean(axis=0) - faulty[0][0].mean(axis=0)
    spread = faulty[1][0].std(axis=0) - faulty[0][0].std(axis=0)
    floor = faulty[1][1].mean(axis=0) - faulty[0][1].mean(axis=0)
    parts = {"law and path": shift}
    if healthy is not None:
        sound = [_levels(windows, pistons)[0].mean(axis=0) for windows in healthy]
        path = sound[1] - sound[0]
        parts = {"law": shift - path, "path": path}
    parts |= {"floor": floor, "variation": spread}
    return {name: float(np.sqrt(np.mean(part**2))) for name, part in parts.items()}


def _levels(windows: WindowSet, pistons: int) -> tuple[np.ndarray, np.ndarray]:
    """Levels [dB] of the piston-pass lines, and between each and the next (window, channel,
    line).
    """
    power = 10 * np.log10(np.maximum(_power(windows), 1e-30))
    passing = np.nanmean(windows.speed) / (2 * np.pi) * pistons
    position = np.arange(1, power.shape[-1] + 1) * windows.sample_rate / windows.length / passing
    number, away = np.round(position).astype(int), np.abs(position - np.round(position))
    most = int(position[-1] / 1.28)
    lines = [power[..., number == line].max(axis=-1) for line in range(1, most + 1)]
    floors = [
        power[..., (np.floor(position) == line) & (away > 0.3)].mean(axis=-1)
        for line in range(1, most + 1)
    ]
    return np.stack(lines, axis=-1), np.stack(floors, axis=-1)


def _telling_features(
    measured: WindowSet, synthetic: WindowSet
) -> tuple[DistinguishingFeature, ...]:
    """The features with the highest AUROC, each alone."""
    real, synthesized = (feature_values(windows.signal) for windows in (measured, synthetic))
    ranks = rankdata(np.concatenate([real, synthesized]), axis=0)[len(real) :].sum(axis=0)
    auroc = (ranks - len(synthesized) * (len(synthesized) + 1) / 2) / (len(synthesized) * len(real))
    shift = (synthesized.mean(axis=0) - real.mean(axis=0)) / np.maximum(real.std(axis=0), 1e-12)
    columns = zip(
        feature_names(measured.channels),
        np.maximum(auroc, 1 - auroc).tolist(),
        shift.tolist(),
        strict=True,
    )
    features = [DistinguishingFeature(*column) for column in columns]
    return tuple(sorted(features, key=lambda feature: -feature.auroc)[:_TELLING])


def spectral_distance(measured: WindowSet, synthetic: WindowSet) -> Float64[np.ndarray, " channel"]:
    """Log-spectral distance [dB] of each channel: 0 where the mean power spectra are the same.

    d = sqrt(mean over lines of (10 log10(P_measured / P_synthetic))^2), P being the power at a line
    (Hann taper, mean removed) averaged over the windows. A gain of 1 dB in all lines is a distance
    of 1 dB. Training windows as the measured ones show only how well the filler was fitted.
    """
    _require_both(measured, synthetic)
    power = [np.maximum(_power(windows).mean(axis=0), 1e-30) for windows in (measured, synthetic)]
    return np.sqrt(np.mean((10 * np.log10(power[0] / power[1])) ** 2, axis=-1))


def discriminative_score(measured: WindowSet, synthetic: WindowSet, *, seed: int) -> float:
    """AUROC of extra trees that tell synthetic from measured windows by vibration features; 0.5 is
    chance.

    It is cross-validated, no recording on both sides. A measured set of few recordings is
    recognized by their peculiarities: copies of the training windows (`Duplicate`) show the score
    to be granted to every filler.

    Raises
    ------
    DataError
        The measured windows are of one recording.
    """
    _require_both(measured, synthetic)
    groups = np.concatenate([measured.recording_id, synthetic.recording_id])
    folds = min(
        _FOLDS, len(np.unique(measured.recording_id)), len(np.unique(synthetic.recording_id))
    )
    if folds < 2:
        raise DataError(
            "measured windows of one recording would be recognized by that recording; give windows of two recordings "
            "at least."
        )
    is_synthetic = np.repeat([0, 1], [len(measured), len(synthetic)])
    values = np.concatenate([feature_values(windows.signal) for windows in (measured, synthetic)])
    tree_seed = derive_seed(seed, "discriminator") % 2**32
    trees = ExtraTreesClassifier(100, class_weight="balanced", random_state=tree_seed, n_jobs=1)
    split = StratifiedGroupKFold(folds, shuffle=True, random_state=tree_seed)
    probability = cross_val_predict(
        trees, values, is_synthetic, groups=groups, cv=split, method="predict_proba"
    )
    return float(roc_auc_score(is_synthetic, probability[:, 1]))


def _power(windows: WindowSet) -> Float64[np.ndarray, "window channel frequency"]:
    power: np.ndarray = power_density(windows.signal.astype(float), windows.sample_rate)[1][..., 1:]
    return power


def _require_both(measured: WindowSet, synthetic: WindowSet) -> None:
    if not (len(measured) and len(synthetic)):
        raise DataError(
            f"{len(measured)} measured and {len(synthetic)} synthetic windows; each side needs some."
        )
    if difference := measured.layout.difference(synthetic.layout):
        raise InputError(f"measured and synthetic windows differ: {difference}.")
