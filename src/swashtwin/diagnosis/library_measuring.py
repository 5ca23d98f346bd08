"""Measures a library of changes on labeled recordings."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from swashtwin.diagnosis.change_library import ChangeLibrary, LibraryPump
from swashtwin.diagnosis.prior_classifier import PriorClassifier
from swashtwin.diagnosis.recording_arguments import require_recordings
from swashtwin.foundation import DataError, InputError
from swashtwin.pump import CLASSES, Nameplate, Pump, canonical_label, is_healthy
from swashtwin.recordings import Recording, build_manifest
from swashtwin.signals import OrderBands

# Any speed or pressure: a library holds no virtual pumps, whose ranges would count.
_ANY_VALUE = (0.0, 1e12)


def measure_library(
    recordings: Sequence[Recording],
    pump: Pump,
    *,
    fault_of: Mapping[str, str] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> ChangeLibrary:
    """Return the changes of machines of one design by their faults.

    Each machine needs healthy recordings at the operating points of its faults.

    Parameters
    ----------
    recordings : labeled ones of each machine (specimen). The attribute `severity` of a recording is
        kept as its severity.
    pump : design of the machines.
    fault_of : class that a label stands for, such as ``{"Verschleiß": "piston"}``.
    progress : called with the number of measured machines, and of all.

    Raises
    ------
    DataError
        A recording has no class, is synthetic or cannot be used, a fault was recorded at another
        speed than its machine's healthy recordings, or a machine has no fault or no healthy
        recording.
    InputError
        The design has no rated speed and pressure.
    """
    recordings = require_recordings(recordings)
    for recording in recordings:
        if recording.synthetic:
            raise DataError(
                f"{recording.recording_id} is synthetic; a library holds measured changes only."
            )
        if recording.label is None:
            raise DataError(
                f"{recording.recording_id} has no class. Label it, or remove it from the index."
            )

    machines = dict.fromkeys(recording.specimen or "" for recording in recordings)
    pumps = []
    for machine in machines:
        members = [recording for recording in recordings if (recording.specimen or "") == machine]
        pumps.append(_measure_pump(machine, members, pump, fault_of or {}))
        if progress is not None:
            progress(len(pumps), len(machines))
    return ChangeLibrary(tuple(pumps))


def _measure_pump(
    machine: str, recordings: Sequence[Recording], pump: Pump, fault_of: Mapping[str, str]
) -> LibraryPump:
    healthy = [recording for recording in recordings if is_healthy(str(recording.label))]
    faulty = [recording for recording in recordings if not is_healthy(str(recording.label))]
    name = machine or "the machine"
    if not healthy or not faulty:
        missing = "fault" if healthy else "healthy recording"
        raise DataError(
            f"No {missing} of {name} was recorded; a library needs healthy recordings and faults "
            "of each machine."
        )

    reference = _make_reference(healthy[0], pump).with_healthy(healthy)
    is_measured = np.isfinite(reference.band_powers).all(axis=0)
    changes = [np.where(is_measured, change, np.nan) for change in reference.fault_changes(faulty)]
    return LibraryPump(
        name=name,
        nameplate=_nameplate_of(pump),
        channels=reference.channels,
        spectrum=reference.band_powers.mean(axis=0),
        healthy=np.where(is_measured, reference.healthy_changes(), np.nan),
        change=np.stack(changes),
        label=tuple(_fault_class(member, fault_of) for member in faulty),
        severity=tuple(member.attributes.get("severity", "") for member in faulty),
        manifest=build_manifest(recordings),
    )


def _make_reference(first: Recording, pump: Pump) -> PriorClassifier:
    """Return a prior without virtual pumps, which only compares recordings with healthy ones."""
    bands = OrderBands(pump.rotating_group.piston_count)
    return PriorClassifier(
        pump=pump.name,
        bands=bands,
        channels=first.channels,
        classes=CLASSES,
        speed=_ANY_VALUE,
        pressure=_ANY_VALUE,
        n_pumps=0,
        band_powers=np.empty((0, len(first.channels), len(bands.names))),
        unit=first.unit,
    )


def _nameplate_of(pump: Pump) -> Nameplate:
    if pump.rated is None:
        raise InputError(
            f"{pump.name} states no rated speed and pressure. Add a table [rated] with speed and "
            "discharge_pressure to the pump file."
        )
    return Nameplate(
        displacement=pump.rotating_group.displacement,
        piston_count=pump.rotating_group.piston_count,
        speed=pump.rated.speed,
        discharge_pressure=pump.rated.discharge_pressure,
    )


def _fault_class(recording: Recording, fault_of: Mapping[str, str]) -> str:
    """Return the class of a fault; its label if it is not one of `CLASSES`.

    A prior that does not know this class leaves it out.
    """
    label = str(recording.label)
    try:
        return canonical_label(fault_of.get(label, label), CLASSES)
    except InputError:
        return label
