"""What all addresses of the page share: configuration, history, who may ask, how a template becomes
an answer, and how states, numbers and times are written.
"""

import math
import re
import secrets
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, TypeAlias, TypeVar
from urllib.parse import quote, urlencode

from fastapi import HTTPException
from jinja2 import Environment, PackageLoader, StrictUndefined
from starlette.requests import Request
from starlette.responses import HTMLResponse

from swashtwin.foundation import VERSION
from swashtwin.monitoring.config.settings import WatchConfig
from swashtwin.monitoring.history.history import History
from swashtwin.monitoring.history.reading import MachineOverview
from swashtwin.monitoring.history.schema import Alarm, Judgment
from swashtwin.monitoring.page.sessions import COOKIE, Access, Visitor
from swashtwin.monitoring.status import WatchStatus

RECORDING_STATES: Mapping[str, str] = MappingProxyType(
    {
        "learning": "Learning",
        "normal": "Normal",
        "unusual": "Unusual",
        "alarm": "Alarm",
        "sensor": "Sensor alarm",
    }
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
_GROUPS = (
    "Orders",
    "Orders of the envelope",
    "Bands",
    "Bands of the envelope",
    "Verdict and conditions",
)


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


def alarm_state(alarm: Alarm) -> MachineState:
    """The state of one alarm."""
    if alarm.state == "acknowledged":
        return MachineState("acknowledged", "acknowledged", "△")
    return (
        MachineState("open", "open", "▲")
        if alarm.state == "open"
        else MachineState("closed", "closed", "✓")
    )


Found = TypeVar("Found")
Upload: TypeAlias = Callable[[Path, str, str | None, Mapping[str, str]], str]
"""Takes a file, its name, its machine and its facts; returns its id once it cannot be lost
(`Watch.upload`).
"""


@dataclass
class Site:
    """One page of one watch."""

    config: WatchConfig
    """Machines and settings of the page."""
    history: History
    """What the page shows."""
    access: Access
    """Who may use it."""
    upload: Upload | None = None
    """Where recordings that are sent by HTTP go; None where there is no such source."""
    status: Callable[[], WatchStatus] | None = None
    """How the watch is doing; None where the page runs without one."""

    def render(
        self, request: Request, template: str, code: int = 200, **values: Any
    ) -> HTMLResponse:
        """The page that `template` makes of `values`; its forms carry the visit's token."""
        visit = request.cookies.get(COOKIE) or secrets.token_urlsafe(32)
        visitor: Visitor | None = request.state.visitor
        text = (
            _templates()
            .get_template(template)
            .render(
                visitor=visitor,
                form_token=self.access.form_token(visit),
                here=request.url.path + (f"?{request.url.query}" if request.url.query else ""),
                now=datetime.now(UTC),
                **values,
            )
        )
        answer = HTMLResponse(text, code)
        if COOKIE not in request.cookies:
            self.access.set_cookie(answer, visit)
        return answer

    def machines(self) -> Sequence[MachineOverview]:
        """Machines of the history, and those of the configuration that sent nothing yet."""
        stored = self.history.reader.machines()
        new = {machine.name for machine in self.config.machines} - {
            machine.name for machine in stored
        }
        return [*stored, *(MachineOverview(name) for name in sorted(new))]

    def machine(self, name: str) -> MachineOverview:
        """A machine by its name; 404 where there is none."""
        machines = {machine.name: machine for machine in self.machines()}
        return _found(machines.get(name), f"machine {name[:100]}")

    def recording(self, number: int) -> Judgment:
        """A stored recording by its number; 404 where there is none."""
        stored = self.history.reader.recording(number) if 0 < number < 2**31 else None
        return _found(stored, f"recording {number}")

    def alarm(self, number: int) -> Alarm:
        """An alarm by its number; 404 where there is none."""
        return _found(
            self.history.reader.alarm(number) if 0 < number < 2**31 else None, f"alarm {number}"
        )

    @property
    def alarm_capital(self) -> float:
        """Evidence at which an alarm is raised."""
        return 1 / self.config.alarms.false_alarm_rate


def _found(thing: Found | None, name: str) -> Found:
    if thing is None:
        raise HTTPException(404, f"There is no {name}.")
    return thing


@cache
def _templates() -> Environment:
    environment = Environment(
        loader=PackageLoader("swashtwin.monitoring.page"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["segment"] = lambda text: quote(str(text), safe="")
    words = (ago, alarm_state, label_words, moment_text, number, percent, signed, stored_name)
    environment.globals.update(
        version=VERSION,
        query=urlencode,
        recording_states=RECORDING_STATES,
        rejection_reasons=REJECTION_REASONS,
        **{word.__name__: word for word in words},
    )
    return environment


def visitor_name(request: Request, stated: str = "") -> str:
    """Who acts: the person or program that is logged in; where there are no logins, the name stated
    in the form.
    """
    visitor: Visitor = request.state.visitor
    return visitor.name if visitor.kind != "local" else stated.strip()[:64] or "local"


def local_path(address: str) -> str:
    """`address` if it is a path of this page, else the start page: no form sends a visitor
    elsewhere.
    """
    is_local = (
        address.startswith("/") and not address.startswith(("//", "/\\")) and address.isprintable()
    )
    return address if is_local and len(address) < 2000 else "/"
