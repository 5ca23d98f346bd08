"""Severity by inversion: from a pump's healthy calibration and its recordings to the size of a
fault.
"""

import math
import time
from collections.abc import Iterable, Sequence
from dataclasses import asdict, replace

import numpy as np
from jaxtyping import Float

from swashtwin.calibration.measurement import (
    Lines,
    Measurement,
    assign_single_channels,
    measure,
    select_agreeing,
)
from swashtwin.calibration.posterior import IDENTIFIED_STD, QUANTILE, UNIDENTIFIED_SHARE
from swashtwin.calibration.recording_checks import require_one_machine
from swashtwin.calibration.result import Calibration
from swashtwin.calibration.severity.dimensions import (
    Dimension,
    FaultSpace,
    fault_space,
    get_severity_search,
)
from swashtwin.calibration.severity.inversion import Ends, Inversion, Minimum, Prior
from swashtwin.calibration.severity.profile_likelihood import THRESHOLD
from swashtwin.calibration.severity.severity import (
    DimensionEstimate,
    Severity,
    SeveritySettings,
    SeverityTrend,
    SeverityVerdict,
    either_law,
    recording_notes,
    severity_notes,
)
from swashtwin.calibration.spectrum_objective import FLOOR, Comparison, Objective
from swashtwin.calibration.unknowns import VALUES
from swashtwin.foundation import VERSION, DataError, InputError, one_thread
from swashtwin.physics import Twin, film_factors
from swashtwin.pump import (
    Fault,
    InterfaceValue,
    OperatingCondition,
    SwashPlateDefect,
    is_healthy,
    propose_class,
)
from swashtwin.recordings import Recording

TRADED = 0.7
"""Correlation above which another coordinate is named beside the severity."""
UNIDENTIFIED_STD = 1.0
"""Standard deviation of the logarithm above which a severity that is not zero is not known: 90 %
within a factor of 5 to both sides.
"""
FIXED_STD = 1e-4
"""Standard deviation of a logarithm that is not searched."""


def estimate_severity(
    calibration: Calibration,
    recordings: Iterable[Recording],
    fault: Fault,
    *,
    healthy: Iterable[Recording] = (),
    free: Sequence[str] | None = None,
    settings: SeveritySettings | None = None,
) -> SeverityTrend:
    """How severe `fault` is in each recording of one pump: value, interval, verdict, detection
    limit.

    Each recording is inverted on its own, whatever its condition: searched are the fault's severity
    and further dimensions together with the six interface values and the constants that the healthy
    calibration had searched, whose posterior is the prior here, carried over to the recording's oil
    and pressure (`film_factors`, the pistons' film with half the viscosity's power) and widened by
    `SeveritySettings.drift`. Minimized is the sum of squares of measured minus simulated lines,
    weighed by noise and by what twins lack; the severity's interval is where the least sum over all
    else rises by 2.71 (profile likelihood), around all minima that lie so low.

    A recess that is deeper than films reach (`with_fitting_contact`), as stated or as found, is
    searched under both laws of contact (`either_law`); one that states no corner, under the law
    that the calibration identified, if it did (`Calibration.law`). Of a calibration in doubt
    (`Calibration.is_in_doubt`) nothing is called identified.

    Phases of the lines are compared where the calibration compared them. Which piston or which bore
    is damaged only turns all lines together and cannot be found; a swash plate defect's angle
    repeats after a piston's share of a turn; a width above a slipper's diameter does not act at
    all.

    Parameters
    ----------
    calibration : of this pump on its healthy recordings.
    recordings : of this pump, labelled as the fault (also in words that `propose_class` knows), as
        normal, or not at all; others are left out.
    fault : its kind, with typical dimensions: the search starts there, and those not free stay as
        they are.
    healthy : healthy recordings of this pump, for the part of its lines that the twin does not
        model, such as the scatter of its pistons. Without them this part is attributed to the
        fault.
    free : further dimensions to search, such as ``("length",)``; the usual ones by default, none
        with ``()``.

    Raises
    ------
    DataError
        No recording can be looked at; recordings of several machines.
    InputError
        A calibration of faulty recordings, or an impossible dimension.
    """
    settings, candidates, healthy_recordings = (
        settings or SeveritySettings(),
        list(recordings),
        list(healthy),
    )
    space = fault_space(fault, free)
    if calibration.law is not None:
        space = calibration.law.space(space)
    if calibration.twin.fault is not None:
        raise InputError(
            f"the known pump is calibrated with a fault ({calibration.twin.label}); calibrate on its healthy "
            "recordings, so that the fault's share stays to be found: swashtwin calibrate --fault normal."
        )
    require_one_machine([*candidates, *healthy_recordings], "a severity")
    candidates, _ = assign_single_channels(candidates, calibration.nominal.pump)
    healthy_recordings, _ = assign_single_channels(healthy_recordings, calibration.nominal.pump)
    used, excluded_recordings = _chosen(candidates, fault)
    with one_thread():
        estimates = tuple(
            _of_recording(calibration, recording, space, healthy_recordings, settings)
            for recording in used
        )
    return SeverityTrend(
        reference=fault,
        estimates=estimates,
        excluded_recordings=excluded_recordings,
        notes=tuple(severity_notes(calibration, space, estimates, healthy_recordings, settings)),
        settings={**asdict(settings), "free": [dimension.name for dimension in space.free]},
        version=VERSION,
    )


def _chosen(
    recordings: Sequence[Recording], fault: Fault
) -> tuple[list[Recording], tuple[tuple[str, str], ...]]:
    """Recordings that may show the fault: of its class, also in other words, healthy or of none;
    and why not others.
    """
    used, excluded_recordings = [], []
    for recording in recordings:
        label = recording.label
        if recording.condition is None:
            excluded_recordings.append(
                (recording.recording_id, "it lacks speed or pressure; add them to the index")
            )
        elif (
            label in (None, fault.label)
            or is_healthy(label)
            or propose_class(str(label)) == fault.label
        ):
            used.append(recording)
        else:
            excluded_recordings.append(
                (
                    recording.recording_id,
                    f"the recording's label is {label}, the fault's {fault.label}",
                )
            )
    if not used:
        reasons = (
            "; ".join(f"{name}: {reason}" for name, reason in excluded_recordings[:3])
            or "none was given"
        )
        raise DataError(f"no recording to estimate a severity of ({reasons}).")
    return used, tuple(excluded_recordings)


def _of_recording(
    calibration: Calibration,
    recording: Recording,
    space: FaultSpace,
    healthy: Sequence[Recording],
    settings: SeveritySettings,
) -> Severity:
    """Severity under the stated law; where a recess is deeper than films reach, also with slippers
    that lift off, but where the calibration found a law of its own.
    """
    shared = _under_one_law(calibration, recording, space, healthy, settings)
    fault = space.reference
    if (
        not isinstance(fault, SwashPlateDefect)
        or fault.contact != "shared"
        or calibration.law is not None
    ):
        return shared[0]
    deepest = replace(fault, depth=max(fault.depth, shared[0].severity.value))
    if deepest.with_fitting_contact() == deepest:
        return shared[0]
    lifting = replace(space, reference=replace(fault, contact="lift_off"))
    return either_law(shared, _under_one_law(calibration, recording, lifting, healthy, settings))


def _under_one_law(
    calibration: Calibration,
    recording: Recording,
    space: FaultSpace,
    healthy: Sequence[Recording],
    settings: SeveritySettings,
) -> tuple[Severity, float]:
    """(severity under the law of the space's fault, -2 ln likelihood of the lines but for what laws
    share).
    """
    started = time.perf_counter()
    comparison = comparison_of_fault(
        calibration, [recording], space.reference, healthy, settings.band
    )
    inversion = invert(calibration, [comparison], space, healthy, settings)
    minima, misfit = inversion.search()
    minima, ends = inversion.profiled(minima)
    point, height = minima[0].point, minima[0].height
    loss = height + 2 * float(np.log(np.diag(inversion.root)).sum())
    without_fault = point.copy()
    without_fault[inversion.severity] = 0.0
    without_fault, height_without = inversion.descend(without_fault, fixed=inversion.severity)
    covariance, deviation = inversion.deviations(point)
    evidence = max(0.0, height_without - height)
    is_there = evidence > inversion.threshold
    further = _further(inversion, minima, is_there=is_there)
    inversion.weigh(without_fault)
    inversion.root = inversion.root * max(misfit, 1.0)
    limit = inversion.detection_limit(without_fault)
    if not is_there:  # a fault up to the detection limit could have been missed
        ends = None, ends[1] if ends[1] is None or limit is None else max(ends[1], limit)
    dimensions = (_severity(inversion, point, ends, is_there=is_there), *further)
    if calibration.is_in_doubt:
        dimensions = tuple(
            replace(item, verdict="weak") if item.verdict == "identified" else item
            for item in dimensions
        )
    assert recording.condition is not None  # `_chosen` lets none pass
    relative = float(point[inversion.severity])
    severity = Severity(
        recording_id=recording.recording_id,
        condition=recording.condition,
        fault=space.at(point[inversion.severity :]),
        dimensions=dimensions,
        evidence=evidence,
        threshold=inversion.threshold,
        detection_limit=None if limit is None else limit * space.reference.severity,
        repeatability=deviation / relative if relative > 0 else math.inf,
        correlated_with=_traded(covariance, inversion),
        misfit=misfit,
        simulations=inversion.simulations,
        wall_s=time.perf_counter() - started,
        notes=(
            *inversion.objective.comparisons[0].measurement.notes,
            *recording_notes(calibration, recording, misfit),
        ),
    )
    return severity, loss


def comparison_of_fault(
    calibration: Calibration,
    recordings: Sequence[Recording],
    fault: Fault,
    healthy: Sequence[Recording],
    band: tuple[float, float],
) -> Comparison:
    """The calibrated pump's twin with `fault` beside recordings at one condition, over the lines of
    `band` [Hz].
    """
    condition = recordings[0].condition
    assert condition is not None
    twin = replace(calibration.nominal.at(condition), fault=fault, path=None)
    between = (
        twin.orders[twin.orders > 1] % twin.pump.rotating_group.piston_count
    )  # the first order is unbalance
    lines: Lines = "shaft" if between.any() else "piston"
    phases = bool(calibration.settings.get("phases"))
    labeled = [recording.replace(label=twin.label) for recording in recordings]
    measurement = measure(twin, labeled, band, lines=lines, phases=phases)
    limited = replace(
        twin, bandwidth=(float(measurement.orders[-1]) + 0.5) * twin.condition.shaft_frequency
    )
    floor = _floor(limited, measurement, healthy, lines)
    calibrated, channels = calibration.posterior.channels, measurement.channels
    if channels != calibrated:
        raise DataError(
            f"the recording has the channels {', '.join(channels)}, the calibration {', '.join(calibrated)}; take "
            "the same from both (channels = [...] in the index)."
        )
    return Comparison(limited, measurement, floor)


def invert(
    calibration: Calibration,
    comparisons: Sequence[Comparison],
    space: FaultSpace,
    healthy: Sequence[Recording],
    settings: SeveritySettings,
) -> Inversion:
    """The problem of finding a fault of `space` from all `comparisons` at once, with what the
    calibration knows.
    """
    unknowns = calibration.posterior.unknowns
    drift = np.zeros((len(unknowns), len(unknowns)))
    center, covariance = calibration.posterior.point.copy(), calibration.posterior.covariance.copy()
    pump, condition = calibration.twin.pump, comparisons[0].twin.condition
    here = _calibrated_at(calibration, condition, healthy)
    shift = np.log(film_factors(pump, here, condition, bore_exponent=0.5).values())
    center[VALUES] += shift
    uncertain = shift / 2
    bore = InterfaceValue.PISTON_BORE_DAMPING  # between no film and all film
    viscosities = [pump.oil.viscosity_at(point.oil_temperature) for point in (here, condition)]
    uncertain[bore] = 0.5 * abs(math.log(viscosities[0] / viscosities[1]))
    drift[VALUES, VALUES] = np.diag(settings.drift**2 + uncertain**2)
    if "excitation" in unknowns.scales:  # healthy recordings do not show it; `law` counts it
        index = unknowns.index_of_scale("excitation")
        covariance[index], covariance[:, index] = 0.0, 0.0
        covariance[index, index] = FIXED_STD**2
    prior = Prior(center, covariance + drift, drift)
    return Inversion(Objective(tuple(comparisons), unknowns), space, prior, settings.port_timing)


def _floor(
    twin: Twin, measurement: Measurement, healthy: Sequence[Recording], lines: Lines
) -> Float[np.ndarray, "channel order"] | float:
    """Least deviation of each line [m/s^2]: what a healthy pump shows where its twin is silent, at
    unknown phases.
    """
    healthy_twin = twin.with_fault(None)
    silent = ~np.isin(measurement.orders, healthy_twin.orders)
    if not silent.any() or not any(is_healthy(recording.label) for recording in healthy):
        return FLOOR
    try:
        similar, _ = select_agreeing(healthy_twin, healthy)
    except DataError:
        return FLOOR
    healthy_lines = measure(
        twin,
        [
            recording.select_channels(measurement.channels).replace(label=twin.label)
            for recording in similar
        ],
        measurement.band,
        lines,
    )
    level = np.sqrt(np.mean(healthy_lines.amplitude[:, silent] ** 2, axis=1, keepdims=True))
    return np.where(silent, np.hypot(np.maximum(level, FLOOR / 10), healthy_lines.amplitude), FLOOR)


def _calibrated_at(
    calibration: Calibration, condition: OperatingCondition, healthy: Sequence[Recording]
) -> OperatingCondition:
    """The calibrated condition nearest in pressure, with the mean oil temperature of the healthy
    recordings.
    """
    nearest = min(
        (fit.condition for fit in calibration.fits),
        key=lambda recording: abs(
            math.log(recording.discharge_pressure / condition.discharge_pressure)
        ),
    )
    temperatures = [
        recording.condition.oil_temperature
        for recording in healthy
        if recording.condition is not None and recording.recording_id in calibration.recording_ids
    ]
    return (
        nearest.replace(oil_temperature=float(np.mean(temperatures))) if temperatures else nearest
    )


def _severity(
    inversion: Inversion, point: np.ndarray, ends: Ends, *, is_there: bool
) -> DimensionEstimate:
    """The severity with the interval of its profiles, widened by the error of the fault's law."""
    space, (below, above) = inversion.space, ends
    law = get_severity_search(space.reference).law
    relative, typical = float(point[inversion.severity]), space.reference.severity
    most = float(inversion.upper[inversion.severity])
    low, high = (below or 0.0) if is_there else 0.0, most if above is None else above
    log_std = math.log(high / low) / (2 * QUANTILE) if low > 0 else math.inf
    verdict: SeverityVerdict = "not identified"
    if log_std <= UNIDENTIFIED_STD:
        verdict = "identified" if log_std <= IDENTIFIED_STD else "weak"
    if above is None:
        verdict = "at bound"
    elif low == 0 and not is_there:
        verdict = "not detected"
    middle = relative if relative > 0 else high
    widened = (
        middle * math.exp(-math.hypot(math.log(middle / low), QUANTILE * law)) if low > 0 else 0.0,
        middle * math.exp(math.hypot(math.log(high / middle), QUANTILE * law)),
    )
    interval = (widened[0] * typical, min(widened[1], max(most, high)) * typical)
    return DimensionEstimate(space.free[0], relative * typical, interval, log_std, verdict)


def _further(
    inversion: Inversion, minima: Sequence[Minimum], *, is_there: bool
) -> list[DimensionEstimate]:
    """The further dimensions with the hull of their intervals in all minima; as stated where there
    may be no fault.
    """
    space, estimates = inversion.space, []
    deviations = [np.sqrt(np.diag(inversion.deviations(minimum.point)[0])) for minimum in minima]
    for index, dimension in enumerate(space.free[1:], start=inversion.severity + 1):
        lows, highs = [], []
        for minimum, deviation in zip(minima, deviations, strict=True):
            reach = (
                math.sqrt(THRESHOLD - (minimum.height - minima[0].height))
                * dimension.share
                * deviation[index]
            )
            lows.append(minimum.point[index] - reach)
            highs.append(minimum.point[index] + reach)
        typical, coordinate = (
            getattr(space.reference, dimension.name),
            float(minima[0].point[index]),
        )
        law = QUANTILE * dimension.law
        low, high = (
            coordinate - math.hypot(coordinate - min(lows), law), coordinate + math.hypot(max(highs) - coordinate, law)
        )  # fmt: skip
        if not is_there:
            coordinate, low, high = (
                0.0,
                -QUANTILE * dimension.deviation,
                QUANTILE * dimension.deviation,
            )
        std = float(high - low) / (2 * QUANTILE)
        interval = (typical * math.exp(low), typical * math.exp(high))
        verdict = _verdict(dimension, coordinate, std)
        estimates.append(
            DimensionEstimate(dimension, typical * math.exp(coordinate), interval, std, verdict)
        )
    return estimates


def _verdict(dimension: Dimension, coordinate: float, std: float) -> SeverityVerdict:
    if abs(coordinate) > 3.99 * dimension.deviation:
        return "at bound"
    if std > UNIDENTIFIED_SHARE * dimension.deviation:
        return "not identified"
    return "identified" if std <= IDENTIFIED_STD else "weak"


def _traded(covariance: np.ndarray, inversion: Inversion) -> str | None:
    index = inversion.severity
    std = np.sqrt(np.diag(covariance))
    correlation = np.abs(covariance[index] / np.maximum(std * std[index], 1e-300))
    correlation[index] = 0.0
    names = [
        *inversion.objective.unknowns.names,
        *(dimension.name for dimension in inversion.space.free),
    ]
    other = int(np.argmax(correlation))
    return names[other] if correlation[other] > TRADED else None
