"""States, numbers and times as the pages show them."""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from types import MappingProxyType
from typing import NamedTuple

from swashtwin.monitoring.history.reading import MachineOverview
from swashtwin.monitoring.history.tables import Alarm

RECORDING_STATES: Mapping[str, str] = MappingProxyType(
    {"learning": "Learning", "normal": "Normal", "unusual": "Unusual", "alarm": "Alarm", "sensor": "Sensor alarm"}
)
"""What each state of a recording is called."""

REJECTION_REASONS: Mapping[str, str] = MappingProxyType(
    {
        "machine": "unknown machine",
        "double": "came twice",
        "late": "late",
        "broken": "cannot be read as configured",
        "unfit": "unfit to be judged",
        "points": "too many operating points",
        "error": "error of the watch",
    }
)
"""Why a recording was not judged."""

VERDICT_NAMES: Mapping[str, tuple[str, str]] = MappingProxyType(
    {
        "capital": ("Evidence against luck", ""),
        "alarm_p": ("Chance from the healthy machine", ""),
        "probability": ("Probability of the verdict", ""),
        "confidence": ("Confidence of the verdict", ""),
        "ood_p": ("Chance among recordings of the training", ""),
        "speed": ("Speed", "rad/s"),
        "pressure": ("Discharge pressure", "Pa"),
    }
)
"""Name and unit of what is stored of each recording beside its levels."""

_FREQUENCY = re.compile(r" \([^()]* Hz\)$")
_GROUPS = ("Orders", "Orders of the envelope", "Bands", "Bands of the envelope", "Verdict and conditions")


def number(value: float | None, digits: int = 3) -> str:
    """So many significant digits, ``—`` for None and what is not finite.

    Examples
    --------
    >>> number(0.01234), number(123456.0), number(None)
    ('0.0123', '1.23e+05', '—')
    """
    if value is None or not math.isfinite(value):
        return "—"
    if value != 0 and not 1e-3 <= abs(value) < 1e5:
        return f"{value:.{digits - 1}e}"
    magnitude = 0 if value == 0 else math.floor(math.log10(abs(value)))
    return f"{value:.{max(0, digits - 1 - magnitude)}f}"


def percent(share: float | None) -> str:
    """A share in percent, never rounded up to all or down to nothing."""
    if share is None or not math.isfinite(share):
        return "—"
    if share > 0.995 and share < 1:
        return "> 99 %"
    return "< 1 %" if 0 < share < 0.005 else f"{100 * share:.0f} %"


def signed(value: float) -> str:
    """A change with its sign and one decimal."""
    return f"{value:+.1f}".replace("-", "−")


def moment_text(time: datetime | None) -> str:
    """A time to the second in UTC; the browser shows it in its own zone."""
    return "—" if time is None else time.astimezone(UTC).strftime("%Y-%m-%d %H:%M:%S UTC")


def ago(time: datetime, now: datetime) -> str:
    """How long ago a time was, in its largest unit."""
    seconds = max(0.0, (now - time).total_seconds())
    for length, unit in ((86400, "d"), (3600, "h"), (60, "min")):
        if seconds >= length:
            return f"{int(seconds // length)} {unit} ago"
    return "just now"


def label_words(label: str | None) -> str:
    """A class as a reader should see it: ``Swash plate``; ``—`` for none."""
    return "—" if label is None else label.replace("_", " ").capitalize()


def stored_name(level: str) -> str:
    """Name under which the history keeps a level: a level that moved also says where its order is.

    Examples
    --------
    >>> stored_name("shaft order 9 of the envelope (129 Hz)")
    'shaft order 9 of the envelope'
    """
    return _FREQUENCY.sub("", level)


def grouped_levels(names: Iterable[str]) -> Sequence[tuple[str, Sequence[str]]]:
    """Names of levels by kind, orders first, in their own order."""
    groups: dict[str, list[str]] = {group: [] for group in _GROUPS}
    for name in names:
        is_envelope = "envelope" in name
        kind = 4 if name in VERDICT_NAMES else is_envelope if "order" in name else 2 + is_envelope
        groups[_GROUPS[kind]].append(name)
    return [(group, members) for group, members in groups.items() if members]


class MachineState(NamedTuple):
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
    waiting = {alarm.kind for alarm in machine.alarms if alarm.state == "open"}
    if waiting:
        code = "alarm" if "pump" in waiting else "sensor"
    elif machine.alarms:
        code = "acknowledged"
    elif last is None:
        code = "empty"
    elif machine.maintained is not None and machine.maintained > last.received:
        code = "learning"  # the recording tells of the machine before the maintenance
    else:
        code = last.state if last.state in ("normal", "learning") else "unusual"
    return _BY_CODE[code]


def by_urgency(machine: MachineOverview) -> tuple[int, str]:
    """Key that sorts the most urgent machines first, then by name."""
    return STATES.index(state_of(machine)), machine.name


def alarm_state(alarm: Alarm) -> MachineState:
    """The state of one alarm."""
    if alarm.state == "acknowledged":
        return MachineState("acknowledged", "acknowledged", "△")
    return MachineState("open", "open", "▲") if alarm.state == "open" else MachineState("closed", "closed", "✓")
