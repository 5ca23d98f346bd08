"""What all addresses of the page share: configuration, history, access and templates."""

import secrets
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cache, partial
from pathlib import Path
from typing import Any, TypeAlias, TypeVar
from urllib.parse import quote, urlencode

from fastapi import HTTPException
from jinja2 import Environment
from starlette.requests import Request
from starlette.responses import HTMLResponse

from swashtwin.foundation import VERSION, PressureUnit, convert_pressures, load_templates
from swashtwin.monitoring.config.settings import WatchConfig
from swashtwin.monitoring.history.history import History
from swashtwin.monitoring.history.reading import MachineOverview
from swashtwin.monitoring.history.schema import Alarm, Judgment
from swashtwin.monitoring.page import formatting
from swashtwin.monitoring.page.sessions import COOKIE, Access, Visitor
from swashtwin.monitoring.page.states import RECORDING_STATES, alarm_state
from swashtwin.monitoring.sources.delivery import REJECTION_REASONS
from swashtwin.monitoring.status import WatchStatus

MAX_ID = 2**31 - 1
"""Largest number of a row: what an integer column of PostgreSQL holds."""
_MAX_NAME_LENGTH = 64
_MAX_TARGET_LENGTH = 2000

Row = TypeVar("Row")
Upload: TypeAlias = Callable[[Path, str, str | None, Mapping[str, str]], str]
"""Takes a file, its name, its machine and its facts; returns the recording's id once the recording
cannot be lost (`Watch.upload`).
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
    """Takes recordings that are sent by HTTP; `None` if the watch has no such source."""
    status: Callable[[], WatchStatus] | None = None
    """Returns the status of the watch; `None` if the page runs without one."""

    def render(
        self, request: Request, template: str, code: int = 200, **values: Any
    ) -> HTMLResponse:
        """Return a page made from a template; its forms carry the token of the visit."""
        visit = request.cookies.get(COOKIE) or secrets.token_urlsafe(32)
        visitor: Visitor | None = request.state.visitor
        page_address = request.url.path
        if request.url.query:
            page_address += f"?{request.url.query}"
        html = (
            _templates(self.config.pressure_unit)
            .get_template(template)
            .render(
                visitor=visitor,
                form_token=self.access.form_token(visit),
                page_address=page_address,
                now=datetime.now(UTC),
                **values,
            )
        )

        response = HTMLResponse(html, code)
        if COOKIE not in request.cookies:
            self.access.set_cookie(response, visit)
        return response

    def machines(self) -> Sequence[MachineOverview]:
        """Return the machines of the history, and configured ones that sent nothing yet."""
        stored_machines = self.history.reader.machines()
        stored_names = {machine.name for machine in stored_machines}
        new_names = {machine.name for machine in self.config.machines} - stored_names
        return [*stored_machines, *(MachineOverview(name) for name in sorted(new_names))]

    def machine(self, name: str) -> MachineOverview:
        """Return a machine by its name, or answer 404."""
        machines = {machine.name: machine for machine in self.machines()}
        return _require(machines.get(name), f"machine {name[:100]}")

    def recording(self, number: int) -> Judgment:
        """Return a stored recording by its number, or answer 404."""
        judgment = None
        if 0 < number <= MAX_ID:
            judgment = self.history.reader.recording(number)
        return _require(judgment, f"recording {number}")

    def alarm(self, number: int) -> Alarm:
        """Return an alarm by its number, or answer 404."""
        alarm = None
        if 0 < number <= MAX_ID:
            alarm = self.history.reader.alarm(number)
        return _require(alarm, f"alarm {number}")

    @property
    def problems(self) -> Sequence[str]:
        """What keeps the watch from working; empty if the page runs without a watch."""
        if self.status is None:
            return ()
        return self.status().problems

    @property
    def alarm_capital(self) -> float:
        """Evidence at which an alarm is raised."""
        return 1 / self.config.alarms.false_alarm_rate


def _require(row: Row | None, name: str) -> Row:
    if row is None:
        raise HTTPException(404, f"There is no {name}.")
    return row


@cache
def _templates(pressure_unit: PressureUnit) -> Environment:
    environment = load_templates("swashtwin.monitoring.page")
    environment.filters["in_unit"] = partial(convert_pressures, unit=pressure_unit)
    environment.filters["segment"] = _quote_segment
    environment.globals.update(
        version=VERSION,
        query=urlencode,
        recording_states=RECORDING_STATES,
        rejection_reasons=REJECTION_REASONS,
        alarm_state=alarm_state,
        format_age=formatting.format_age,
        format_label=formatting.format_label,
        format_time=formatting.format_time,
        indicator_name=formatting.indicator_name,
        number=formatting.number,
        percent=formatting.percent,
        signed=formatting.signed,
        stored_time=formatting.stored_time,
    )
    return environment


def _quote_segment(text: object) -> str:
    """Return a text as one segment of an address; a slash in it does not start another."""
    return quote(str(text), safe="")


def acting_name(request: Request, entered_name: str = "") -> str:
    """Return the name of who acts.

    It is the person or program that is logged in, or, on a page without logins, the name that was
    entered in the form.
    """
    visitor: Visitor = request.state.visitor
    if visitor.kind != "local":
        return visitor.name
    return entered_name.strip()[:_MAX_NAME_LENGTH] or "local"


def local_path(address: str) -> str:
    """Return an address if it is a path of this page, else the start page.

    No form can therefore send a visitor to another site. Browsers read ``//`` and ``/\\`` as the
    start of another host.
    """
    is_path = address.startswith("/") and not address.startswith(("//", "/\\"))
    is_short = len(address) < _MAX_TARGET_LENGTH
    if is_path and is_short and address.isprintable():
        return address
    return "/"
