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

# Folds of the discriminator; fewer if there are fewer measured or synthetic recordings.
_MAX_FOLDS = 5

# Number of distinguishing features that are reported.
_N_NAMED_FEATURES = 5

_MIN_POWER = 1e-30

# Distance of a spectral line from the piston-pass lines, in their spacing, from which it belongs to
# the floor between them.
_MIN_FLOOR_DISTANCE = 0.3

# Half the sample rate over the highest usable frequency: above it the anti-aliasing filter of an
# instrument acts.
_BAND_OF_SAMPLE_RATE = 1.28


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
    """How well synthetic windows can be separated from measured ones, and by which features."""

    auroc: float | None
    """`discriminative_score`; None if one side has windows of a single recording only."""
    spectral_distance_db: Mapping[str, float]
    features: tuple[DistinguishingFeature, ...]
    """The features that separate best, the best first."""
    n_measured: int
    n_recordings: int
    n_synthetic: int
    pressures: tuple[float, ...]
    """Specified discharge pressures of the measured windows [Pa]."""
    causes_db: Mapping[str, float]
    """Deviation of the synthetic windows [dB], by cause; see `causes`."""

    def __repr__(self) -> str:
        auroc = "no AUROC" if self.auroc is None else f"AUROC {self.auroc:.2f}"
        best = f", best separated by {self.features[0].name}" if self.features else ""
        return f"<Fidelity: {auroc} against {self.n_measured} measured windows{best}>"

    def to_dict(self) -> dict[str, Any]:
        """Return all of it as JSON can hold it."""
        return asdict(self)


def measure_fidelity(
    measured: WindowSet,
    synthetic: WindowSet,
    *,
    seed: int,
    pistons: int = 0,
    healthy: tuple[WindowSet, WindowSet] | None = None,
) -> Fidelity:
    """Return how well synthetic windows can be separated from measured ones of the same class.

    Parameters
    ----------
    measured : windows of the cell that the filler did not draw from.
    pistons : number of pistons of the twin; 0 leaves the causes out.
    healthy : measured and synthetic healthy windows, to separate the error of the fault's law from
        that of the path to the sensors.
    """
    _require_both(measured, synthetic)
    n_recordings = len(np.unique(measured.recording_id))
    auroc = None
    if n_recordings > 1 and len(np.unique(synthetic.recording_id)) > 1:
        auroc = discriminative_score(measured, synthetic, seed=seed)

    distance = spectral_distance(measured, synthetic)
    pressures = measured.discharge_pressure
    return Fidelity(
        auroc=auroc,
        spectral_distance_db=dict(zip(measured.channels, distance.tolist(), strict=True)),
        features=_distinguishing_features(measured, synthetic),
        n_measured=len(measured),
        n_recordings=n_recordings,
        n_synthetic=len(synthetic),
        pressures=tuple(np.unique(pressures[~np.isnan(pressures)]).tolist()),
        causes_db=causes(measured, synthetic, pistons, healthy) if pistons else {},
    )


def causes(
    measured: WindowSet,
    synthetic: WindowSet,
    pistons: int,
    healthy: tuple[WindowSet, WindowSet] | None = None,
) -> dict[str, float]:
    """Return the deviation of synthetic windows from measured ones, by cause.

    Each is a root mean square over lines and channels [dB]:

    - ``path``: mean levels of the piston-pass lines of healthy windows;
    - ``law``: those of the windows themselves beyond that, which the fault must explain;
    - ``law and path``: both together, without healthy windows;
    - ``floor``: levels between the lines;
    - ``variation``: standard deviation of the lines from window to window.
    """
    measured_lines, measured_floor = _line_levels(measured, pistons)
    synthetic_lines, synthetic_floor = _line_levels(synthetic, pistons)
    shift = synthetic_lines.mean(axis=0) - measured_lines.mean(axis=0)

    parts = {"law and path": shift}
    if healthy is not None:
        measured_healthy, synthetic_healthy = (
            _line_levels(windows, pistons)[0].mean(axis=0) for windows in healthy
        )
        path = synthetic_healthy - measured_healthy
        parts = {"law": shift - path, "path": path}
    parts["floor"] = synthetic_floor.mean(axis=0) - measured_floor.mean(axis=0)
    parts["variation"] = synthetic_lines.std(axis=0) - measured_lines.std(axis=0)
    return {name: float(np.sqrt(np.mean(part**2))) for name, part in parts.items()}


def _line_levels(windows: WindowSet, pistons: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the levels [dB] of the piston-pass lines and of the floor above each.

    Both have the axes (window, channel, line).
    """
    power = 10 * np.log10(np.maximum(_power(windows), _MIN_POWER))
    pass_frequency = np.nanmean(windows.speed) / (2 * np.pi) * pistons
    frequency = np.arange(1, power.shape[-1] + 1) * windows.sample_rate / windows.length
    harmonic = frequency / pass_frequency
    nearest = np.round(harmonic).astype(int)
    is_floor = np.abs(harmonic - np.round(harmonic)) > _MIN_FLOOR_DISTANCE

    lines = []
    floors = []
    for number in range(1, int(harmonic[-1] / _BAND_OF_SAMPLE_RATE) + 1):
        lines.append(power[..., nearest == number].max(axis=-1))
        floors.append(power[..., (np.floor(harmonic) == number) & is_floor].mean(axis=-1))
    return np.stack(lines, axis=-1), np.stack(floors, axis=-1)


def _distinguishing_features(
    measured: WindowSet, synthetic: WindowSet
) -> tuple[DistinguishingFeature, ...]:
    """Return the features with the highest AUROC, each alone."""
    measured_values = feature_values(measured.signal)
    synthetic_values = feature_values(synthetic.signal)
    n_measured = len(measured_values)
    n_synthetic = len(synthetic_values)

    # The rank sum of Mann and Whitney gives the AUROC of each feature.
    ranks = rankdata(np.concatenate([measured_values, synthetic_values]), axis=0)
    rank_sum = ranks[n_measured:].sum(axis=0)
    auroc = (rank_sum - n_synthetic * (n_synthetic + 1) / 2) / (n_synthetic * n_measured)

    deviation = np.maximum(measured_values.std(axis=0), 1e-12)
    shift = (synthetic_values.mean(axis=0) - measured_values.mean(axis=0)) / deviation
    features = [
        DistinguishingFeature(*column)
        for column in zip(
            feature_names(measured.channels),
            np.maximum(auroc, 1 - auroc).tolist(),
            shift.tolist(),
            strict=True,
        )
    ]
    features.sort(key=lambda feature: -feature.auroc)
    return tuple(features[:_N_NAMED_FEATURES])


def spectral_distance(measured: WindowSet, synthetic: WindowSet) -> Float64[np.ndarray, " channel"]:
    """Return the log-spectral distance [dB] of each channel: 0 for equal mean power spectra.

    d = sqrt(mean over lines of (10 log10(P_measured / P_synthetic))^2), P being the power at a line
    (Hann taper, mean removed) averaged over the windows. A gain of 1 dB in all lines is a distance
    of 1 dB. Training windows as the measured ones show only how well the filler was fitted.
    """
    _require_both(measured, synthetic)
    measured_power = np.maximum(_power(measured).mean(axis=0), _MIN_POWER)
    synthetic_power = np.maximum(_power(synthetic).mean(axis=0), _MIN_POWER)
    difference = 10 * np.log10(measured_power / synthetic_power)
    return np.sqrt(np.mean(difference**2, axis=-1))


def discriminative_score(measured: WindowSet, synthetic: WindowSet, *, seed: int) -> float:
    """Return the AUROC of extra trees that separate synthetic from measured windows.

    0.5 is chance. It is cross-validated, with no recording on both sides. A measured set of few
    recordings is recognized by their peculiarities: copies of the training windows (`Duplicate`)
    show the score to be granted to every filler.

    Raises
    ------
    DataError
        The measured windows are of one recording.
    """
    _require_both(measured, synthetic)
    groups = np.concatenate([measured.recording_id, synthetic.recording_id])
    n_folds = min(
        _MAX_FOLDS,
        len(np.unique(measured.recording_id)),
        len(np.unique(synthetic.recording_id)),
    )
    if n_folds < 2:
        raise DataError(
            "Measured windows of one recording would be recognized by that recording. Give windows "
            "of at least two recordings."
        )

    is_synthetic = np.repeat([0, 1], [len(measured), len(synthetic)])
    values = np.concatenate([feature_values(windows.signal) for windows in (measured, synthetic)])
    tree_seed = derive_seed(seed, "discriminator") % 2**32
    trees = ExtraTreesClassifier(100, class_weight="balanced", random_state=tree_seed, n_jobs=1)
    folds = StratifiedGroupKFold(n_folds, shuffle=True, random_state=tree_seed)
    probability = cross_val_predict(
        trees, values, is_synthetic, groups=groups, cv=folds, method="predict_proba"
    )
    return float(roc_auc_score(is_synthetic, probability[:, 1]))


def _power(windows: WindowSet) -> Float64[np.ndarray, "window channel frequency"]:
    """Return the power density of each window, without the line at zero."""
    _, density = power_density(windows.signal.astype(float), windows.sample_rate)
    power: np.ndarray = density[..., 1:]
    return power


def _require_both(measured: WindowSet, synthetic: WindowSet) -> None:
    if not (len(measured) and len(synthetic)):
        raise DataError(
            f"There are {len(measured)} measured and {len(synthetic)} synthetic windows; at least "
            "one of each is needed."
        )
    difference = measured.layout.difference(synthetic.layout)
    if difference:
        raise InputError(f"Measured and synthetic windows differ: {difference}.")
