"""Severity of a fault in one recording and in several, in its unit and with an interval."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from swashtwin.calibration.posterior import COVERAGE, IDENTIFIED_STD, QUANTILE
from swashtwin.calibration.result import Calibration
from swashtwin.calibration.severity.dimensions import Dimension, FaultSpace
from swashtwin.foundation import InputError, deg, to_table
from swashtwin.pump import PRESSURE_TOLERANCE, Fault, OperatingCondition, values_match
from swashtwin.recordings import Recording

SeverityVerdict = Literal["identified", "weak", "not identified", "not detected", "at bound"]


@dataclass(frozen=True)
class SeveritySettings:
    """How a severity is searched, and what is expected of the pump and of the model."""

    band: tuple[float, float] = (0.0, 1000.0)
    """Frequencies [Hz] whose lines are compared. A housing that bends above falsifies severities
    more than it falsifies the six values' spectrum, so this ends below `DEFAULT_BAND`.
    """
    drift: float = 0.15
    """Standard deviation by which the logarithm of each interface value may have moved since the
    healthy calibration [an estimate of ours], beside half of what oil and pressure are expected to
    move it by.
    """
    port_timing: float = deg(0.7)
    """Standard deviation of the shaft angle at which a port begins to open, from that of the pump
    file [rad]; an estimate of ours, the same as in `PumpPrior.timing`. What it changes in the lines
    is no sign of a fault.
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
    """Which."""
    value: float
    """Value found [SI]."""
    interval: tuple[float, float]
    """Range that holds it with a probability of 90 % [SI]; begins at zero where there may be none,
    and ends at the greatest value that was searched where nothing limits it.
    """
    log_std: float
    """Standard deviation of its logarithm that the recording and the priors leave; infinite where
    it may be zero. The interval of a severity holds the error of the fault's law besides.
    """
    verdict: SeverityVerdict
    """``identified``: known to a standard deviation of a quarter; ``weak``; ``not identified``:
    hardly better known than before, or to a factor of five; ``not detected``: there may be no
    fault; ``at bound``: beyond what was searched.
    """

    @property
    def words(self) -> str:
        """Value and interval in the dimension's unit."""
        low, high = (f"{end / self.dimension.per_unit:.3g}" for end in self.interval)
        return f"{self.dimension.words(self.value)} ({low} ... {high})"


@dataclass(frozen=True, eq=False)
class Severity:
    """Severity of a fault in one recording."""

    recording_id: str
    """Which recording."""
    condition: OperatingCondition
    """Its condition."""
    fault: Fault | None
    """The fault of the values found; None where its severity is zero."""
    dimensions: tuple[DimensionEstimate, ...]
    """The severity, then the further dimensions searched."""
    evidence: float
    """How much worse the lines fit without the fault: rise of the sum of squares."""
    threshold: float
    """Evidence below which there may be no fault at all: noise alone exceeds it in 5 % of all
    cases.
    """
    detection_limit: float | None
    """Least severity [SI] that such a recording distinguishes from none with 5 % of errors of
    either kind (Currie 1968, doi:10.1021/ac60259a007); None beyond the search. Where a fault acts
    besides its severity, as a grown area does beside an advance, none is a severity of nearly
    zero.
    """
    repeatability: float
    """Standard deviation of the logarithm of the severity from recording to recording of this pump:
    noise and drift of its films. What is common to all of them, such as the fault's law, is not in
    it.
    """
    correlated_with: str | None
    """What else could change along with the severity at almost the same lines (correlation above
    0.7).
    """
    misfit: float
    """Root mean square of the lines' differences over what was expected; above 1 the intervals are
    widened by it.
    """
    simulations: int
    """How many twins were simulated."""
    wall_s: float
    """How long it took [s]."""
    notes: tuple[str, ...] = ()
    """What the user should look at."""

    @property
    def severity(self) -> DimensionEstimate:
        """The dimension that carries the severity."""
        return self.dimensions[0]


DECIDED = 6.0
"""Difference of -2 ln likelihood from which lines decide between two laws: one is twenty times
likelier.
"""
_VERDICTS: tuple[SeverityVerdict, ...] = (
    "identified",
    "weak",
    "not identified",
    "not detected",
    "at bound",
)


def either_law(shared: tuple[Severity, float], lifting: tuple[Severity, float]) -> Severity:
    """The likelier of the severities under two laws of contact; around both where the lines do not
    decide.

    Each is a severity with its -2 ln likelihood: where films are strained, and where slippers lift
    off.
    """
    pairs = {"shared": shared, "lift_off": lifting}
    (likelier, (best, loss)), (unlikelier, (other, more)) = sorted(
        pairs.items(), key=lambda item: item[1][1]
    )
    sizes = f"{best.severity.words} if contact={likelier}, {other.severity.words} if contact={unlikelier}"
    if more - loss > DECIDED:
        note = f"{sizes}; the lines are those of the first"
        return replace(best, notes=(*best.notes, note))
    dimensions = []
    for first, second in zip(
        best.dimensions, other.dimensions, strict=True
    ):  # the wider interval, the lesser verdict
        low, high = (
            min(first.interval[0], second.interval[0]),
            max(first.interval[1], second.interval[1]),
        )
        log_std = math.log(high / low) / (2 * QUANTILE) if low > 0 else math.inf
        verdict = max(first.verdict, second.verdict, key=_VERDICTS.index)
        if verdict == "identified" and log_std > IDENTIFIED_STD:
            verdict = "weak"
        dimensions.append(replace(first, interval=(low, high), log_std=log_std, verdict=verdict))
    return replace(
        best,
        dimensions=tuple(dimensions),
        notes=(*best.notes, f"{sizes}; the lines do not tell which"),
    )


@dataclass(frozen=True, eq=False)
class SeverityTrend:
    """Severities of one pump's recordings, in the order given."""

    reference: Fault
    """The kind of fault, with the dimensions that were not searched."""
    estimates: tuple[Severity, ...]
    """One for each recording."""
    excluded_recordings: tuple[tuple[str, str], ...]
    """Id of each recording that was not looked at, and why."""
    notes: tuple[str, ...]
    """What the user should look at."""
    settings: Mapping[str, Any]
    """Settings, as JSON can hold them."""
    version: str
    """Version of swashtwin."""

    def __repr__(self) -> str:
        severities = "; ".join(
            f"{item.recording_id}: {item.severity.words}" for item in self.estimates[:3]
        )
        more = f"; {len(self.estimates) - 3} more" if len(self.estimates) > 3 else ""
        return f"<SeverityTrend of {type(self.reference).__name__}: {severities}{more}>"

    def to_dict(self) -> dict[str, Any]:
        """All of it as JSON can hold it, in SI; a dimension with its unit and what one such unit is
        in SI.
        """
        kind, table = {"kind": type(self.reference).__name__}, to_table(self)
        for row in table["estimates"]:
            row["fault"] = row["fault"] and kind | row["fault"]
            for entry in row["dimensions"]:
                dimension = entry.pop("dimension")
                entry |= {name: dimension[name] for name in ("name", "unit", "per_unit")}
        return {**table, "reference": kind | table["reference"], "confidence": COVERAGE}


WIDER = 1.5
"""Ratio of the calibration's band to that of severities from which a note is due."""


def recording_notes(calibration: Calibration, recording: Recording, misfit: float) -> Iterable[str]:
    assert recording.condition is not None
    pressure = recording.condition.discharge_pressure
    calibrated = [fit.condition.discharge_pressure for fit in calibration.fits]
    if not values_match(pressure, np.array(calibrated), PRESSURE_TOLERANCE).any():
        at = ", ".join(f"{value / 1e6:.4g}" for value in calibrated)
        yield f"at {pressure / 1e6:.4g} MPa, calibrated at {at} MPa: the values were carried over"
    if misfit > 2:
        yield f"its lines miss the twin's by {misfit:.2g} times what was expected: perhaps another fault"


def severity_notes(
    calibration: Calibration,
    space: FaultSpace,
    estimates: Sequence[Severity],
    healthy: Sequence[Recording],
    settings: SeveritySettings,
) -> Iterable[str]:
    band, most = calibration.settings.get("band"), settings.band[1]
    if band is not None and band[1] > WIDER * most:
        yield (
            f"the pump was calibrated up to {band[1] / 1000:g} kHz, severities are searched up to {most / 1000:g} kHz: "
            f'a housing that bends above falsifies them; calibrate with --band "0-{most / 1000:g} kHz".'
        )
    if calibration.is_in_doubt:
        yield (
            f"the pump's calibration is in doubt (it misses lines by {calibration.misfit:.2g} times what was expected, "
            "or strains a bound or a prior; see its notes), so no severity is called identified: calibrate with the "
            "default nuisances and phases, or mend what its notes name."
        )
    elif not calibration.settings.get("phases"):
        yield "the calibration dropped the phases of the lines: severities are less certain; calibrate with phases."
    partners = {estimate.correlated_with for estimate in estimates} - {None}
    if partners:
        yield (
            f"the severity is traded with {', '.join(sorted(map(str, partners)))}: it is known no better than these; a "
            "change from recording to recording is known better (repeatability)."
        )
    dimensions = [item for severity in estimates for item in severity.dimensions]
    flat = sorted({item.dimension.name for item in dimensions if item.verdict == "not identified"})
    if flat:
        yield f"{', '.join(flat)}: not identified; the recording hardly says more than was assumed."
    if "angle" in {dimension.name for dimension in space.free}:
        yield (
            "an angle is not told from the angle one piston further on, and without phases only where the fault's "
            "lines meet those of the pressures."
        )
    if not healthy and space.reference.label != "swash_plate":
        yield "no healthy recordings were given: lines of a healthy pump are attributed to the fault."
