"""Severity of a fault in one recording and in several, in its unit and with an interval."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from swashtwin.calibration.fault_dimensions import Dimension, FaultSpace
from swashtwin.calibration.posterior import (
    COVERAGE,
    IDENTIFIED_STD,
    NORMAL_QUANTILE,
)
from swashtwin.calibration.result import Calibration
from swashtwin.calibration.severity.doubt import describe_doubt
from swashtwin.foundation import InputError, to_table
from swashtwin.physics import PORT_TOLERANCE
from swashtwin.pump import PRESSURE_TOLERANCE, Fault, OperatingCondition, values_match
from swashtwin.recordings import Recording

SeverityVerdict = Literal[
    "identified", "weak", "not identified", "not detected", "at bound", "in doubt"
]


@dataclass(frozen=True)
class SeveritySettings:
    """How a severity is searched, and what is expected of the pump and of the model."""

    band: tuple[float, float] = (0.0, 1000.0)
    """Frequencies [Hz] whose lines are compared. A housing that bends above falsifies severities
    more than it falsifies the six values' spectrum, so this ends below `DEFAULT_BAND`.
    """
    drift: float = 0.15
    """Standard deviation by which the logarithm of each interface value may have moved since the
    healthy calibration [an estimate of ours], on top of half of what oil and pressure are expected
    to move it by.
    """
    port_timing: float = PORT_TOLERANCE
    """Standard deviation of the shaft angle at which a port begins to open, from that of the pump
    file [rad]. What it changes in the lines is not a sign of a fault. Not used if the calibration
    estimated the ports (`Nuisances.port_timing`), whose posterior is then what is known of them.
    """

    def __post_init__(self) -> None:
        for name in ("drift", "port_timing"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0):
                raise InputError(
                    f"SeveritySettings.{name} ({value:g}) must be zero or a positive number."
                )


@dataclass(frozen=True)
class DimensionEstimate:
    """One dimension of a fault, and how far to trust it."""

    dimension: Dimension
    """The dimension."""
    value: float
    """Estimated value [SI]."""
    interval: tuple[float, float]
    """Range that contains it with a probability of 90 % [SI]; begins at zero if there may be no
    fault, and ends at the greatest value that was searched if nothing limits it.
    """
    log_std: float
    """Standard deviation of its logarithm that the recording and the priors leave; infinite if it
    may be zero. The interval of a severity includes the error of the fault's law.
    """
    verdict: SeverityVerdict
    """``identified``: known to a standard deviation of a quarter; ``weak``; ``not identified``:
    hardly better known than before, or to a factor of five; ``not detected``: there may be no
    fault; ``at bound``: beyond what was searched; ``in doubt``: the twin misses the lines by more
    than `MAX_SEVERITY_MISFIT` at any severity, so nothing limits it.
    """

    @property
    def text(self) -> str:
        """Value and interval in the dimension's unit."""
        low, high = (f"{end / self.dimension.per_unit:.3g}" for end in self.interval)
        return f"{self.dimension.format_value(self.value)} ({low} ... {high})"


@dataclass(frozen=True, eq=False)
class Severity:
    """Severity of a fault in one recording."""

    recording_id: str
    """Id of the recording."""
    condition: OperatingCondition
    """Its operating point."""
    fault: Fault | None
    """The fault of the estimated dimensions; `None` if its severity is zero."""
    dimensions: tuple[DimensionEstimate, ...]
    """The severity, then the further dimensions searched."""
    evidence: float
    """How much worse the lines fit without the fault: rise of the sum of squares."""
    threshold: float
    """Evidence below which there may be no fault at all: noise alone exceeds it in 5 % of all
    cases.
    """
    detection_limit: float | None
    """Minimum severity [SI] that such a recording distinguishes from none with 5 % of errors of
    either kind (Currie 1968, doi:10.1021/ac60259a007); `None` if it lies beyond the search. If a
    fault has effects other than its severity, as a grown area has next to an advance, "none" is a
    severity of nearly zero.
    """
    repeatability: float
    """Standard deviation of the logarithm of the severity from recording to recording of this pump:
    noise and drift of its films. What is common to all of them, such as the fault's law, is not
    included.
    """
    correlated_with: str | None
    """What else could change with the severity at almost the same lines (correlation above 0.7)."""
    misfit: float
    """Root mean square of the lines' differences over what was expected; above 1 the intervals are
    widened by it.
    """
    simulations: int
    """Number of twins that were simulated."""
    wall_s: float
    """Time taken [s]."""
    notes: tuple[str, ...] = ()
    """Notes that the user should read."""

    @property
    def severity(self) -> DimensionEstimate:
        """The dimension that carries the severity."""
        return self.dimensions[0]


MIN_LIKELIHOOD_DIFFERENCE = 6.0
"""Difference of -2 ln likelihood from which lines decide between two laws: one is twenty times
likelier.
"""
CLEAR_LIKELIHOOD_DIFFERENCE = 3 * MIN_LIKELIHOOD_DIFFERENCE
"""The same for a law whose likelihood is only estimated (`Inversion.estimate_loss`)."""

# Verdicts from the most to the least certain.
_VERDICTS: tuple[SeverityVerdict, ...] = (
    "identified",
    "weak",
    "not identified",
    "not detected",
    "at bound",
    "in doubt",
)


def combine_laws(
    severities: Mapping[str, tuple[Severity, float]], rejected: Sequence[str]
) -> Severity:
    """Return the likelier of the severities under the laws of contact that explain the lines, with
    intervals around all of them.

    The detection limit is that of the law under which a fault is hardest to detect.

    Parameters
    ----------
    severities : by contact, the severity and -2 ln likelihood of the lines under each such law.
    rejected : contacts of the laws that fit much worse (`MIN_LIKELIHOOD_DIFFERENCE`).
    """
    contacts = sorted(severities, key=lambda contact: severities[contact][1])
    best, *rivals = [severities[contact][0] for contact in contacts]
    notes = [
        f"{best.severity.text} if {_CONTACT_CLAUSES[contacts[0]]}; the lines exclude that "
        f"{_CONTACT_CLAUSES[contact]}"
        for contact in rejected
    ]
    if not rivals:
        return replace(best, notes=(*best.notes, *notes))

    combined = best
    for rival in rivals:
        pairs = zip(combined.dimensions, rival.dimensions, strict=True)
        combined = replace(
            combined,
            dimensions=tuple(_combine_estimates(first, second) for first, second in pairs),
            detection_limit=_larger_limit(combined.detection_limit, rival.detection_limit),
        )
    sizes = ", ".join(
        f"{severities[contact][0].severity.text} if {_CONTACT_CLAUSES[contact]}"
        for contact in contacts
    )
    note = f"{sizes}; the lines do not decide between them"
    return replace(combined, notes=(*best.notes, note))


# What each contact of a recess means in the pump.
_CONTACT_CLAUSES = {
    "shared": "the oil film pulls slippers into the recess",
    "lift_off": "slippers lift off over the recess",
}


def combine_mistakes(severities: Mapping[str, Severity]) -> Severity:
    """Return the first severity with intervals around all, and with nothing identified.

    Parameters
    ----------
    severities : by the mistake that each corrects, the likeliest first; empty for none.
    """
    first, *others = severities.values()
    dimensions = first.dimensions
    limit = first.detection_limit
    for other in others:
        pairs = zip(dimensions, other.dimensions, strict=True)
        dimensions = tuple(_combine_estimates(*pair) for pair in pairs)
        limit = _larger_limit(limit, other.detection_limit)
    dimensions = tuple(
        replace(estimate, verdict="weak") if estimate.verdict == "identified" else estimate
        for estimate in dimensions
    )

    sizes = [
        f"{severity.severity.text} if {mistake or 'nothing is wrong'}"
        for mistake, severity in severities.items()
    ]
    note = f"the calibration is in doubt: {'; '.join(sizes)}"
    return replace(first, dimensions=dimensions, detection_limit=limit, notes=(*first.notes, note))


def _larger_limit(first: float | None, second: float | None) -> float | None:
    """Return the larger of two detection limits; `None` if one lies beyond the search."""
    if first is None or second is None:
        return None
    return max(first, second)


def _combine_estimates(first: DimensionEstimate, second: DimensionEstimate) -> DimensionEstimate:
    """Return the first estimate with an interval around both and the less certain verdict."""
    low = min(first.interval[0], second.interval[0])
    high = max(first.interval[1], second.interval[1])
    log_std = interval_log_std(low, high)

    verdict = max(first.verdict, second.verdict, key=_VERDICTS.index)
    if verdict == "identified" and log_std > IDENTIFIED_STD:
        verdict = "weak"
    return replace(first, interval=(low, high), log_std=log_std, verdict=verdict)


def without_verdict(
    dimensions: Sequence[DimensionEstimate], search_end: float
) -> list[DimensionEstimate]:
    """Return the dimensions in doubt, the severity with all that was searched as its interval.

    Parameters
    ----------
    search_end : the greatest severity that was searched [SI].
    """
    severity, *further = (replace(estimate, verdict="in doubt") for estimate in dimensions)
    return [replace(severity, interval=(0.0, search_end), log_std=math.inf), *further]


def interval_log_std(low: float, high: float) -> float:
    """Return the standard deviation of ln severity of which these are the ends of 90 %; infinite
    if the severity may be zero.
    """
    if low <= 0:
        return math.inf
    return math.log(high / low) / (2 * NORMAL_QUANTILE)


_MAX_SHOWN = 3


@dataclass(frozen=True, eq=False)
class SeverityTrend:
    """Severities of one pump's recordings, in the order given."""

    reference: Fault
    """The kind of fault, with the dimensions that were not searched."""
    estimates: tuple[Severity, ...]
    """One for each recording."""
    excluded_recordings: tuple[tuple[str, str], ...]
    """Id of each recording that was not used, and the reason."""
    notes: tuple[str, ...]
    """Notes that the user should read."""
    settings: Mapping[str, Any]
    """Settings, as JSON values."""
    version: str
    """Version of swashtwin."""

    def __repr__(self) -> str:
        severities = "; ".join(
            f"{estimate.recording_id}: {estimate.severity.text}"
            for estimate in self.estimates[:_MAX_SHOWN]
        )
        n_more = len(self.estimates) - _MAX_SHOWN
        more = f"; {n_more} more" if n_more > 0 else ""
        return f"<SeverityTrend of {type(self.reference).__name__}: {severities}{more}>"

    def to_dict(self) -> dict[str, Any]:
        """Return the trend as JSON values, in SI; a dimension with its unit and one such unit in
        SI.
        """
        table = to_table(self)
        kind = {"kind": type(self.reference).__name__}
        table["reference"] = kind | table["reference"]
        for row in table["estimates"]:
            if row["fault"]:
                row["fault"] = kind | row["fault"]
            for entry in row["dimensions"]:
                dimension = entry.pop("dimension")
                for name in ("name", "unit", "per_unit"):
                    entry[name] = dimension[name]
        return {**table, "confidence": COVERAGE}


MAX_BAND_RATIO = 1.5
"""Ratio of the calibration's band to that of severities above which a note is due."""
MAX_SEVERITY_MISFIT = 2.0
"""Misfit above which another fault is suspected."""


def describe_recording(
    calibration: Calibration, recording: Recording, misfit: float
) -> Iterator[str]:
    """Yield notes on the severity of one recording."""
    assert recording.condition is not None
    pressure = recording.condition.discharge_pressure
    calibrated = [fit.condition.discharge_pressure for fit in calibration.fits]
    if not values_match(pressure, np.array(calibrated), PRESSURE_TOLERANCE).any():
        pressures = ", ".join(f"{value / 1e6:.4g}" for value in calibrated)
        yield (
            f"recorded at {pressure / 1e6:.4g} MPa, calibrated at {pressures} MPa: the interface "
            "values were converted"
        )
    if misfit > MAX_SEVERITY_MISFIT:
        yield (
            f"its lines differ from the twin's {misfit:.2g} times as much as noise and model error "
            "explain: perhaps another fault; nothing limits its severity"
        )


def describe_trend(
    calibration: Calibration,
    space: FaultSpace,
    estimates: Sequence[Severity],
    healthy: Sequence[Recording],
    settings: SeveritySettings,
) -> Iterator[str]:
    """Yield notes on the severities of a pump."""
    yield from _describe_calibration(calibration, settings)

    partners = {estimate.correlated_with for estimate in estimates} - {None}
    if partners:
        yield (
            f"The severity is correlated with {', '.join(sorted(map(str, partners)))}: it is known "
            "no better than these. A change from recording to recording is known better "
            "(repeatability)."
        )

    dimensions = [dimension for severity in estimates for dimension in severity.dimensions]
    not_identified = sorted(
        {estimate.dimension.name for estimate in dimensions if estimate.verdict == "not identified"}
    )
    if not_identified:
        yield (
            f"{', '.join(not_identified)}: not identified; the recording adds hardly anything to "
            "the prior."
        )
    if "angle" in {dimension.name for dimension in space.free}:
        yield (
            "An angle cannot be distinguished from the angle one piston further on, and without "
            "phases only at lines that the fault shares with the pressures."
        )
    if not healthy and space.reference.label != "swash_plate":
        yield "Without healthy recordings, lines of a healthy pump are attributed to the fault."


def _describe_calibration(calibration: Calibration, settings: SeveritySettings) -> Iterator[str]:
    """Yield notes on what the calibration leaves uncertain in a severity."""
    calibrated_band = calibration.settings.get("band")
    severity_limit = settings.band[1]
    if calibrated_band is not None and calibrated_band[1] > MAX_BAND_RATIO * severity_limit:
        limit = f"{severity_limit / 1000:g} kHz"
        yield (
            f"The pump was calibrated up to {calibrated_band[1] / 1000:g} kHz, but severities are "
            f"searched up to {limit}: a housing that bends above falsifies them. Calibrate with "
            f'the band "0-{limit}".'
        )

    doubt = describe_doubt(calibration)
    if doubt:
        yield (
            f"The pump's calibration is in doubt ({doubt}; see its notes), so no severity is "
            "called identified. Calibrate with the default nuisances and phases, or correct what "
            "its notes name."
        )
    elif not calibration.settings.get("phases"):
        yield (
            "The calibration did not use the phases of the lines, so severities are less certain. "
            "Calibrate with phases."
        )
