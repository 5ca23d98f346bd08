"""Twins as plain dictionaries, and back."""

from dataclasses import asdict, fields
from typing import Any

from swashtwin.foundation import ArtifactError
from swashtwin.physics import Scales, SensorPath, Twin
from swashtwin.pump import SECTIONS, Bearings, Fault, Interfaces, OperatingCondition, Pump, Sensor, fault_type


def twin_to_dict(twin: Twin) -> dict[str, Any]:
    """Everything that makes the twin, the pump included, as JSON can hold it."""
    pump = twin.pump
    return {
        "pump": {
            "name": pump.name,
            **{name: asdict(getattr(pump, name)) for name in SECTIONS},
            "interfaces": list(pump.interfaces.values()),
            "sensors": [asdict(sensor) for sensor in pump.sensors],
            "sources": dict(pump.sources),
        },
        "condition": asdict(twin.condition),
        "fault": None if twin.fault is None else {"kind": type(twin.fault).__name__, **asdict(twin.fault)},
        "interfaces": None if twin.interfaces is None else list(twin.interfaces.values()),
        "topology": twin.topology,
        "bandwidth": twin.bandwidth,
        "scales": asdict(twin.scales),
        "path": None if twin.path is None else asdict(twin.path),
    }


def twin_from_dict(table: dict[str, Any]) -> Twin:
    """Twin that `twin_to_dict` wrote.

    Raises
    ------
    ArtifactError
        Something is missing or of another form.
    """
    try:
        return Twin(
            pump=_pump(table["pump"]),
            condition=OperatingCondition(**table["condition"]),
            fault=_fault(table["fault"]),
            interfaces=None if table["interfaces"] is None else Interfaces.from_values(table["interfaces"]),
            topology=table["topology"],
            bandwidth=table["bandwidth"],
            scales=Scales(**table["scales"]),
            path=None if table["path"] is None else _path(table["path"]),
        )
    except (KeyError, TypeError, ValueError) as cause:
        raise ArtifactError(f"a saved twin is damaged or of another version: {cause}.") from cause


def _pump(table: dict[str, Any]) -> Pump:
    sections = {name: kind(**_with_tuples(kind, table[name])) for name, kind in SECTIONS.items()}
    return Pump(
        name=table["name"],
        interfaces=Interfaces.from_values(table["interfaces"]),
        sensors=tuple(Sensor(**_with_tuples(Sensor, sensor)) for sensor in table["sensors"]),
        sources=dict(table["sources"]),
        **sections,
    )


def _with_tuples(kind: type, table: dict[str, Any]) -> dict[str, Any]:
    """JSON knows lists only; bearings and sensors hold tuples."""
    if kind not in (Bearings, Sensor):
        return table
    return {name: tuple(value) if isinstance(value, list) else value for name, value in table.items()}


def _path(table: dict[str, Any]) -> SensorPath:
    residue = tuple(tuple(row) for row in table["residue"])
    cross_talk = tuple(tuple(row) for row in table["cross_talk"])
    rows = {name: tuple(table[name]) for name in ("gain", "frequency", "damping_ratio")}
    return SensorPath(**rows, residue=residue, cross_talk=cross_talk)


def _fault(table: dict[str, Any] | None) -> Fault | None:
    if table is None:
        return None
    kind = fault_type(table["kind"])
    return kind(**{item.name: table[item.name] for item in fields(kind)})
