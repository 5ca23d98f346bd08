"""What the user should look at in estimates of a severity, in words."""

from collections.abc import Iterable, Sequence

import numpy as np

from swashtwin.calibration.result import Calibration
from swashtwin.calibration.severity.dimensions import FaultSpace
from swashtwin.calibration.severity.severity import (
    Severity,
    SeveritySettings,
)
from swashtwin.pump import (
    PRESSURE_TOLERANCE,
    values_match,
)
from swashtwin.recordings import Recording

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
    if not calibration.settings.get("phases"):
        yield "the calibration dropped the phases of the lines: severities are less certain; calibrate with phases."
    partners = {estimate.traded_with for estimate in estimates} - {None}
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
