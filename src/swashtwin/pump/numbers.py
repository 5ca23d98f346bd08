"""Every number of a pump by its path, such as ``masses.shell``."""

from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
from typing import Any, NamedTuple

from swashtwin.pump.parameters import Pump


class PumpNumber(NamedTuple):
    """A number of a pump, or the numbers of a list."""

    path: str
    """Sections and name, such as ``interfaces.block_valve.damping`` or ``sensors[0].position``."""
    value: Any
    """In SI units."""
    unit: str
    """SI unit."""


def pump_numbers(pump: Pump) -> Iterator[PumpNumber]:
    """Every number of a pump, in the order of its file."""
    for section in fields(pump):
        part = getattr(pump, section.name)
        if is_dataclass(part):
            yield from _numbers(part, section.name)
    for index, sensor in enumerate(pump.sensors):
        yield PumpNumber(f"sensors[{index}].position", sensor.position, "m")


def _numbers(part: Any, path: str) -> Iterator[PumpNumber]:
    for item in fields(part):
        value = getattr(part, item.name)
        if is_dataclass(value):
            yield from _numbers(value, f"{path}.{item.name}")
        else:
            yield PumpNumber(f"{path}.{item.name}", value, str(item.metadata["unit"]))


def with_number(pump: Pump, path: str, value: Any) -> Pump:
    """The pump with another value of the number at `path`.

    Raises
    ------
    InputError
        The part cannot be so.
    """
    if path.startswith("sensors["):
        index = int(path.removeprefix("sensors[").partition("]")[0])
        sensors = list(pump.sensors)
        sensors[index] = replace(sensors[index], position=value)
        return replace(pump, sensors=tuple(sensors))
    return _replaced(pump, path.split("."), value)


def _replaced(part: Any, names: list[str], value: Any) -> Any:
    name, *rest = names
    return replace(part, **{name: _replaced(getattr(part, name), rest, value) if rest else value})
