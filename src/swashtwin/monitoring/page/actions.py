"""What visitors do: log in and out, acknowledge, silence, add an event, by forms of the page or by
programs; and recordings that are sent.
"""

from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from typing import Annotated

from fastapi import APIRouter, Depends, Form, HTTPException, Query, Request
from starlette.responses import HTMLResponse, RedirectResponse, Response

from swashtwin.foundation import InputError
from swashtwin.monitoring.history.history import record_event
from swashtwin.monitoring.page.sessions import COOKIE
from swashtwin.monitoring.page.site import Site, local_path, visitor_name

MOST_HOURS = 24 * 366
"""Longest silence [h]."""
Text = Annotated[str, Form(max_length=500)]
Name = Annotated[
    str,
    Form(max_length=64, description="who acts; where there are logins, the one who is logged in"),
]
Address = Annotated[str, Form(alias="next", max_length=2000, include_in_schema=False)]


def change_routes(site: Site, *, is_page: bool) -> APIRouter:
    """Addresses of what may be changed.

    Parameters
    ----------
    is_page : for the page's forms, which carry the token of their visit and lead back; else for
        programs, below /api.
    """
    require = (
        [Depends(_require_form_token(site)), Depends(_require_control)]
        if is_page
        else [Depends(_require_program)]
    )
    routes = APIRouter(
        prefix="" if is_page else "/api", include_in_schema=not is_page, dependencies=require
    )

    def done(target: str) -> Response:
        return RedirectResponse(local_path(target), 303) if is_page else Response(status_code=204)

    @routes.post("/alarms/{identity}/acknowledge", tags=["alarms"], status_code=204)
    def acknowledge(
        request: Request, identity: int, note: Text = "", who: Name = "", target: Address = "/"
    ) -> Response:
        """Acknowledge an alarm; 409 where it is not open."""
        try:
            with site.history.machine(site.alarm(identity).machine) as machine:
                machine.acknowledge(identity, visitor_name(request, who), note)
        except InputError as error:
            raise HTTPException(409, str(error)) from None
        return done(target)

    @routes.post("/machines/{name}/silence", tags=["machines"], status_code=204)
    def silence(
        request: Request,
        name: str,
        hours: Annotated[float, Form(gt=0, le=MOST_HOURS)],
        note: Text = "",
        who: Name = "",
        target: Address = "/",
    ) -> Response:
        """Send no messages for some hours; alarms are raised and kept all the same."""
        site.machine(name)
        with site.history.machine(name) as machine:
            machine.silence(
                datetime.now(UTC) + timedelta(hours=hours), visitor_name(request, who), note
            )
        return done(target)

    @routes.post("/machines/{name}/silence/end", tags=["machines"], status_code=204)
    def end_silence(name: str, target: Address = "/") -> Response:
        """Send messages again."""
        site.machine(name)
        with site.history.machine(name) as machine:
            machine.end_silence()
        return done(target)

    @routes.post("/machines/{name}/events", tags=["machines"], status_code=204)
    def add_event(
        request: Request,
        name: str,
        kind: Annotated[str, Form(pattern="^(note|maintenance)$")] = "note",
        note: Text = "",
        found: Annotated[
            str, Form(max_length=500, description="what was wrong, for the newest alarm")
        ] = "",
        who: Name = "",
        target: Address = "/",
    ) -> Response:
        """Add an event; after `maintenance` the healthy baseline is learned anew, and alarms are
        closed.
        """
        site.machine(name)
        by = visitor_name(request, who)
        try:
            is_repair = kind == "maintenance"
            record_event(
                site.config,
                site.history,
                name,
                who=by,
                note=note,
                found=found,
                maintenance=is_repair,
            )
        except InputError as error:
            raise HTTPException(422, str(error)) from None
        return done(target)

    return routes


def visit_routes(site: Site) -> APIRouter:
    """Addresses to log in and out."""
    routes = APIRouter(include_in_schema=False)
    checked = [Depends(_require_form_token(site))]

    @routes.get("/login")
    def login_page(
        request: Request, target: Annotated[str, Query(alias="next")] = "/"
    ) -> HTMLResponse:
        return site.render(request, "login.html.jinja", target=local_path(target), message="")

    @routes.post("/login", dependencies=checked)
    def login(
        request: Request,
        name: Name,
        password: Annotated[str, Form(max_length=1000)],
        target: Address = "/",
    ) -> Response:
        session = site.access.login(request, name, password)
        if isinstance(session, str):
            answer = RedirectResponse(local_path(target), 303)
            site.access.set_cookie(answer, session)
            return answer
        message = (
            f"Too many attempts. Wait {session} s."
            if session
            else "The name or the password is wrong."
        )
        code = 429 if session else 403
        refusal = site.render(
            request, "login.html.jinja", code, target=local_path(target), message=message
        )
        if session:
            refusal.headers["retry-after"] = str(session)
        return refusal

    @routes.post("/logout", dependencies=checked)
    def logout(request: Request) -> Response:
        site.access.logout(request)
        answer = RedirectResponse("/", 303)
        answer.delete_cookie(COOKIE)
        return answer

    return routes


def _require_form_token(site: Site) -> Callable[[Request, str], None]:
    def require(request: Request, form_token: Annotated[str, Form(max_length=200)] = "") -> None:
        if not site.access.is_form_token(request, form_token):
            raise HTTPException(403, "The form is too old. Load the page again and send it again.")

    return require


def _require_control(request: Request) -> None:
    if request.state.visitor.kind == "token":
        raise HTTPException(
            403, "This token may read and upload only; make another with --control."
        )


def _require_program(request: Request) -> None:
    """Changes need a token where there are logins: a browser's cookie alone could be sent by
    somebody's form.
    """
    _require_control(request)
    if request.state.visitor.kind == "person":
        raise HTTPException(
            403, "Send a token: Authorization: Bearer TOKEN. The pages' forms need none."
        )
