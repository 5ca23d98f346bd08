"""The explorer's addresses: one page, and what its script asks for as JSON."""

import asyncio
import secrets
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from fastapi import Body, Depends, FastAPI, HTTPException, Query, Request
from jinja2 import Environment, PackageLoader, StrictUndefined
from starlette.middleware import Middleware
from starlette.responses import HTMLResponse, JSONResponse, Response
from starlette.staticfiles import StaticFiles

from swashtwin.explorer.diagnoses import Diagnoses
from swashtwin.explorer.figures import Figures
from swashtwin.explorer.twins import Setting, TwinRoom
from swashtwin.explorer.workspace import BIN, FACTS, Workspace
from swashtwin.foundation import VERSION, InputError, SwashTwinError, json_text, to_table
from swashtwin.monitoring import Access, Guard, PageSettings, serving_page
from swashtwin.recordings import FactChange
from swashtwin.report import cutaway_html
from swashtwin.signals import LineSpectrumKind

LOCAL_NAMES = ("localhost", "127.0.0.1", "::1")
MOST_VALUES = 1 << 22
"""Samples that one answer holds, at most."""
TOKEN = "x-explorer"
"""Header with the page's token, without which nothing is changed."""
_UPLOADS = frozenset({"/api/facts", "/api/drop"})

Name = Annotated[str, Query(max_length=1000)]


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

    answers, twins, models = Answers(workspace), TwinAnswers(workspace), ModelAnswers(workspace, model)
    for reading in (answers.rows, answers.samples, answers.spectrum, answers.waterfall, answers.levels, answers.speed,
                    answers.comparison, twins.twin_starts, twins.twin_cutaway, twins.twin_job, models.model,
                    models.diagnosis):  # fmt: skip
        application.get(f"/api/{reading.__name__}")(reading)
    for changing in (answers.answers, answers.facts, twins.twin_lines, twins.twin_calibrate, twins.twin_stop,
                     twins.twin_save, twins.twin_windows, twins.twin_pump, models.prior, models.drop):  # fmt: skip
        application.post(f"/api/{changing.__name__}", dependencies=[Depends(require_token)])(changing)
    packages: list[str | tuple[str, str]] = [(__package__, "static"), ("swashtwin.monitoring.page", "static")]
    application.mount("/static", StaticFiles(packages=packages))
    return application


class Answers:
    """What the rooms of recordings ask for."""

    def __init__(self, workspace: Workspace) -> None:
        self._workspace = workspace
        self._figures = Figures(workspace)

    def rows(self, since: int = -1) -> Response:
        """Rows of the table that changed."""
        return answer(self._workspace.table(since))

    def answers(self, given: dict[str, str]) -> Response:
        """Take what nobody but the user can say of a folder's files, and propose its index again."""
        self._workspace.propose({key: text.strip() for key, text in given.items()})
        return self.rows()

    def facts(self, edit: Changes) -> Response:
        """Change facts."""
        self._workspace.change([_understood(change) for change in edit.changes], undo=edit.undo)
        return self.rows()

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

    def spectrum(
        self,
        name: Name,
        kind: LineSpectrumKind = "amplitude",
        low: float | None = None,
        high: float | None = None,
        pistons: Annotated[int | None, Query(ge=1, le=100)] = None,
        bodies: Annotated[int | None, Query(ge=1, le=1000)] = None,
        ratio: float | None = None,
        healthy: bool = False,
    ) -> Response:
        """A spectrum with its marks."""
        band = None if low is None or high is None else (low, high)
        bearing = None if bodies is None or ratio is None else (bodies, ratio)
        return answer(self._figures.spectrum(name, kind, band=band, pistons=pistons, bearing=bearing, healthy=healthy))

    def waterfall(self, name: Name, channel: int = 0, orders: bool = False) -> Response:
        """Level over time and frequency, or turns and order."""
        return answer(self._figures.waterfall(name, channel, orders=orders))

    def levels(self, name: Name) -> Response:
        """Level over time."""
        return answer(self._figures.levels(name))

    def comparison(
        self, first: Annotated[list[str], Query(max_length=50)], second: Annotated[list[str], Query(max_length=50)]
    ) -> Response:
        """What differs between two groups of recordings."""
        return answer(self._figures.comparison(first, second))

    def speed(self, name: Name, pistons: Annotated[int, Query(ge=1, le=100)]) -> Response:
        """Speed that the lines show."""
        return answer(self._figures.speed(name, pistons))


class TwinAnswers:
    """What the twin's room asks for."""

    def __init__(self, workspace: Workspace) -> None:
        self._room = TwinRoom(workspace)

    def twin_starts(self) -> Response:
        """What a twin can start from."""
        return answer(self._room.starts())

    def twin_cutaway(self, label: Name, pistons: int, shaft: float) -> HTMLResponse:
        """The pump, cut open."""
        return HTMLResponse(cutaway_html(label, pistons, shaft))

    def twin_lines(self, setting: Setting) -> Response:
        """Lines of a twin over the measured ones."""
        return answer(self._room.lines(setting))

    def twin_job(self) -> Response:
        """How far the calibration is."""
        return answer(self._room.progress())

    def twin_calibrate(self, setting: Setting, others: Annotated[bool, Body()] = False) -> Response:
        """Calibrate from here."""
        return answer(self._room.calibrate(setting, others))

    def twin_stop(self) -> Response:
        """Stop the calibration."""
        self._room.job.is_stopped = True
        return self.twin_job()

    def twin_save(self, name: Annotated[str, Body(embed=True)]) -> Response:
        """Save the last calibration."""
        return answer({"file": self._room.save(name)})

    def twin_windows(
        self, setting: Setting, name: Annotated[str, Body()], count: Annotated[int, Body(ge=1, le=10_000)]
    ) -> Response:
        """Synthetic windows, to train with."""
        return answer(self._room.add_windows(setting, count, name))

    def twin_pump(self, name: Annotated[str, Body()], plate: Annotated[dict[str, str], Body()]) -> Response:
        """A pump of a nameplate."""
        return answer(self._room.add_pump(name, plate))


class ModelAnswers:
    """What the room of diagnoses asks for."""

    def __init__(self, workspace: Workspace, model: Path | None) -> None:
        self._diagnoses = Diagnoses(workspace, model)

    def model(self) -> Response:
        """The model's name."""
        return answer({"model": self._diagnoses.name})

    def diagnosis(self, name: Name) -> Response:
        """Verdict on a recording."""
        return answer(self._diagnoses.diagnosis(name))

    def prior(self) -> Response:
        """Take the shipped prior."""
        self._diagnoses.take_prior()
        return self.model()

    async def drop(self, request: Request, name: Name) -> Response:
        """Take a model that was dropped on the page."""
        await asyncio.to_thread(self._diagnoses.drop, await request.body(), name)
        return self.model()


def answer(content: Mapping[str, Any]) -> Response:
    """JSON of a table; what is no finite number is null."""
    return Response(json_text(to_table(content)), media_type="application/json")


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
