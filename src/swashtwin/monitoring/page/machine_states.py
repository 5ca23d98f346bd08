"""The state of a machine as one word, most urgent first."""

from collections.abc import Sequence
from dataclasses import dataclass

from swashtwin.monitoring.history.reading import MachineOverview
from swashtwin.monitoring.history.tables import Alarm


@dataclass(frozen=True)
class MachineState:
    """One state."""

    code: str
    """Name in addresses, style and the interface for programs."""
    word: str
    """English word on the page."""
    symbol: str
    """Sign that says the same without color."""


STATES = (
    MachineState("alarm", "Alarm", "▲"),
    MachineState("sensor", "Sensor alarm", "◆"),
    MachineState("acknowledged", "Alarm acknowledged", "△"),
    MachineState("unusual", "Unusual", "●"),
    MachineState("normal", "Normal", "✓"),
    MachineState("learning", "Learning", "…"),
    MachineState("empty", "No recording yet", "–"),
)
"""States of a machine, most urgent first."""

_BY_CODE = {state.code: state for state in STATES}


def state_of(machine: MachineOverview) -> MachineState:
    """The most urgent state of a machine."""
    last = machine.last
    if last is not None and machine.maintained is not None and machine.maintained > last.received:
        return _BY_CODE[_code(machine.alarms, "learning")]  # it tells of the machine before the maintenance
    return _BY_CODE[_code(machine.alarms, None if last is None else last.state)]


def _code(alarms: Sequence[Alarm], last: str | None) -> str:
    waiting = [alarm for alarm in alarms if alarm.state == "open"]
    if any(alarm.kind == "pump" for alarm in waiting):
        return "alarm"
    if waiting:
        return "sensor"
    if alarms:
        return "acknowledged"
    if last is None:
        return "empty"
    return last if last in ("normal", "learning") else "unusual"


def by_urgency(machine: MachineOverview) -> tuple[int, str]:
    """Key that sorts the most urgent machines first, then by name."""
    return STATES.index(state_of(machine)), machine.name


def alarm_state(alarm: Alarm) -> MachineState:
    """The state of one alarm."""
    if alarm.state == "acknowledged":
        return MachineState("acknowledged", "acknowledged", "△")
    return MachineState("open", "open", "▲") if alarm.state == "open" else MachineState("closed", "closed", "✓")
