"""The operating points that recordings were measured at, and the twins that a calibration starts from there."""

from collections.abc import Sequence
from dataclasses import fields, replace

import numpy as np

from swashtwin.calibration.objective.measurement import LINE_SPEED_TOLERANCE
from swashtwin.foundation import DataError, InputError
from swashtwin.physics import Twin
from swashtwin.pump import Fault, OperatingCondition, Pump, group_by_condition, is_same_class, load_pump
from swashtwin.recordings import Recording


def starting_twins(
    pump: str | Pump | Twin | Sequence[Twin], recordings: Sequence[Recording], fault: Fault | None = None
) -> list[Twin]:
    """Twins of one pump: those given, or one for each operating point of the recordings of the fault's class.

    Raises
    ------
    InputError
        Twins differ in more than condition, or a fault is given beside them.
    DataError
        No recording has the fault's class, or none of those states its operating condition.
    """
    if isinstance(pump, str):
        pump = load_pump(pump)
    if isinstance(pump, Pump):
        return [Twin(pump, condition, fault) for condition in _operating_points(recordings, fault)]
    twins = [pump] if isinstance(pump, Twin) else list(pump)
    if not twins or not all(isinstance(twin, Twin) for twin in twins):
        raise InputError("pump must be a pump, its name, a twin or several twins; there is none.")
    if fault is not None:
        raise InputError("fault= belongs to a pump; a twin has its own: twin.with_fault(fault).")
    constant = [item.name for item in fields(Twin) if item.name != "condition"]
    for twin in twins[1:]:
        if any(getattr(twin, name) != getattr(twins[0], name) for name in constant):
            raise InputError("twins that are calibrated together must differ in condition only: twin.at(condition).")
    return twins


def _operating_points(recordings: Sequence[Recording], fault: Fault | None) -> list[OperatingCondition]:
    """Mean condition of each group of recordings at the same operating point, by speed and pressure."""
    label = "normal" if fault is None else fault.label
    labeled = [recording for recording in recordings if is_same_class(recording.label, label)]
    if not labeled:
        labels = ", ".join(sorted({str(recording.label) for recording in recordings})) or "no recording was given"
        hint = "give fault= for recordings of a fault" if fault is None else "give a fault of their class"
        raise DataError(
            f"no recording is labeled {label!r} (labels: {labels}); label healthy ones 'normal', or {hint}."
        )
    conditions = [recording.condition for recording in labeled if recording.condition is not None]
    if not conditions:
        raise DataError(
            f"{labeled[0].recording_id} states no operating condition, nor does any other {label} recording; add speed "
            'and discharge pressure, such as "860 rpm" and "10 MPa", to the index file.'
        )
    groups = group_by_condition(conditions, speed=LINE_SPEED_TOLERANCE)
    return [_mean([conditions[index] for index in group]) for group in groups]


def _mean(conditions: Sequence[OperatingCondition]) -> OperatingCondition:
    names = [item.name for item in fields(OperatingCondition)]
    means = {name: float(np.mean([getattr(condition, name) for condition in conditions])) for name in names}
    return replace(conditions[0], **means)
