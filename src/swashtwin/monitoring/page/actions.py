"""What visitors do: log in and out, acknowledge, silence, add an event, by forms of the page or by
programs; and recordings that are sent.
"""

import asyncio
import contextlib
import secrets
import shutil
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Annotated

from fastapi import APIRouter, Depends, Form, HTTPException, Query, Request
from starlette.datastructures import UploadFile
from starlette.formparsers import MultiPartException
from starlette.requests import ClientDisconnect
from starlette.responses import HTMLResponse, RedirectResponse, Response

from swashtwin.foundation import InputError, SwashTwinError
from swashtwin.monitoring.history.history import record_event
from swashtwin.monitoring.page.access import COOKIE
from swashtwin.monitoring.page.server import UPLOAD_PATH
from swashtwin.monitoring.page.site import Site, local_path, visitor_name
from swashtwin.monitoring.sources.delivery import FACTS, safe_name

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


AT_ONCE = 4
"""Uploads that are taken at the same time; memory and disk stay bounded."""
_PIECE = 1 << 20
_TEXT = {"type": "string"}
_PROPERTIES = {"file": {**_TEXT, "format": "binary"}, **dict.fromkeys(("machine", *FACTS), _TEXT)}
_FORM = {"type": "object", "required": ["file"], "properties": _PROPERTIES}
_SCHEMA = {
    "requestBody": {"required": True, "content": {"multipart/form-data": {"schema": _FORM}}},
    "parameters": [{"name": name, "in": "query", "schema": _TEXT} for name in ("machine", *FACTS)],
}


def upload_routes(site: Site) -> APIRouter:
    """The address that takes recordings."""
    routes = APIRouter(tags=["recordings"])
    slots = asyncio.Semaphore(AT_ONCE)
    shutil.rmtree(_folder(site), ignore_errors=True)  # what a kill left there

    @routes.post(UPLOAD_PATH, status_code=202, openapi_extra=_SCHEMA)
    async def upload_recording(request: Request) -> dict[str, str]:
        """Take a recording: a form with `file`, and what is known of it.

        It is answered once the recording cannot be lost any more; the verdict follows in the
        history.
        """
        if site.upload is None:
            raise HTTPException(
                404, 'This watch takes no recordings by HTTP; add a [[source]] of kind "http".'
            )
        if slots.locked():
            raise HTTPException(
                429, "Too many uploads at once; try again soon.", headers={"retry-after": "2"}
            )
        async with slots:
            return {"id": await _take(site, request), "state": "accepted"}

    return routes


async def _take(site: Site, request: Request) -> str:
    """Id of the recording in the body of a request."""
    path = _folder(site) / secrets.token_hex(16)
    try:
        await asyncio.to_thread(path.parent.mkdir, parents=True, exist_ok=True)
        name, stated = await _write_form(request, path)
        stated = [*request.query_params.multi_items(), *stated]
        facts = dict(stated)
        if len(facts) < len(stated):
            raise HTTPException(422, "A fact is stated twice; state it once.")
        machine = facts.pop("machine", "") or None
        assert site.upload is not None
        return await asyncio.to_thread(site.upload, path, safe_name(name), machine, facts)
    except SwashTwinError as error:
        raise HTTPException(422, str(error)) from None
    except ClientDisconnect:
        raise HTTPException(400, "The upload was interrupted.") from None
    except OSError:
        raise HTTPException(507, "There is no space for the recording at the moment.") from None
    finally:
        with contextlib.suppress(OSError):
            path.unlink(missing_ok=True)


def _folder(site: Site) -> Path:
    return site.config.folder / "uploads"


async def _write_form(request: Request, path: Path) -> tuple[str, list[tuple[str, str]]]:
    try:
        async with request.form(
            max_files=1, max_fields=len(FACTS) + 2, max_part_size=10_000
        ) as form:
            upload = form.get("file")
            if not isinstance(upload, UploadFile):
                raise HTTPException(422, 'The form has no file in its field "file".')
            facts = [(key, value) for key, value in form.multi_items() if isinstance(value, str)]
            with path.open("xb") as file:
                while piece := await upload.read(_PIECE):
                    await asyncio.to_thread(file.write, piece)
            return upload.filename or "", facts
    except MultiPartException as error:
        raise HTTPException(400, error.message) from None
