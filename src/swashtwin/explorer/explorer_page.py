"""Build the application of the explorer: its page, and what its script requests."""

import secrets
import threading
from collections.abc import Callable
from dataclasses import replace
from functools import wraps
from pathlib import Path
from typing import Annotated, Any

from fastapi import Body, Depends, FastAPI, HTTPException, Request
from starlette.middleware import Middleware
from starlette.responses import HTMLResponse, JSONResponse, Response
from starlette.staticfiles import StaticFiles

from swashtwin.explorer.address_token import TOKEN_PARAMETER, AddressToken
from swashtwin.explorer.diagnoses import Diagnoses
from swashtwin.explorer.recording_views import RecordingViews
from swashtwin.explorer.twins import TwinWorkbench
from swashtwin.explorer.workspace import FACTS, Workspace
from swashtwin.foundation import (
    VERSION,
    InputError,
    PressureUnit,
    SwashTwinError,
    json_text,
    load_templates,
    to_table,
)
from swashtwin.monitoring import Access, Guard, PageSettings, serving_page
from swashtwin.recordings import FactChange

TOKEN_HEADER = "x-explorer"
"""Header with the page's token, without which nothing is changed."""

# Addresses whose bodies may be as large as a recording: many changes, or a model.
_UPLOAD_PATHS = frozenset({"/api/facts", "/api/drop"})

Action = Callable[..., Any]


def build_explorer(
    workspace: Workspace,
    model: Path | None = None,
    *,
    address_token: str,
    pressure_unit: PressureUnit = "MPa",
) -> FastAPI:
    """Return the explorer of a workspace, to be served on this computer only.

    Parameters
    ----------
    model : file of a model for diagnoses.
    address_token : the secret that a request requires (`AddressToken`).
    pressure_unit : unit in which pressures are shown.
    """
    page_token = secrets.token_urlsafe(32)
    guard = Middleware(Guard, access=Access(PageSettings()), uploads=_UPLOAD_PATHS)
    gate = Middleware(AddressToken, token=address_token)
    application = FastAPI(
        title="swashtwin explore", version=VERSION, openapi_url=None, middleware=[guard, gate]
    )
    _add_page(application, page_token, pressure_unit)
    _handle_errors(application)

    views = RecordingViews(workspace)
    twins = TwinWorkbench(workspace, pressure_unit)
    diagnoses = Diagnoses(workspace, model, pressure_unit)
    _add_reading(application, workspace, views, twins, diagnoses)
    _add_changes(application, page_token, workspace, twins, diagnoses)

    # The style sheet and the icon are those of the watch's page, the turning pump the reports'.
    packages: list[str | tuple[str, str]] = [
        (__package__, "static"),
        ("swashtwin.report", "static"),
        ("swashtwin.monitoring.page", "static"),
    ]
    application.mount("/static", StaticFiles(packages=packages))
    return application


def _add_page(application: FastAPI, page_token: str, pressure_unit: PressureUnit) -> None:
    templates = load_templates("swashtwin.explorer")
    html = templates.get_template("explorer.html.jinja").render(
        version=VERSION, token=page_token, pressure_unit=pressure_unit
    )

    @application.get("/", response_class=HTMLResponse)
    def page() -> str:
        return html


def _handle_errors(application: FastAPI) -> None:
    @application.exception_handler(SwashTwinError)
    async def answer_error(request: Request, error: SwashTwinError) -> Response:
        return JSONResponse({"detail": str(error)}, 422)

    @application.exception_handler(OSError)
    async def answer_file_error(request: Request, error: OSError) -> Response:
        detail = f"{error.filename or 'a file'}: {error.strerror or error}"
        return JSONResponse({"detail": detail}, 422)


def _add_reading(
    application: FastAPI,
    workspace: Workspace,
    views: RecordingViews,
    twins: TwinWorkbench,
    diagnoses: Diagnoses,
) -> None:
    """Add the addresses that change nothing."""
    actions: dict[str, Action] = {
        "rows": workspace.table,
        "samples": views.samples,
        "spectrum": views.spectrum,
        "rms": views.rms,
        "waterfall": views.waterfall,
        "speed": views.speed,
        "comparison": views.comparison,
        "twin_starts": twins.starts,
        "twin_cutaway": twins.cutaway,
        "twin_job": twins.progress,
        "model": diagnoses.model,
        "diagnosis": diagnoses.diagnosis,
    }
    for name, action in actions.items():
        application.get(f"/api/{name}")(_answer_with_json(action))


def _add_changes(
    application: FastAPI,
    page_token: str,
    workspace: Workspace,
    twins: TwinWorkbench,
    diagnoses: Diagnoses,
) -> None:
    """Add the addresses that require the page's token."""

    def require_token(request: Request) -> None:
        sent_token = request.headers.get(TOKEN_HEADER, "")
        if not secrets.compare_digest(sent_token.encode(), page_token.encode()):
            raise HTTPException(403, "The page has expired. Reload it.")

    def answer_questions(answers: dict[str, str]) -> dict[str, Any]:
        workspace.propose({key: text.strip() for key, text in answers.items()})
        return workspace.table()

    def change_facts(
        changes: list[FactChange], undo: Annotated[bool, Body()] = False
    ) -> dict[str, Any]:
        workspace.change([_parse_change(change) for change in changes], undo=undo)
        return workspace.table()

    actions: dict[str, Action] = {
        "answers": answer_questions,
        "facts": change_facts,
        "twin_lines": twins.lines,
        "twin_save": twins.save,
        "twin_calibrate": twins.calibrate,
        "twin_stop": twins.stop,
        "twin_windows": twins.add_windows,
        "twin_pump": twins.add_pump,
        "prior": diagnoses.load_prior,
        "drop": diagnoses.drop,
    }
    dependencies = [Depends(require_token)]
    for name, action in actions.items():
        route = application.post(f"/api/{name}", dependencies=dependencies)
        route(_answer_with_json(action))


def _answer_with_json(action: Action) -> Callable[..., Response]:
    """Return a function that answers with an action's result as JSON.

    Numbers that are not finite become null, since JSON has none.
    """

    @wraps(action)
    def answer(*args: Any, **kwargs: Any) -> Response:
        content = action(*args, **kwargs)
        if isinstance(content, Response):
            return content
        return Response(json_text(to_table(content)), media_type="application/json")

    return answer


def _parse_change(change: FactChange) -> FactChange:
    """Return a change with the typed text as the index stores it."""
    if change.fact not in FACTS:
        raise InputError(f"Invalid fact {change.fact[:100]!r}: use one of {', '.join(FACTS)}.")

    text = str(change.value or "").strip()
    value: str | list[str] | None = text or None
    if change.fact == "sensitivity" and "," in text:
        value = [part.strip() for part in text.split(",")]
    return replace(change, value=value)


def run_explorer(
    source: Path,
    *,
    model: Path | None = None,
    pressure_unit: PressureUnit = "MPa",
    port: int,
    stop: threading.Event,
    started: Callable[[str], None],
) -> None:
    """Serve the explorer of `source` on this computer until `stop` is set.

    Parameters
    ----------
    pressure_unit : unit in which pressures are shown.
    started : called with the address once the page can be opened. It holds a new token, and only
        a browser that was started with it, or a program that sends it, gets an answer.

    Raises
    ------
    DataError
        There is nothing to show.
    InputError
        Another program uses the port.
    """
    token = secrets.token_urlsafe(32)
    application = build_explorer(
        Workspace(source), model, address_token=token, pressure_unit=pressure_unit
    )
    with serving_page(application, "127.0.0.1", port):
        started(f"http://127.0.0.1:{port}/?{TOKEN_PARAMETER}={token}")
        stop.wait()
