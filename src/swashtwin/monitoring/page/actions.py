"""What forms do: log in and out, acknowledge, silence, add an event."""

from collections.abc import Callable
from typing import Annotated

from fastapi import APIRouter, Depends, Form, HTTPException, Query, Request
from starlette.responses import HTMLResponse, RedirectResponse, Response

from swashtwin.monitoring.page.access import COOKIE
from swashtwin.monitoring.page.records import MOST_HOURS, acknowledge, add_event, end_silence, silence
from swashtwin.monitoring.page.site import Site, local_path, visitor_name

Text = Annotated[str, Form(max_length=500)]
Name = Annotated[str, Form(max_length=64)]
Address = Annotated[str, Form(alias="next", max_length=2000)]


def action_routes(site: Site) -> APIRouter:
    """Addresses to which forms about machines are sent; each form carries the token of its visit."""
    routes = APIRouter(
        include_in_schema=False, dependencies=[Depends(_require_form_token(site)), Depends(_require_control)]
    )

    @routes.post("/alarms/{identity}/acknowledge")
    def acknowledge_alarm(
        request: Request, identity: int, note: Text = "", who: Name = "", target: Address = "/"
    ) -> Response:
        acknowledge(site, identity, visitor_name(request, who), note)
        return _back(target)

    @routes.post("/machines/{name}/silence")
    def silence_machine(
        request: Request,
        name: str,
        hours: Annotated[float, Form(gt=0, le=MOST_HOURS)],
        note: Text = "",
        who: Name = "",
        target: Address = "/",
    ) -> Response:
        silence(site, name, hours, visitor_name(request, who), note)
        return _back(target)

    @routes.post("/machines/{name}/silence/end")
    def end_machine_silence(name: str, target: Address = "/") -> Response:
        end_silence(site, name)
        return _back(target)

    @routes.post("/machines/{name}/events")
    def add_machine_event(
        request: Request,
        name: str,
        kind: Annotated[str, Form(pattern="^(note|maintenance)$")],
        note: Text = "",
        who: Name = "",
        target: Address = "/",
    ) -> Response:
        add_event(site, name, kind, visitor_name(request, who), note)
        return _back(target)

    return routes


def visit_routes(site: Site) -> APIRouter:
    """Addresses to log in and out."""
    routes = APIRouter(include_in_schema=False)
    checked = [Depends(_require_form_token(site))]

    @routes.get("/login")
    def login_page(request: Request, target: Annotated[str, Query(alias="next")] = "/") -> HTMLResponse:
        return site.render(request, "login.html.jinja", target=local_path(target), message="")

    @routes.post("/login", dependencies=checked)
    def login(
        request: Request, name: Name, password: Annotated[str, Form(max_length=1000)], target: Address = "/"
    ) -> Response:
        session = site.access.login(request, name, password)
        if isinstance(session, str):
            answer = _back(target)
            site.access.set_cookie(answer, session)
            return answer
        message = f"Too many attempts. Wait {session} s." if session else "The name or the password is wrong."
        code = 429 if session else 403
        refusal = site.render(request, "login.html.jinja", code, target=local_path(target), message=message)
        if session:
            refusal.headers["retry-after"] = str(session)
        return refusal

    @routes.post("/logout", dependencies=checked)
    def logout(request: Request) -> Response:
        site.access.logout(request)
        answer = _back("/")
        answer.delete_cookie(COOKIE)
        return answer

    return routes


def _require_form_token(site: Site) -> Callable[[Request, str], None]:
    def require(request: Request, form_token: Annotated[str, Form(max_length=200)] = "") -> None:
        if not site.access.is_form_token(request, form_token):
            raise HTTPException(403, "The form is too old. Load the page again and send it again.")

    return require


def _back(target: str) -> Response:
    return RedirectResponse(local_path(target), 303)


def _require_control(request: Request) -> None:
    """Refuse a program whose token may read and upload only."""
    if request.state.visitor.kind == "token":
        raise HTTPException(403, "This token may read and upload only.")
