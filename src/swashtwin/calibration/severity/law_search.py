"""The law of a recess, identified from recordings of it and the pump's healthy calibration."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from swashtwin.calibration.fault_dimensions import build_fault_space
from swashtwin.calibration.fault_law import NOISE_SYMBOL, FaultLaw
from swashtwin.calibration.measurement import assign_single_channels
from swashtwin.calibration.posterior import MAX_MISFIT, Estimate, build_estimate
from swashtwin.calibration.result import Calibration
from swashtwin.calibration.severity.inversion import SEVERITY_GRID, Inversion, Minimum
from swashtwin.calibration.severity.severity_result import SeveritySettings
from swashtwin.calibration.severity.severity_search import build_fault_comparison, build_inversion
from swashtwin.calibration.spectrum_objective import Comparison
from swashtwin.foundation import DataError, InputError, one_thread
from swashtwin.physics import Twin
from swashtwin.pump import Fault, Pump, SwashPlateDefect, group_by_condition, is_same_class
from swashtwin.recordings import Recording
from swashtwin.signals import power_density

Contact = Literal["shared", "lift_off"]
Edge = Literal["half_sine", "raised_cosine"]
EDGES: tuple[Edge, ...] = ("half_sine", "raised_cosine")
"""Shapes of the entry of a recess that are compared."""
FREE_DIMENSIONS: dict[Contact, tuple[str, ...]] = {
    "shared": ("corner", "fall", "length", "angle"),
    "lift_off": ("corner", "fall", "length", "angle", "gain", "leakage"),
}
"""Dimensions that are searched with the depth, by contact: films that pull, or slippers that lift
off and land. If films are strained, the depth and a slipper's share of the stiffness (`gain`)
multiply one another: the lines hold their product alone, which counts as depth.
"""
PRIOR_BOUND_STDS = 4.0
"""Bounds of an unknown of the law, in standard deviations of its prior."""
DEPTH_PRIOR_STD = math.log(SEVERITY_GRID[-1] / SEVERITY_GRID[0]) / math.sqrt(12)
"""Standard deviation of ln depth before anything is measured: that of a uniform density over all
that is searched.
"""
NOISE_PRIOR_STD = 0.7
"""The same of the noise's factor: at most fourfold in 95 % [an estimate of ours]."""
MIN_NOISE_SCATTER = 0.05
"""Minimum standard deviation of ln noise from one recording to the next [an estimate of ours]."""

# Distance from the piston-pass lines beyond which there is noise [lines of the spectrum].
_LINE_CLEARANCE = 3.0

# Samples of a segment of the noise's spectrum.
_SEGMENT_SAMPLES = 16384


@dataclass(frozen=True)
class _LawFit:
    """How a recess fits its recordings under one law."""

    log_evidence: float
    """Ln evidence without the terms that all laws share."""
    fault: SwashPlateDefect
    estimates: tuple[Estimate, ...]
    misfit: float


def typical_corner(pump: Pump) -> float:
    """Return the corner [Hz] before anything is measured: of a slipper's mass on its share of the
    films' stiffness.

    sqrt(K_sw / (n m)) / 2 pi. K_sw is known to a decade (docs/explanation/physics.md, section 4),
    and films damp: `dimensions` gives ln corner a standard deviation of 1.
    """
    stiffness = pump.interfaces.slipper_swash.stiffness / pump.rotating_group.piston_count
    return math.sqrt(stiffness / pump.masses.piston_slipper) / (2 * math.pi)


def identify_law(
    calibration: Calibration,
    recordings: Iterable[Recording],
    fault: Fault,
    healthy: Sequence[Recording],
) -> FaultLaw:
    """Return the law under which a recess explains recordings of it best.

    Its dimensions are searched together with the six values and all constants of the healthy
    calibration, whose posterior is the prior, once under each law. All recordings share one recess,
    whatever their pressures.

    Parameters
    ----------
    calibration : of this pump on its healthy recordings.
    recordings : recordings of the pump; those of the recess are used.
    fault : the recess with its known dimensions: the search starts there.
    healthy : recordings of the calibration, to compare the noise with.

    Raises
    ------
    InputError
        The fault is not a recess, the only fault whose law has unknowns.
    DataError
        No recording of the recess specifies its operating point, or its channels are not those of
        the calibration.
    """
    if not isinstance(fault, SwashPlateDefect):
        raise InputError(
            f"The law of {type(fault).__name__} has no unknowns: only the law of a recess, "
            "swash_plate, can be searched."
        )
    used = _select_recordings(calibration, recordings, fault)
    corner = fault.corner or typical_corner(calibration.nominal.pump)
    fault = replace(fault, corner=corner)

    conditions = [recording.condition for recording in used if recording.condition is not None]
    groups = [[used[index] for index in group] for group in group_by_condition(conditions)]
    with one_thread():
        fits, comparisons = _fit_laws(calibration, groups, fault, healthy)

    best = max(fits.values(), key=lambda fit: fit.log_evidence)
    return FaultLaw(
        fault=best.fault,
        estimates=(*best.estimates, _estimate_noise_factor(comparisons, healthy)),
        evidence={name: fit.log_evidence - best.log_evidence for name, fit in fits.items()},
        misfit=best.misfit,
        recording_ids=tuple(recording.recording_id for recording in used),
    )


def _select_recordings(
    calibration: Calibration, recordings: Iterable[Recording], fault: SwashPlateDefect
) -> list[Recording]:
    """Return the recordings of the recess that specify their operating point."""
    assigned, _ = assign_single_channels(recordings, calibration.nominal.pump)
    used = [
        recording
        for recording in assigned
        if recording.condition is not None and is_same_class(recording.label, fault.label)
    ]
    if not used:
        raise DataError(
            f"No recording of {fault.label} specifies its operating point, so its law cannot be "
            "identified. Add speed and pressure to the index."
        )
    return used


def _fit_laws(
    calibration: Calibration,
    groups: Sequence[Sequence[Recording]],
    fault: SwashPlateDefect,
    healthy: Sequence[Recording],
) -> tuple[dict[str, _LawFit], list[Comparison]]:
    """Return the fit of each law, by contact and edge, and the comparisons of the last one."""
    fits: dict[str, _LawFit] = {}
    starts: list[np.ndarray] = []
    laws: list[tuple[Contact, Edge]] = [("shared", edge) for edge in EDGES]

    while laws:
        contact, edge = laws.pop(0)
        space = build_fault_space(
            replace(fault, contact=contact, edge=edge), FREE_DIMENSIONS[contact]
        )
        band = tuple(calibration.settings["band"])
        comparisons = [
            build_fault_comparison(calibration, group, space.reference, healthy, band)
            for group in groups
        ]
        inversion = build_inversion(calibration, comparisons, space, healthy, SeveritySettings())

        # each law starts where the previous one ended; further dimensions start as specified
        n_coordinates = len(inversion.lower)
        starts = starts or _corner_starts(inversion)
        missing = np.zeros(max(0, n_coordinates - len(starts[0])))
        minima, misfit = inversion.find_minima(
            [np.concatenate([start, missing])[:n_coordinates] for start in starts]
        )
        starts = [minima[0].point]
        fits[f"{contact}, {edge}"] = _evaluate_law(inversion, minima[0], misfit)

        if len(fits) == len(EDGES):
            # lifting off costs much to simulate: it is compared with the likelier entry alone
            best_evidence = max(fit.log_evidence for fit in fits.values())
            laws = [
                ("lift_off", edge)
                for edge in EDGES
                if fits[f"shared, {edge}"].log_evidence == best_evidence
            ]
    return fits, comparisons


def _corner_starts(inversion: Inversion) -> list[np.ndarray]:
    """Return the recess as specified, with a corner in the middle of its prior and one deviation to
    both sides.
    """
    center = np.concatenate([inversion.prior.center, inversion.space.start])
    corner = np.eye(len(center))[inversion.severity + 1]
    return [center, center - corner, center + corner]


def _evaluate_law(inversion: Inversion, minimum: Minimum, misfit: float) -> _LawFit:
    """Return how one law fits.

    The evidence is Laplace's: of the sum of squares, of the noise's covariance, and of how far each
    unknown is narrowed.
    """
    severity = inversion.severity
    space = inversion.space
    covariance, _ = inversion.covariance_at(minimum.point)
    _, slope = inversion.residuals_at(minimum.point)

    prior_stds = [dimension.prior_std for dimension in space.free[1:]]
    scaled = slope * np.concatenate([np.ones(severity + 1), prior_stds])
    log_determinants = (
        2 * np.log(np.diag(inversion.root)).sum() + np.linalg.slogdet(scaled.T @ scaled)[1]
    )

    coordinates = minimum.point[severity:].copy()
    # a search that finds no recess ends at the bound of the depth, as ln depth must be finite
    min_depth = math.exp(-PRIOR_BOUND_STDS * DEPTH_PRIOR_STD)
    coordinates[0] = max(coordinates[0], min_depth)
    fault = space.fault_at(coordinates)
    assert isinstance(fault, SwashPlateDefect)

    # the depth is a factor, the other coordinates are logarithms: now all are logarithms
    std = np.sqrt(np.diag(covariance))[severity:]
    std[0] /= coordinates[0]
    estimates = [
        _build_law_estimate(
            dimension.name,
            fault.units.get(dimension.name, ""),
            nominal=getattr(space.reference, dimension.name),
            value=getattr(fault, dimension.name),
            std=deviation,
            prior_std=min(dimension.prior_std, DEPTH_PRIOR_STD),
            in_doubt=misfit > MAX_MISFIT,
        )
        for dimension, deviation in zip(space.free, std.tolist(), strict=True)
    ]
    log_evidence = -0.5 * float(minimum.height + log_determinants)
    return _LawFit(log_evidence, fault, tuple(estimates), misfit)


def _build_law_estimate(
    name: str,
    unit: str,
    *,
    nominal: float,
    value: float,
    std: float,
    prior_std: float,
    in_doubt: bool = False,
) -> Estimate:
    """Return the estimate of an unknown of the law, in SI."""
    reach = PRIOR_BOUND_STDS * prior_std
    return build_estimate(
        f"law.{name}",
        name,
        unit,
        nominal=nominal,
        value=value,
        log_std=min(std, prior_std),
        prior_std=prior_std,
        bounds=(nominal * math.exp(-reach), nominal * math.exp(reach)),
        in_doubt=in_doubt,
    )


def _estimate_noise_factor(
    comparisons: Sequence[Comparison], healthy: Sequence[Recording]
) -> Estimate:
    """Return the factor of the noise between the lines over that of healthy recordings at the same
    operating points.
    """
    rises = []
    variances = []
    for comparison in comparisons:
        twin = comparison.twin
        peers = [
            recording
            for recording in healthy
            if recording.condition is not None and recording.condition.matches(twin.condition)
        ]
        if not peers:
            continue
        faulty_noise = [
            _log_noise(twin, recording) for recording in comparison.measurement.recordings
        ]
        healthy_noise = [_log_noise(twin, recording) for recording in peers]
        rises.append(float(np.mean(faulty_noise) - np.mean(healthy_noise)))
        for noise in (faulty_noise, healthy_noise):
            variances.append(max(float(np.var(noise)), MIN_NOISE_SCATTER**2) / len(noise))

    factor = 1.0
    std = NOISE_PRIOR_STD
    if rises:
        factor = math.exp(float(np.mean(rises)))
        std = math.sqrt(sum(variances)) / len(rises)
    return _build_law_estimate(
        NOISE_SYMBOL, "", nominal=1.0, value=factor, std=std, prior_std=NOISE_PRIOR_STD
    )


def _log_noise(twin: Twin, recording: Recording) -> float:
    """Return the mean logarithm of the amplitude between the piston-pass lines, over all
    channels.
    """
    frequency, power = power_density(recording.signal, recording.sample_rate, _SEGMENT_SAMPLES)
    spacing = twin.pump.rotating_group.piston_count * twin.condition.shaft_frequency
    distance = np.abs(frequency - spacing * np.round(frequency / spacing))
    is_noise = (
        (distance > _LINE_CLEARANCE * frequency[1])
        & (frequency > spacing / 2)
        & (frequency < recording.sample_rate / 2.56)
    )
    return float(np.log(power[:, is_noise]).mean() / 2)
