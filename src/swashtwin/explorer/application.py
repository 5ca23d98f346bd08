"""The explorer's addresses: one page, and what its script asks for as JSON."""

import secrets
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, wraps
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from fastapi import Depends, FastAPI, HTTPException, Query, Request
from jinja2 import Environment, PackageLoader, StrictUndefined
from starlette.middleware import Middleware
from starlette.responses import HTMLResponse, JSONResponse, Response
from starlette.staticfiles import StaticFiles

from swashtwin.explorer.diagnoses import Diagnoses
from swashtwin.explorer.figures import Figures
from swashtwin.explorer.twins import TwinRoom
from swashtwin.explorer.workspace import BIN, FACTS, Name, Workspace
from swashtwin.foundation import VERSION, InputError, SwashTwinError, json_text, to_table
from swashtwin.monitoring import Access, Guard, PageSettings, serving_page
from swashtwin.recordings import FactChange

LOCAL_NAMES = ("localhost", "127.0.0.1", "::1")
MOST_VALUES = 1 << 22
"""Samples that one answer holds, at most."""
TOKEN = "x-explorer"
"""Header with the page's token, without which nothing is changed."""
_UPLOADS = frozenset({"/api/facts", "/api/drop"})


@dataclass(frozen=True)
class Changes:
    """Facts that are changed together."""

    changes: list[FactChange]
    undo: bool = False
    """Whether they undo changes."""


def build_explorer(workspace: Workspace, model: Path | None = None) -> FastAPI:
    """The explorer of a workspace, to be served on this computer only; with a model to diagnose with, or without."""
    token = secrets.token_urlsafe(32)
    guard = Middleware(Guard, hosts=LOCAL_NAMES, access=Access(PageSettings()), uploads=_UPLOADS)
    application = FastAPI(title="swashtwin explore", version=VERSION, openapi_url=None, middleware=[guard])

    def require_token(request: Request) -> None:
        if not secrets.compare_digest(request.headers.get(TOKEN, "").encode(), token.encode()):
            raise HTTPException(403, "The page is too old. Load it again.")

    @application.get("/", response_class=HTMLResponse)
    def page() -> HTMLResponse:
        return HTMLResponse(_page().render(version=VERSION, token=token, facts=FACTS))

    @application.exception_handler(SwashTwinError)
    async def refuse(request: Request, error: SwashTwinError) -> Response:
        return JSONResponse({"detail": str(error)}, 422)

    @application.exception_handler(OSError)
    async def report_disk(request: Request, error: OSError) -> Response:
        return JSONResponse({"detail": f"{error.filename or 'a file'}: {error.strerror or error}"}, 422)

    answers, figures, twins, models = (
        Answers(workspace),
        Figures(workspace),
        TwinRoom(workspace),
        Diagnoses(workspace, model),
    )
    reading: dict[str, Callable[..., Any]] = {
        "rows": workspace.table, "samples": answers.samples, "spectrum": figures.spectrum, "levels": figures.levels,
        "waterfall": figures.waterfall, "speed": figures.speed, "comparison": figures.comparison,
        "twin_starts": twins.starts, "twin_cutaway": twins.cutaway, "twin_job": twins.progress,
        "model": models.model, "diagnosis": models.diagnosis,
    }  # fmt: skip
    changing: dict[str, Callable[..., Any]] = {
        "answers": answers.propose, "facts": answers.change, "twin_lines": twins.lines, "twin_save": twins.save,
        "twin_calibrate": twins.calibrate, "twin_stop": twins.stop, "twin_windows": twins.add_windows,
        "twin_pump": twins.add_pump, "prior": models.take_prior, "drop": models.drop,
    }  # fmt: skip
    for name, work in reading.items():
        application.get(f"/api/{name}")(_answering(work))
    for name, work in changing.items():
        application.post(f"/api/{name}", dependencies=[Depends(require_token)])(_answering(work))
    packages: list[str | tuple[str, str]] = [(__package__, "static"), ("swashtwin.monitoring.page", "static")]
    application.mount("/static", StaticFiles(packages=packages))
    return application


class Answers:
    """What changes the recordings' facts, and their samples."""

    def __init__(self, workspace: Workspace) -> None:
        self._workspace = workspace

    def propose(self, given: dict[str, str]) -> dict[str, Any]:
        """Take what nobody but the user can say of a folder's files, and propose its index again."""
        self._workspace.propose({key: text.strip() for key, text in given.items()})
        return self._workspace.table()

    def change(self, edit: Changes) -> dict[str, Any]:
        """Change facts."""
        self._workspace.change([_understood(change) for change in edit.changes], undo=edit.undo)
        return self._workspace.table()

    def samples(
        self,
        name: Name,
        start: Annotated[int, Query(ge=0)],
        count: Annotated[int, Query(ge=1)],
        width: Annotated[int, Query(ge=1)] = 1,
        channel: Annotated[int | None, Query(ge=0)] = None,
    ) -> Response:
        """Float32: channel by channel the least and greatest of each bin, or the samples of one channel."""
        recording = self._workspace.recording(name)
        if width >= BIN and width % BIN:
            raise InputError(f"bins have less than {BIN} samples, or a multiple of them; {width} is none.")
        if count * min(width, BIN) * (recording.n_channels if channel is None else 1) > MOST_VALUES:
            raise InputError(f"at most {MOST_VALUES} values are sent at once.")
        if channel is None:
            values = self._workspace.extremes(name, width, start, count)
        elif channel >= recording.n_channels or start >= recording.n_samples:
            raise InputError(f"{name} has {recording.n_channels} channels of {recording.n_samples} samples.")
        else:
            values = recording.slice(start, min(start + count, recording.n_samples)).signal[channel]
        return Response(np.ascontiguousarray(values, "<f4").tobytes(), media_type="application/octet-stream")


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
    after: Any = str(change.after or "").strip() or None
    if change.fact == "sensitivity" and after and "," in after:
        after = [part.strip() for part in after.split(",")]
    return replace(change, after=after)


@cache
def _page() -> Any:
    environment = Environment(loader=PackageLoader("swashtwin.explorer"), autoescape=True, undefined=StrictUndefined)
    return environment.get_template("explorer.html.jinja")


def run_explorer(
    source: Path, *, model: Path | None = None, port: int, stop: threading.Event, started: Callable[[str], None]
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
