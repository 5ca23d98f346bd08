"""What all addresses of the page share: configuration, history, who may ask, and how a template becomes an answer."""

import secrets
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any, TypeAlias, TypeVar
from urllib.parse import quote, urlencode

from fastapi import HTTPException
from jinja2 import Environment, PackageLoader, StrictUndefined
from starlette.requests import Request
from starlette.responses import HTMLResponse

from swashtwin.foundation import VERSION
from swashtwin.monitoring.config.settings import WatchConfig
from swashtwin.monitoring.history.history import History
from swashtwin.monitoring.history.reading import MachineOverview
from swashtwin.monitoring.history.tables import Alarm, Judgment
from swashtwin.monitoring.page import wording
from swashtwin.monitoring.page.access import COOKIE, Access, Visitor
from swashtwin.monitoring.service.running import WatchStatus

Found = TypeVar("Found")
Upload: TypeAlias = Callable[[Path, str, str | None, Mapping[str, str]], str]
"""Takes a file, its name, its machine and its facts; returns its id once it cannot be lost (`Watch.upload`)."""


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
    clock: Callable[[], datetime] = field(default=lambda: datetime.now(UTC))
    """Time of day."""

    def render(self, request: Request, template: str, code: int = 200, **values: Any) -> HTMLResponse:
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
                now=self.clock(),
                **values,
            )
        )
        answer = HTMLResponse(text, code)
        if COOKIE not in request.cookies:
            self.access.set_cookie(answer, visit)
        return answer

    def machines(self) -> Sequence[MachineOverview]:
        """Machines of the history, and those of the configuration that sent nothing yet."""
        stored = self.history.read.machines()
        new = {machine.name for machine in self.config.machines} - {machine.name for machine in stored}
        return [*stored, *(MachineOverview(name) for name in sorted(new))]

    def machine(self, name: str) -> MachineOverview:
        """A machine by its name; 404 where there is none."""
        machines = {machine.name: machine for machine in self.machines()}
        return _found(machines.get(name), f"machine {name[:100]}")

    def recording(self, number: int) -> Judgment:
        """A stored recording by its number; 404 where there is none."""
        stored = self.history.read.recording(number) if 0 < number < 2**31 else None
        return _found(stored, f"recording {number}")

    def alarm(self, number: int) -> Alarm:
        """An alarm by its number; 404 where there is none."""
        return _found(self.history.read.alarm(number) if 0 < number < 2**31 else None, f"alarm {number}")

    @property
    def alarm_capital(self) -> float:
        """Evidence at which an alarm is raised."""
        return 1 / self.config.alarms.false_alarm_rate


def _found(thing: Found | None, name: str) -> Found:
    if thing is None:
        raise HTTPException(404, f"There is no {name}.")
    return thing


_WORDS = ("ago", "alarm_state", "label_words", "moment_text", "number", "percent", "signed", "stored_name")
"""Functions that write values in templates."""


@cache
def _templates() -> Environment:
    """The pages' templates; what they are given is escaped."""
    environment = Environment(
        loader=PackageLoader("swashtwin.monitoring.page"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["segment"] = lambda text: quote(str(text), safe="")
    environment.globals.update(
        version=VERSION,
        query=urlencode,
        recording_states=wording.RECORDING_STATES,
        rejection_reasons=wording.REJECTION_REASONS,
        **{name: getattr(wording, name) for name in _WORDS},
    )
    return environment


def visitor_name(request: Request, stated: str = "") -> str:
    """Who acts: the person or program that is logged in; where there are no logins, the name stated in the form."""
    visitor: Visitor = request.state.visitor
    return visitor.name if visitor.kind != "local" else stated.strip()[:64] or "local"


def local_path(address: str) -> str:
    """`address` if it is a path of this page, else the start page: no form sends a visitor elsewhere."""
    is_local = address.startswith("/") and not address.startswith(("//", "/\\")) and address.isprintable()
    return address if is_local and len(address) < 2000 else "/"
