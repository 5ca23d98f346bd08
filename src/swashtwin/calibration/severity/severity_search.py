"""Severity by inversion: from a pump's healthy calibration and its recordings to the size of a
fault.
"""

import math
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, replace
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float

from swashtwin.calibration.fault_dimensions import (
    Dimension,
    FaultSpace,
    build_fault_space,
    get_severity_search,
)
from swashtwin.calibration.measurement import (
    Lines,
    Measurement,
    assign_single_channels,
    measure,
    select_matching_recordings,
)
from swashtwin.calibration.posterior import IDENTIFIED_STD, NORMAL_QUANTILE, UNIDENTIFIED_SHARE
from swashtwin.calibration.recording_checks import require_one_machine
from swashtwin.calibration.result import Calibration
from swashtwin.calibration.severity.doubt import Explanation, describe_doubt, explain_doubt
from swashtwin.calibration.severity.inversion import SEVERITY_GRID, Ends, Inversion, Minimum, Prior
from swashtwin.calibration.severity.profile_likelihood import THRESHOLD
from swashtwin.calibration.severity.severity_result import (
    CLEAR_LIKELIHOOD_DIFFERENCE,
    MAX_SEVERITY_MISFIT,
    MIN_LIKELIHOOD_DIFFERENCE,
    DimensionEstimate,
    Severity,
    SeveritySettings,
    SeverityTrend,
    SeverityVerdict,
    combine_laws,
    combine_mistakes,
    describe_recording,
    describe_trend,
    interval_log_std,
    without_verdict,
)
from swashtwin.calibration.spectrum_objective import FLOOR, Comparison, Objective
from swashtwin.calibration.unknowns import VALUE_SLICE
from swashtwin.foundation import VERSION, DataError, InputError, mm, one_thread
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

MIN_CORRELATION = 0.7
"""Correlation above which another coordinate is named with the severity."""
UNIDENTIFIED_STD = 1.0
"""Standard deviation of the logarithm above which a severity that is not zero is not identified:
90 % within a factor of 5 to both sides.
"""
CONTACTS: tuple[Literal["shared", "lift_off"], ...] = ("shared", "lift_off")
"""Laws of contact that a recess is searched under: slippers follow it, or lift off. Which one holds
depends on depth and load, neither of which is known before the search.
"""
SEARCHED_DEPTH = mm(0.6)
"""Minimum depth [m] from which a recess is searched, the paper's."""
FIXED_STD = 1e-4
"""Standard deviation of a logarithm that is not searched."""

# Distance from its prior mean, in standard deviations, at which a further dimension lies on its
# bound of 4.
_BOUND_STDS = 3.99


def estimate_severity(
    calibration: Calibration,
    recordings: Iterable[Recording],
    fault: Fault,
    *,
    healthy: Iterable[Recording] = (),
    free: Sequence[str] | None = None,
    settings: SeveritySettings | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> SeverityTrend:
    """Return how severe `fault` is in each recording of one pump: value, interval, verdict,
    detection limit.

    Each recording is inverted separately, whatever its operating point: the fault's severity and
    further dimensions are searched together with the six interface values and the constants that
    the healthy calibration searched, whose posterior is the prior here, converted to the
    recording's oil and pressure (`film_factors`, the pistons' film with half the viscosity's power)
    and widened by `SeveritySettings.drift`. The search minimizes the sum of squares of measured
    minus simulated lines, weighted by noise and by what twins lack. The severity's interval ends at
    values for which the minimum sum over all other coordinates is 2.71 higher (profile likelihood),
    around all minima that lie so low.

    A recess is searched under both laws of contact, `CONTACTS`, up to at least
    `SEARCHED_DEPTH` times the last of `SEVERITY_GRID`, whatever depth is specified
    (`combine_laws`); if the calibration identified a law (`Calibration.law`), under that one.

    With a calibration in doubt (`describe_doubt`) nothing is called identified. The severity is
    then estimated once more under each mistake that explains the doubt, and its interval reaches
    around all of these; if no mistake does, it is all that is searched.

    Phases of the lines are compared if the calibration compared them. Which piston or which bore is
    damaged only turns all lines together and cannot be determined; a swash plate defect's angle
    repeats after a piston's share of a turn; a width above a slipper's diameter does not act at
    all.

    Parameters
    ----------
    calibration : of this pump on its healthy recordings.
    recordings : of this pump, labeled as the fault (also in words that `propose_class` knows), as
        normal, or not at all; others are excluded.
    fault : its kind, with typical dimensions: the search starts there, and those not free are
        fixed.
    healthy : healthy recordings of this pump, for the part of its lines that the twin does not
        model, such as the scatter of its pistons. Without them this part is attributed to the
        fault.
    free : further dimensions to search, such as ``("length",)``; ``()`` for none. The default is
        `SeveritySearch.default_free`.
    progress : called with the number of finished recordings, and of all.

    Raises
    ------
    DataError
        No recording can be used; recordings of several machines.
    InputError
        A calibration of faulty recordings, or an impossible dimension.
    """
    settings = settings or SeveritySettings()
    candidates = list(recordings)
    healthy_recordings = list(healthy)

    space = _build_space(calibration, fault, free)
    require_one_machine([*candidates, *healthy_recordings], "a severity")

    pump = calibration.nominal.pump
    candidates, _ = assign_single_channels(candidates, pump)
    healthy_recordings, _ = assign_single_channels(healthy_recordings, pump)
    used, excluded = _select_recordings(candidates, fault)
    with one_thread():
        estimates = tuple(
            _estimate_recordings(calibration, used, space, healthy_recordings, settings, progress)
        )

    return SeverityTrend(
        reference=fault,
        estimates=estimates,
        excluded_recordings=excluded,
        notes=tuple(describe_trend(calibration, space, estimates, healthy_recordings, settings)),
        settings={**asdict(settings), "free": [dimension.name for dimension in space.free]},
        version=VERSION,
    )


def _build_space(calibration: Calibration, fault: Fault, free: Sequence[str] | None) -> FaultSpace:
    """Return what is searched of a fault, under the law that the calibration identified if any.

    Raises
    ------
    InputError
        The pump was calibrated with a fault.
    """
    if calibration.twin.fault is not None:
        raise InputError(
            f"The pump was calibrated with a fault ({calibration.twin.label}): calibrate it on its "
            "healthy recordings, so that the fault's effect remains to be estimated.",
            remedy="Calibrate with {fault='normal'}.",
        )

    space = build_fault_space(fault, free)
    if calibration.law is not None:
        space = calibration.law.apply_to_space(space)
    return space


def _select_recordings(
    recordings: Sequence[Recording], fault: Fault
) -> tuple[list[Recording], tuple[tuple[str, str], ...]]:
    """Return the recordings that may show the fault, and the ids of the others with the reason.

    Those of its class, also in other words, healthy ones and those without a label may show it.
    """
    used, excluded = [], []
    for recording in recordings:
        label = recording.label
        may_show_fault = (
            label in (None, fault.label)
            or is_healthy(label)
            or propose_class(str(label)) == fault.label
        )
        if recording.condition is None:
            reason = "it lacks speed or pressure; add them to the index"
            excluded.append((recording.recording_id, reason))
        elif may_show_fault:
            used.append(recording)
        else:
            reason = f"the recording's label is {label}, the fault's {fault.label}"
            excluded.append((recording.recording_id, reason))

    if not used:
        reasons = "; ".join(f"{name}: {reason}" for name, reason in excluded[:3])
        raise DataError(
            f"No recording to estimate a severity of ({reasons or 'there are no recordings'})."
        )
    return used, tuple(excluded)


def _estimate_recordings(
    calibration: Calibration,
    recordings: Sequence[Recording],
    space: FaultSpace,
    healthy: Sequence[Recording],
    settings: SeveritySettings,
    progress: Callable[[int, int], None] | None,
) -> Iterator[Severity]:
    """Yield the severity in each recording; if the calibration is in doubt, under all that
    explains the doubt.
    """
    explanations = None
    if describe_doubt(calibration):
        explanations = explain_doubt(calibration, healthy)
    for number, recording in enumerate(recordings, 1):
        if explanations is None:
            yield _estimate_recording(calibration, recording, space, healthy, settings)
        else:
            yield _estimate_in_doubt(calibration, explanations, recording, space, healthy, settings)
        if progress is not None:
            progress(number, len(recordings))


def _estimate_recording(
    calibration: Calibration,
    recording: Recording,
    space: FaultSpace,
    healthy: Sequence[Recording],
    settings: SeveritySettings,
) -> Severity:
    """Return the severity, for a recess under both laws of contact unless the calibration
    identified a law.
    """
    started = time.perf_counter()
    laws = [space]
    if calibration.law is None:
        laws = _list_laws(space)

    fits: dict[str, _LawFit] = {}
    losses: dict[str, float] = {}
    for law in laws:
        contact = getattr(law.reference, "contact", "")
        comparison = build_fault_comparison(
            calibration, [recording], law.reference, healthy, settings.band
        )
        inversion = build_inversion(calibration, [comparison], law, healthy, settings)
        if fits:
            # a law that is far from the first is not worth descents
            losses[contact] = inversion.estimate_loss()
            if losses[contact] - min(losses.values()) > CLEAR_LIKELIHOOD_DIFFERENCE:
                continue
        fits[contact] = _fit_law(comparison, inversion)
        losses[contact] = fits[contact].loss

    # a law that fits much worse needs no interval
    best_loss = min(losses.values())
    severities = {
        contact: (_estimate_under_law(calibration, recording, fit), fit.loss)
        for contact, fit in fits.items()
        if fit.loss - best_loss <= MIN_LIKELIHOOD_DIFFERENCE
    }
    severity = combine_laws(severities, [name for name in losses if name not in severities])
    return replace(severity, wall_s=time.perf_counter() - started)


def _estimate_in_doubt(
    calibration: Calibration,
    explanations: Sequence[Explanation],
    recording: Recording,
    space: FaultSpace,
    healthy: Sequence[Recording],
    settings: SeveritySettings,
) -> Severity:
    """Return the severity of a calibration in doubt, with an interval around those under each
    explanation; without one if nothing explains the doubt.
    """
    if not explanations:
        severity = _estimate_recording(calibration, recording, space, healthy, settings)
        search_end = float(SEVERITY_GRID[-1]) * _list_laws(space)[0].reference.severity
        note = (
            "the calibration is in doubt and no simple mistake explains it, or its healthy "
            "recordings are not given: nothing limits the severity"
        )
        dimensions = tuple(without_verdict(severity.dimensions, search_end))
        return replace(severity, dimensions=dimensions, notes=(*severity.notes, note))

    severities = {}
    for explanation in explanations:
        severities[explanation.mistake] = _estimate_recording(
            explanation.calibration,
            explanation.correct(recording),
            space,
            [explanation.correct(recording) for recording in healthy],
            settings,
        )
    return combine_mistakes(severities)


def _list_laws(space: FaultSpace) -> list[FaultSpace]:
    """Return the space under each law that its fault may follow.

    For a recess, the two laws of contact, from a depth that does not limit the search: what is
    stated of the depth decides neither on the law nor on the depths that are searched.
    """
    recess = space.reference
    if not isinstance(recess, SwashPlateDefect) or recess.contact not in CONTACTS:
        return [space]
    recess = replace(recess, depth=max(recess.depth, SEARCHED_DEPTH))
    return [replace(space, reference=replace(recess, contact=contact)) for contact in CONTACTS]


class _LawFit(NamedTuple):
    """How a recording fits under one law of the fault."""

    comparison: Comparison
    inversion: Inversion
    minima: list[Minimum]
    """Minima that may hold the truth, the deepest first."""
    misfit: float
    loss: float
    """-2 ln likelihood of the lines without the terms that laws share."""


def _fit_law(comparison: Comparison, inversion: Inversion) -> _LawFit:
    """Return the best fits of a recording under the law of the inversion's fault."""
    minima, misfit = inversion.find_minima()
    loss = minima[0].height + 2 * float(np.log(np.diag(inversion.root)).sum())
    return _LawFit(comparison, inversion, minima, misfit, loss)


def _estimate_under_law(calibration: Calibration, recording: Recording, fit: _LawFit) -> Severity:
    """Return the severity under the law of a fit."""
    inversion = fit.inversion
    misfit = fit.misfit
    space = inversion.space
    minima, ends = inversion.profile_severity(fit.minima)
    point = minima[0].point

    without_fault = point.copy()
    without_fault[inversion.severity] = 0.0
    without_fault, height_without = inversion.descend(without_fault, fixed=inversion.severity)
    evidence = max(0.0, height_without - minima[0].height)
    is_detected = evidence > inversion.threshold

    # before the weights change: the estimates belong to the fit with the fault
    covariance, deviation = inversion.covariance_at(point)
    further = _estimate_further_dimensions(inversion, minima, is_detected=is_detected)

    # from here on, the lines are weighted as for a pump without the fault
    inversion.update_weights(without_fault)
    inversion.root = inversion.root * max(misfit, 1.0)
    limit = inversion.detection_limit(without_fault)
    if not is_detected:
        ends = _ends_of_missed_fault(ends[1], limit)

    dimensions = [_estimate_severity(inversion, point, ends, is_detected=is_detected), *further]
    if misfit > MAX_SEVERITY_MISFIT:
        search_end = float(inversion.upper[inversion.severity]) * space.reference.severity
        dimensions = without_verdict(dimensions, search_end)

    assert recording.condition is not None  # `_select_recordings` excludes those without
    relative_severity = float(point[inversion.severity])
    repeatability = math.inf
    if relative_severity > 0:
        repeatability = deviation / relative_severity
    return Severity(
        recording_id=recording.recording_id,
        condition=recording.condition,
        fault=space.fault_at(point[inversion.severity :]),
        dimensions=tuple(dimensions),
        evidence=evidence,
        threshold=inversion.threshold,
        detection_limit=None if limit is None else limit * space.reference.severity,
        repeatability=repeatability,
        correlated_with=_find_correlated(covariance, inversion),
        misfit=misfit,
        simulations=inversion.simulations,
        wall_s=0.0,
        notes=(
            *fit.comparison.measurement.notes,
            *describe_recording(calibration, recording, misfit),
        ),
    )


def _ends_of_missed_fault(upper: float, limit: float | None) -> tuple[float, float]:
    """Return the ends of a severity that is not detected.

    A fault up to the detection limit, if there is one, could have been missed.
    """
    if limit is not None:
        upper = max(upper, limit)
    return -math.inf, upper


def build_fault_comparison(
    calibration: Calibration,
    recordings: Sequence[Recording],
    fault: Fault,
    healthy: Sequence[Recording],
    band: tuple[float, float],
) -> Comparison:
    """Return the comparison of the calibrated pump's twin with `fault` and recordings at one
    operating point, over the lines of `band` [Hz].
    """
    condition = recordings[0].condition
    assert condition is not None
    twin = replace(calibration.nominal.at(condition), fault=fault, path=None)

    # lines between the piston-pass lines, but for the first order, which is unbalance
    piston_count = twin.pump.rotating_group.piston_count
    has_shaft_lines = (twin.orders[twin.orders > 1] % piston_count).any()
    lines: Lines = "piston"
    if has_shaft_lines:
        lines = "shaft"

    phases = bool(calibration.settings.get("phases"))
    labeled = [recording.replace(label=twin.label) for recording in recordings]
    measurement = measure(twin, labeled, band, lines=lines, phases=phases)
    if measurement.channels != calibration.posterior.channels:
        raise DataError(
            f"The recording has the channels {', '.join(measurement.channels)}, but the "
            f"calibration has {', '.join(calibration.posterior.channels)}. Select the same "
            "channels of both (channels = [...] in the index)."
        )

    bandwidth = (float(measurement.orders[-1]) + 0.5) * twin.condition.shaft_frequency
    limited = replace(twin, bandwidth=bandwidth)
    return Comparison(limited, measurement, _line_floor(limited, measurement, healthy, lines))


def build_inversion(
    calibration: Calibration,
    comparisons: Sequence[Comparison],
    space: FaultSpace,
    healthy: Sequence[Recording],
    settings: SeveritySettings,
) -> Inversion:
    """Return the problem of estimating a fault of `space` from all `comparisons` at once, with what
    the calibration knows.
    """
    unknowns = calibration.posterior.unknowns
    center = calibration.posterior.point.copy()
    covariance = calibration.posterior.covariance.copy()

    # convert the values to the oil and pressure of the recording; half of the change is uncertain
    pump = calibration.twin.pump
    condition = comparisons[0].twin.condition
    calibrated_condition = _nearest_calibrated_condition(calibration, condition, healthy)
    factors = film_factors(pump, calibrated_condition, condition, bore_exponent=0.5)
    shift = np.log(factors.values())
    center[VALUE_SLICE] += shift
    uncertain_shift = shift / 2

    # the pistons' film may follow the viscosity not at all or fully: half of its change either way
    calibrated_viscosity = pump.oil.viscosity_at(calibrated_condition.oil_temperature)
    viscosity = pump.oil.viscosity_at(condition.oil_temperature)
    uncertain_shift[InterfaceValue.PISTON_BORE_DAMPING] = 0.5 * abs(
        math.log(calibrated_viscosity / viscosity)
    )
    drift = np.zeros((len(unknowns), len(unknowns)))
    drift[VALUE_SLICE, VALUE_SLICE] = np.diag(settings.drift**2 + uncertain_shift**2)

    if "excitation" in unknowns.scales:
        # healthy recordings do not show the excitation's scale; `law_std` counts its error
        index = unknowns.scale_index("excitation")
        covariance[index] = 0.0
        covariance[:, index] = 0.0
        covariance[index, index] = FIXED_STD**2

    # ports that the calibration estimated are known: their error is in its posterior
    port_timing = settings.port_timing
    if unknowns.port_angles:
        port_timing = 0.0

    prior = Prior(center, covariance + drift, drift)
    return Inversion(Objective(tuple(comparisons), unknowns), space, prior, port_timing)


def _line_floor(
    twin: Twin, measurement: Measurement, healthy: Sequence[Recording], lines: Lines
) -> Float[np.ndarray, "channel order"] | float:
    """Return the minimum deviation of each line [m/s^2]: for lines that the healthy twin does not
    have, what a healthy pump shows there, at unknown phases.
    """
    healthy_twin = twin.with_fault(None)
    is_silent = ~np.isin(measurement.orders, healthy_twin.orders)
    if not is_silent.any() or not any(is_healthy(recording.label) for recording in healthy):
        return FLOOR
    try:
        similar, _ = select_matching_recordings(healthy_twin, healthy)
    except DataError:
        return FLOOR

    labeled = [
        recording.select_channels(measurement.channels).replace(label=twin.label)
        for recording in similar
    ]
    amplitude = measure(twin, labeled, measurement.band, lines).amplitude
    level = np.sqrt(np.mean(amplitude[:, is_silent] ** 2, axis=1, keepdims=True))
    return np.where(is_silent, np.hypot(np.maximum(level, FLOOR / 10), amplitude), FLOOR)


def _nearest_calibrated_condition(
    calibration: Calibration, condition: OperatingCondition, healthy: Sequence[Recording]
) -> OperatingCondition:
    """Return the calibrated operating point nearest in pressure, with the mean oil temperature of
    the healthy recordings.
    """

    def pressure_distance(calibrated: OperatingCondition) -> float:
        return abs(math.log(calibrated.discharge_pressure / condition.discharge_pressure))

    nearest = min((fit.condition for fit in calibration.fits), key=pressure_distance)
    temperatures = [
        recording.condition.oil_temperature
        for recording in healthy
        if recording.condition is not None and recording.recording_id in calibration.recording_ids
    ]
    if not temperatures:
        return nearest
    return nearest.replace(oil_temperature=float(np.mean(temperatures)))


def _estimate_severity(
    inversion: Inversion, point: np.ndarray, ends: Ends, *, is_detected: bool
) -> DimensionEstimate:
    """Return the severity with the interval of its profiles, widened by the error of the fault's
    law.
    """
    space = inversion.space
    below, above = ends
    law_width = NORMAL_QUANTILE * get_severity_search(space.reference).law_std
    upper_bound = float(inversion.upper[inversion.severity])
    high = above
    if math.isinf(above):
        high = upper_bound
    low = 0.0
    if is_detected:
        low = max(below, 0.0)
    log_std = interval_log_std(low, high)

    verdict: SeverityVerdict
    if math.isinf(above):
        verdict = "at bound"
    elif low == 0 and not is_detected:
        verdict = "not detected"
    elif log_std > UNIDENTIFIED_STD:
        verdict = "not identified"
    elif log_std > IDENTIFIED_STD:
        verdict = "weak"
    else:
        verdict = "identified"

    relative_severity = float(point[inversion.severity])
    # the error of the law is a factor, which a severity of zero does not show
    middle = relative_severity or high
    widened_low = 0.0
    if low > 0:
        widened_low = middle * math.exp(-math.hypot(math.log(middle / low), law_width))
    widened_high = middle * math.exp(math.hypot(math.log(high / middle), law_width))

    reference = space.reference.severity
    interval = (
        widened_low * reference,
        min(widened_high, max(upper_bound, high)) * reference,
    )
    return DimensionEstimate(
        space.free[0], relative_severity * reference, interval, log_std, verdict
    )


def _estimate_further_dimensions(
    inversion: Inversion, minima: Sequence[Minimum], *, is_detected: bool
) -> list[DimensionEstimate]:
    """Return the further dimensions with the hull of their intervals in all minima; as specified if
    there may be no fault.
    """
    stds = [np.sqrt(np.diag(inversion.covariance_at(minimum.point)[0])) for minimum in minima]
    reference = inversion.space.reference

    estimates = []
    for index, dimension in enumerate(inversion.space.free[1:], start=inversion.severity + 1):
        lows = []
        highs = []
        for minimum, std in zip(minima, stds, strict=True):
            rise = minimum.height - minima[0].height
            reach = math.sqrt(THRESHOLD - rise) * dimension.std_factor * std[index]
            lows.append(minimum.point[index] - reach)
            highs.append(minimum.point[index] + reach)

        if is_detected:
            coordinate = float(minima[0].point[index])
            law_width = NORMAL_QUANTILE * dimension.law_std
            low = coordinate - math.hypot(coordinate - min(lows), law_width)
            high = coordinate + math.hypot(max(highs) - coordinate, law_width)
        else:
            coordinate = 0.0
            low = -NORMAL_QUANTILE * dimension.prior_std
            high = NORMAL_QUANTILE * dimension.prior_std

        log_std = float(high - low) / (2 * NORMAL_QUANTILE)
        nominal = getattr(reference, dimension.name)
        interval = (nominal * math.exp(low), nominal * math.exp(high))
        verdict = _judge_dimension(dimension, coordinate, log_std)
        value = nominal * math.exp(coordinate)
        estimates.append(DimensionEstimate(dimension, value, interval, log_std, verdict))
    return estimates


def _judge_dimension(dimension: Dimension, coordinate: float, log_std: float) -> SeverityVerdict:
    """Return the verdict on a further dimension."""
    if abs(coordinate) > _BOUND_STDS * dimension.prior_std:
        return "at bound"
    if log_std > UNIDENTIFIED_SHARE * dimension.prior_std:
        return "not identified"
    if log_std > IDENTIFIED_STD:
        return "weak"
    return "identified"


def _find_correlated(covariance: np.ndarray, inversion: Inversion) -> str | None:
    """Return the coordinate that is most correlated with the severity, if it is enough."""
    severity = inversion.severity
    std = np.sqrt(np.diag(covariance))
    correlation = np.abs(covariance[severity] / np.maximum(std * std[severity], 1e-300))
    correlation[severity] = 0.0

    dimensions = [dimension.name for dimension in inversion.space.free]
    names = [*inversion.objective.unknowns.names, *dimensions]
    strongest = int(np.argmax(correlation))
    if correlation[strongest] <= MIN_CORRELATION:
        return None
    return names[strongest]
