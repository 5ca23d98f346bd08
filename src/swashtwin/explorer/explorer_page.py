"""The application behind the explorer: its page, and what its script asks for."""

import secrets
import threading
from collections.abc import Callable
from dataclasses import replace
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from fastapi import Body, Depends, FastAPI, HTTPException, Request
from jinja2 import Environment, PackageLoader, StrictUndefined
from starlette.middleware import Middleware
from starlette.responses import HTMLResponse, JSONResponse, Response
from starlette.staticfiles import StaticFiles

from swashtwin.explorer.diagnoses import Diagnoses
from swashtwin.explorer.recording_views import RecordingViews
from swashtwin.explorer.twins import TwinWorkbench
from swashtwin.explorer.workspace import FACTS, Workspace
from swashtwin.foundation import VERSION, InputError, SwashTwinError, json_text, to_table
from swashtwin.monitoring import Access, Guard, PageSettings, serving_page
from swashtwin.recordings import FactChange

if TYPE_CHECKING:
    pass


LOCAL_NAMES = ("localhost", "127.0.0.1", "::1")
TOKEN = "x-explorer"
"""Header with the page's token, without which nothing is changed."""
_UPLOADS = frozenset({"/api/facts", "/api/drop"})


def build_explorer(workspace: Workspace, model: Path | None = None) -> FastAPI:
    """The explorer of a workspace, to be served on this computer only; with a model to diagnose
    with, or without.
    """
    token = secrets.token_urlsafe(32)
    guard = Middleware(Guard, hosts=LOCAL_NAMES, access=Access(PageSettings()), uploads=_UPLOADS)
    application = FastAPI(
        title="swashtwin explore", version=VERSION, openapi_url=None, middleware=[guard]
    )

    def require_token(request: Request) -> None:
        if not secrets.compare_digest(request.headers.get(TOKEN, "").encode(), token.encode()):
            raise HTTPException(403, "The page is too old. Load it again.")

    environment = Environment(
        loader=PackageLoader("swashtwin.explorer"), autoescape=True, undefined=StrictUndefined
    )
    html = environment.get_template("explorer.html.jinja").render(version=VERSION, token=token)

    @application.get("/", response_class=HTMLResponse)
    def page() -> str:
        return html

    @application.exception_handler(SwashTwinError)
    async def refuse(request: Request, error: SwashTwinError) -> Response:
        return JSONResponse({"detail": str(error)}, 422)

    @application.exception_handler(OSError)
    async def report_disk(request: Request, error: OSError) -> Response:
        return JSONResponse(
            {"detail": f"{error.filename or 'a file'}: {error.strerror or error}"}, 422
        )

    def propose(
        given: dict[str, str],
    ) -> dict[str, Any]:  # what nobody but the user can say of a folder's files
        workspace.propose({key: text.strip() for key, text in given.items()})
        return workspace.table()

    def change(changes: list[FactChange], undo: Annotated[bool, Body()] = False) -> dict[str, Any]:
        workspace.change([_understood(each) for each in changes], undo=undo)
        return workspace.table()

    figures, twins, models = (
        RecordingViews(workspace),
        TwinWorkbench(workspace),
        Diagnoses(workspace, model),
    )
    reading: dict[str, Callable[..., Any]] = {
        "rows": workspace.table, "samples": figures.samples, "spectrum": figures.spectrum, "levels": figures.levels,
        "waterfall": figures.waterfall, "speed": figures.speed, "comparison": figures.comparison,
        "twin_starts": twins.starts, "twin_cutaway": twins.cutaway, "twin_job": twins.progress,
        "model": models.model, "diagnosis": models.diagnosis,
    }  # fmt: skip
    changing: dict[str, Callable[..., Any]] = {
        "answers": propose, "facts": change, "twin_lines": twins.lines, "twin_save": twins.save,
        "twin_calibrate": twins.calibrate, "twin_stop": twins.stop, "twin_windows": twins.add_windows,
        "twin_pump": twins.add_pump, "prior": models.take_prior, "drop": models.drop,
    }  # fmt: skip
    for name, work in reading.items():
        application.get(f"/api/{name}")(_answering(work))
    for name, work in changing.items():
        application.post(f"/api/{name}", dependencies=[Depends(require_token)])(_answering(work))
    packages: list[str | tuple[str, str]] = [
        (__package__, "static"),
        ("swashtwin.monitoring.page", "static"),
    ]
    application.mount("/static", StaticFiles(packages=packages))
    return application


def _answering(work: Callable[..., Any]) -> Callable[..., Response]:
    """`work` with its table as JSON, where what is no finite number is null."""

    @wraps(work)
    def answer(*values: Any, **named: Any) -> Response:
        content = work(*values, **named)
        if isinstance(content, Response):
            return content
        return Response(json_text(to_table(content)), media_type="application/json")

    return answer


def _understood(change: FactChange) -> FactChange:
    """A change as the index writes it, of what somebody typed."""
    if change.fact not in FACTS:
        raise InputError(f"{change.fact[:100]!r} is no fact that is edited here.")
    value: Any = str(change.value or "").strip() or None
    if change.fact == "sensitivity" and value and "," in value:
        value = [part.strip() for part in value.split(",")]
    return replace(change, value=value)


def run_explorer(
    source: Path,
    *,
    model: Path | None = None,
    port: int,
    stop: threading.Event,
    started: Callable[[str], None],
) -> None:
    """Serve the explorer of `source` on this computer until `stop` is set.

    Raises
    ------
    DataError
        There is nothing to look at.
    InputError
        Another program uses the port.
    """
    with serving_page(build_explorer(Workspace(source), model), "127.0.0.1", port):
        started(f"http://127.0.0.1:{port}/")
        stop.wait()
