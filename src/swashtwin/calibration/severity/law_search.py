"""The law of a recess, identified from recordings of it beside the pump's healthy calibration."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from swashtwin.calibration.measurement import assign_single_channels
from swashtwin.calibration.posterior import MISFIT, Estimate, estimated
from swashtwin.calibration.result import Calibration, FaultLaw
from swashtwin.calibration.severity.dimensions import fault_space
from swashtwin.calibration.severity.inversion import FACTORS, Inversion, Minimum
from swashtwin.calibration.severity.severity import SeveritySettings
from swashtwin.calibration.severity.severity_search import comparison_of_fault, invert
from swashtwin.calibration.spectrum_objective import Comparison
from swashtwin.foundation import DataError, InputError, one_thread
from swashtwin.physics import Twin
from swashtwin.pump import Fault, Pump, SwashPlateDefect, group_by_condition, is_same_class
from swashtwin.recordings import Recording
from swashtwin.signals import power_density

Contact = Literal["shared", "lift_off"]
Edge = Literal["half_sine", "raised_cosine"]
LAWS: tuple[tuple[Contact, Edge], ...] = (
    ("shared", "half_sine"),
    ("shared", "raised_cosine"),
    ("lift_off", "half_sine"),
    ("lift_off", "raised_cosine"),
)
"""Contacts and shapes of the entry that are compared: films that pull, and slippers that lift off
and land. Only the likelier entry is ridden.
"""
FREE: dict[Contact, tuple[str, ...]] = {
    "shared": ("corner", "fall", "length", "angle"),
    "lift_off": ("corner", "fall", "length", "angle", "gain", "leakage"),
}
"""What is searched beside the depth. Where films are strained, the depth and a slipper's share of
the stiffness (`gain`) multiply one another: the lines hold their product alone, which counts as
depth.
"""
DEPTH_PRIOR = math.log(FACTORS[-1] / FACTORS[0]) / math.sqrt(12)
"""Standard deviation of ln depth before anything is measured: as if even over all that is
searched.
"""
FLOOR_PRIOR = 0.7
"""The same of the noise's factor: at most fourfold in 95 % [an estimate of ours]."""
REASSEMBLY = 0.05
"""Least standard deviation of ln noise from one recording to the next [an estimate of ours]."""
_CLEAR = 3.0
"""Distance from the piston-pass lines beyond which there is noise [lines of the spectrum]."""
_SEGMENT = 16384
"""Samples of a segment of the noise's spectrum."""


def typical_corner(pump: Pump) -> float:
    """Corner [Hz] before anything is measured: of a slipper's mass on its share of the films'
    stiffness.

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
    """The law under which a recess explains recordings of it best.

    Its dimensions are searched together with the six values and all constants of the healthy
    calibration, whose posterior is the prior, once under each of `LAWS`. All recordings share one
    recess, whatever their pressures.

    Parameters
    ----------
    calibration : of this pump on its healthy recordings.
    recordings : those of the recess are used.
    fault : the recess as far as it is known: the search starts there.
    healthy : what was calibrated on, to compare the noise with.

    Raises
    ------
    InputError
        The fault is no recess, whose law alone has unknowns.
    DataError
        No recording of the recess states its condition, or its channels are not those that were
        calibrated.
    """
    if not isinstance(fault, SwashPlateDefect):
        raise InputError(
            f"the law of {type(fault).__name__} has no unknowns; a law is searched of a recess, swash_plate, alone."
        )
    placed, _ = assign_single_channels(recordings, calibration.nominal.pump)
    used = [
        item
        for item in placed
        if item.condition is not None and is_same_class(item.label, fault.label)
    ]
    if not used:
        raise DataError(
            f"no recording of {fault.label} states its condition: there is nothing to find its law from."
        )
    points = group_by_condition([item.condition for item in used if item.condition is not None])
    band, settings = tuple(calibration.settings["band"]), SeveritySettings()
    fault = replace(fault, corner=fault.corner or typical_corner(calibration.nominal.pump))
    fits: dict[str, tuple[float, SwashPlateDefect, tuple[Estimate, ...], float]] = {}
    starts: list[np.ndarray] = []
    with one_thread():
        for contact, edge in LAWS:
            shared = [fit[0] for name, fit in fits.items() if name.startswith("shared")]
            if contact == "lift_off" and fits[f"shared, {edge}"][0] < max(shared):
                continue  # a ride costs much: it is compared with the likelier entry alone
            space = fault_space(replace(fault, contact=contact, edge=edge), FREE[contact])
            comparisons = [
                comparison_of_fault(
                    calibration, [used[index] for index in group], space.reference, healthy, band
                )
                for group in points
            ]
            inversion = invert(calibration, comparisons, space, healthy, settings)
            starts = starts or _starts(inversion)
            missing = np.zeros(
                max(0, len(inversion.lower) - len(starts[0]))
            )  # as stated; or there are too many
            minima, misfit = inversion.search(
                [np.concatenate([start, missing])[: len(inversion.lower)] for start in starts]
            )
            starts = [minima[0].point]
            fits[f"{contact}, {edge}"] = _fit(inversion, minima[0], misfit)
    likeliest, best, estimates, misfit = max(fits.values(), key=lambda fit: fit[0])
    return FaultLaw(
        fault=best,
        estimates=(*estimates, _floor(comparisons, healthy)),
        evidence={name: fit[0] - likeliest for name, fit in fits.items()},
        misfit=misfit,
        recording_ids=tuple(item.recording_id for item in used),
    )


def _starts(inversion: Inversion) -> list[np.ndarray]:
    """The recess as stated, with a corner in the middle of its prior and a deviation to both
    sides.
    """
    center = np.concatenate([inversion.prior.center, inversion.space.start])
    corner = np.eye(len(center))[inversion.severity + 1]
    return [center, center - corner, center + corner]


def _fit(
    inversion: Inversion, minimum: Minimum, misfit: float
) -> tuple[float, SwashPlateDefect, tuple[Estimate, ...], float]:
    """(ln evidence but for what all laws share, the recess, its estimates, the misfit) of one law.

    The evidence is Laplace's: of the sum of squares, of the noise's covariance, and of how far each
    unknown is narrowed.
    """
    first, space = inversion.severity, inversion.space
    widths = np.array([1.0, *(dimension.deviation for dimension in space.free[1:])])
    covariance, _ = inversion.deviations(minimum.point)
    _, slope = inversion.at(minimum.point)
    scaled = slope * np.concatenate([np.ones(first), widths])
    determinants = (
        2 * np.log(np.diag(inversion.root)).sum() + np.linalg.slogdet(scaled.T @ scaled)[1]
    )
    coordinates = minimum.point[first:].copy()
    coordinates[0] = max(
        coordinates[0], math.exp(-4 * DEPTH_PRIOR)
    )  # no recess at all is one at the bound
    fault = space.at(coordinates)
    assert isinstance(fault, SwashPlateDefect)
    std = np.sqrt(np.diag(covariance))[first:]
    std[0] /= coordinates[0]
    estimates = []
    for dimension, deviation in zip(space.free, std.tolist(), strict=True):
        typical, prior = (
            getattr(space.reference, dimension.name),
            min(dimension.deviation, DEPTH_PRIOR),
        )
        estimates.append(
            _estimate(
                dimension.name,
                fault.units.get(dimension.name, ""),
                typical,
                getattr(fault, dimension.name),
                deviation,
                prior,
                misfit,
            )
        )
    return -0.5 * float(minimum.height + determinants), fault, tuple(estimates), misfit


def _estimate(
    name: str,
    unit: str,
    typical: float,
    value: float,
    std: float,
    prior: float,
    misfit: float = 0.0,
) -> Estimate:
    """Estimate of an unknown of the law, in SI; the search reaches four deviations of its prior to
    both sides.
    """
    return estimated(
        f"law.{name}",
        name,
        unit,
        nominal=typical,
        value=value,
        log_std=min(std, prior),
        prior_std=prior,
        bounds=(typical * math.exp(-4 * prior), typical * math.exp(4 * prior)),
        in_doubt=misfit > MISFIT,
    )


def _floor(comparisons: Sequence[Comparison], healthy: Sequence[Recording]) -> Estimate:
    """By what factor the noise between the lines is above that of healthy recordings at the same
    conditions.
    """
    rises, variances = [], []
    for comparison in comparisons:
        faulty, twin = comparison.measurement.recordings, comparison.twin
        same = [
            item
            for item in healthy
            if item.condition is not None and item.condition.matches(twin.condition)
        ]
        sides = [[_noise(twin, item) for item in side] for side in (faulty, same)]
        if same:
            rises.append(float(np.mean(sides[0]) - np.mean(sides[1])))
            variances += [max(float(np.var(side)), REASSEMBLY**2) / len(side) for side in sides]
    if not rises:
        return _estimate("floor", "", 1.0, 1.0, FLOOR_PRIOR, FLOOR_PRIOR)
    std = math.sqrt(sum(variances)) / len(rises)
    return _estimate("floor", "", 1.0, math.exp(float(np.mean(rises))), std, FLOOR_PRIOR)


def _noise(twin: Twin, recording: Recording) -> float:
    """Mean logarithm of the amplitude between the piston-pass lines, over all channels."""
    frequency, power = power_density(recording.signal, recording.sample_rate, _SEGMENT)
    passing = twin.pump.rotating_group.piston_count * twin.condition.shaft_frequency
    away = np.abs(frequency - passing * np.round(frequency / passing))
    clear = (
        (away > _CLEAR * frequency[1])
        & (frequency > passing / 2)
        & (frequency < recording.sample_rate / 2.56)
    )
    return float(np.log(power[:, clear]).mean() / 2)
