"""What visitors change: log in and out, acknowledge, silence, add events.

The same routes serve the forms of the pages and programs.
"""

from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from typing import Annotated

from fastapi import APIRouter, Depends, Form, HTTPException, Query, Request
from starlette.responses import HTMLResponse, RedirectResponse, Response

from swashtwin.foundation import InputError
from swashtwin.monitoring.history.history import record_event
from swashtwin.monitoring.page.sessions import COOKIE
from swashtwin.monitoring.page.site import Site, acting_name, local_path

MAX_SILENCE_HOURS = 24 * 366
"""Longest silence: a leap year."""

Text = Annotated[str, Form(max_length=500)]
Name = Annotated[
    str,
    Form(
        max_length=64,
        description="who acts; ignored if there are logins, which then name the visitor",
    ),
]
Target = Annotated[str, Form(alias="next", max_length=2000, include_in_schema=False)]


def change_routes(site: Site, *, is_page: bool) -> APIRouter:
    """Return the addresses that change something.

    Parameters
    ----------
    is_page : whether the routes serve the forms of the pages, which carry the token of their visit
        and lead back to a page; otherwise they serve programs, below /api.
    """
    if is_page:
        dependencies = [Depends(_require_form_token(site)), Depends(_require_control)]
        routes = APIRouter(include_in_schema=False, dependencies=dependencies)
    else:
        routes = APIRouter(prefix="/api", dependencies=[Depends(_require_program)])

    def answer(target: str) -> Response:
        if is_page:
            return RedirectResponse(local_path(target), 303)
        return Response(status_code=204)

    @routes.post("/alarms/{identity}/acknowledge", tags=["alarms"], status_code=204)
    def acknowledge(
        request: Request, identity: int, note: Text = "", who: Name = "", target: Target = "/"
    ) -> Response:
        """Acknowledge an alarm; 409 if it is not open."""
        alarm = site.alarm(identity)
        try:
            with site.history.machine(alarm.machine) as machine:
                machine.acknowledge(identity, acting_name(request, who), note)
        except InputError as error:
            raise HTTPException(409, str(error)) from None
        return answer(target)

    @routes.post("/machines/{name}/silence", tags=["machines"], status_code=204)
    def silence(
        request: Request,
        name: str,
        hours: Annotated[float, Form(gt=0, le=MAX_SILENCE_HOURS)],
        note: Text = "",
        who: Name = "",
        target: Target = "/",
    ) -> Response:
        """Send no messages for some hours; alarms are still raised and stored."""
        site.machine(name)
        end = datetime.now(UTC) + timedelta(hours=hours)
        with site.history.machine(name) as machine:
            machine.silence(end, acting_name(request, who), note)
        return answer(target)

    @routes.post("/machines/{name}/silence/end", tags=["machines"], status_code=204)
    def end_silence(name: str, target: Target = "/") -> Response:
        """Send messages again."""
        site.machine(name)
        with site.history.machine(name) as machine:
            machine.end_silence()
        return answer(target)

    @routes.post("/machines/{name}/events", tags=["machines"], status_code=204)
    def add_event(
        request: Request,
        name: str,
        kind: Annotated[str, Form(pattern="^(note|maintenance)$")] = "note",
        note: Text = "",
        finding: Annotated[
            str, Form(max_length=500, description="what was wrong, for the newest alarm")
        ] = "",
        who: Name = "",
        target: Target = "/",
    ) -> Response:
        """Add an event; `maintenance` restarts the healthy baseline and closes alarms."""
        site.machine(name)
        try:
            record_event(
                site.config,
                site.history,
                name,
                who=acting_name(request, who),
                note=note,
                finding=finding,
                maintenance=kind == "maintenance",
            )
        except InputError as error:
            raise HTTPException(422, str(error)) from None
        return answer(target)

    return routes


def visit_routes(site: Site) -> APIRouter:
    """Return the addresses to log in and out."""
    routes = APIRouter(include_in_schema=False)
    dependencies = [Depends(_require_form_token(site))]

    @routes.get("/login")
    def login_page(
        request: Request, target: Annotated[str, Query(alias="next")] = "/"
    ) -> HTMLResponse:
        return site.render(request, "login.html.jinja", target=local_path(target), message="")

    @routes.post("/login", dependencies=dependencies)
    def login(
        request: Request,
        name: Name,
        password: Annotated[str, Form(max_length=1000)],
        target: Target = "/",
    ) -> Response:
        result = site.access.login(request, name, password)
        if isinstance(result, str):
            redirect = RedirectResponse(local_path(target), 303)
            site.access.set_cookie(redirect, result)
            return redirect

        wait_s = result
        code = 403
        message = "Wrong name or password."
        if wait_s:
            code = 429
            message = f"Too many attempts. Wait {wait_s} s."
        refusal = site.render(
            request,
            "login.html.jinja",
            code,
            target=local_path(target),
            message=message,
        )
        if wait_s:
            refusal.headers["retry-after"] = str(wait_s)
        return refusal

    @routes.post("/logout", dependencies=dependencies)
    def logout(request: Request) -> Response:
        site.access.logout(request)
        redirect = RedirectResponse("/", 303)
        redirect.delete_cookie(COOKIE)
        return redirect

    return routes


def _require_form_token(site: Site) -> Callable[[Request, str], None]:
    def require(request: Request, form_token: Annotated[str, Form(max_length=200)] = "") -> None:
        if not site.access.is_form_token(request, form_token):
            raise HTTPException(403, "The form has expired. Reload the page and send it again.")

    return require


def _require_control(request: Request) -> None:
    if request.state.visitor.kind == "token":
        raise HTTPException(
            403, "This token may only read and upload. Create a token with control rights."
        )


def _require_program(request: Request) -> None:
    """Require a token for changes if there are logins.

    A cookie alone does not prove that the person wants the change: a form of another site may
    have sent it.
    """
    _require_control(request)
    if request.state.visitor.kind == "person":
        raise HTTPException(
            403, "Send a token: Authorization: Bearer TOKEN. Only the pages' forms need none."
        )
