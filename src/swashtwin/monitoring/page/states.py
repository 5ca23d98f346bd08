"""States of machines, alarms and recordings, and their names on the pages."""

from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

from swashtwin.monitoring.history.reading import MachineOverview
from swashtwin.monitoring.history.schema import Alarm

RECORDING_STATES: Mapping[str, str] = MappingProxyType(
    {
        "learning": "Learning",
        "normal": "Normal",
        "unusual": "Unusual",
        "alarm": "Alarm",
        "sensor": "Sensor alarm",
    }
)
"""Name of each state of a recording."""

VERDICT_NAMES: Mapping[str, str] = MappingProxyType(
    {
        "score": "Deviation",
        "capital": "Evidence",
        "alarm_p": "p-value of the healthy baseline",
        "probability": "Probability of the verdict",
        "confidence": "Agreement of the windows",
        "ood_p": "p-value of the training recordings",
        "speed": "Speed",
        "pressure": "Discharge pressure",
    }
)
"""Name of what is stored of each recording besides its indicators."""

VERDICT_GROUP = "Verdict and operating point"
INDICATOR_GROUPS = (
    "Orders",
    "Orders of the envelope",
    "Bands",
    "Bands of the envelope",
    VERDICT_GROUP,
)
"""Groups of indicators, in the order of the page."""


class MachineState(NamedTuple):
    """One state, of a machine or of an alarm."""

    code: str
    """Name in addresses, style sheets and the interface for programs."""
    label: str
    """Name on the pages."""
    symbol: str
    """Symbol that shows the state without color."""


STATES = (
    MachineState("alarm", "Alarm", "▲"),
    MachineState("sensor", "Sensor alarm", "◆"),
    MachineState("delivery", "Deliveries not usable", "■"),
    MachineState("acknowledged", "Alarm acknowledged", "△"),
    MachineState("unusual", "Unusual", "●"),
    MachineState("normal", "Normal", "✓"),
    MachineState("learning", "Learning", "…"),
    MachineState("empty", "No recording yet", "–"),
)
"""States of a machine, most urgent first."""

_STATES_BY_CODE = {state.code: state for state in STATES}
_ALARM_STATES = {
    "open": MachineState("open", "open", "▲"),
    "acknowledged": MachineState("acknowledged", "acknowledged", "△"),
    "closed": MachineState("closed", "closed", "✓"),
}


def state_of(machine: MachineOverview) -> MachineState:
    """Return the most urgent state of a machine."""
    return _STATES_BY_CODE[_state_code(machine)]


def _state_code(machine: MachineOverview) -> str:
    # An alarm that nobody has acknowledged comes before everything else.
    open_kinds = {alarm.kind for alarm in machine.alarms if alarm.state == "open"}
    if "pump" in open_kinds:
        return "alarm"
    if "sensor" in open_kinds:
        return "sensor"
    if open_kinds:
        return "delivery"
    if machine.alarms:
        return "acknowledged"

    newest = machine.last
    if newest is None:
        return "empty"
    # A recording from before the maintenance no longer describes the machine.
    if machine.maintained is not None and machine.maintained > newest.received:
        return "learning"
    if newest.state in ("normal", "learning"):
        return newest.state
    return "unusual"


def alarm_state(alarm: Alarm) -> MachineState:
    """Return the state of an alarm."""
    return _ALARM_STATES[alarm.state]


def group_indicators(names: Iterable[str]) -> Sequence[tuple[str, Sequence[str]]]:
    """Return the names of indicators by group, orders first; the order within a group is kept."""
    groups: dict[str, list[str]] = {group: [] for group in INDICATOR_GROUPS}
    for name in names:
        groups[_group_of(name)].append(name)
    return [(group, members) for group, members in groups.items() if members]


def _group_of(name: str) -> str:
    if name in VERDICT_NAMES:
        return VERDICT_GROUP

    group = "Bands"
    if "order" in name:
        group = "Orders"
    if "envelope" in name:
        group += " of the envelope"
    return group
