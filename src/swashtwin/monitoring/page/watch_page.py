"""The application behind the page: what is refused, what is shown, and what other programs ask."""

import asyncio
from collections.abc import Callable

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.responses import JSONResponse, Response
from starlette.staticfiles import StaticFiles

from swashtwin.foundation import VERSION
from swashtwin.monitoring.config.settings import WatchConfig
from swashtwin.monitoring.history.database import HistoryError
from swashtwin.monitoring.history.history import History
from swashtwin.monitoring.page.actions import change_routes, visit_routes
from swashtwin.monitoring.page.api import machine_answers, record_answers
from swashtwin.monitoring.page.guard import Guard
from swashtwin.monitoring.page.pages import page_routes
from swashtwin.monitoring.page.prometheus import metric_routes
from swashtwin.monitoring.page.sessions import Access
from swashtwin.monitoring.page.site import Site, Upload
from swashtwin.monitoring.page.uploads import upload_routes
from swashtwin.monitoring.status import WatchStatus

_LOCAL_NAMES = ("localhost", "127.0.0.1", "::1")
_ANY = ("0.0.0.0", "::", "")


def build_watch_page(
    config: WatchConfig,
    history: History,
    upload: Upload | None = None,
    status: Callable[[], WatchStatus] | None = None,
) -> FastAPI:
    """The page of a watch, to be served by `serving_page`.

    Parameters
    ----------
    upload : takes recordings that are sent to ``POST /api/recordings``; without it they are
        refused.
    status : how the watch is doing, for ``/health``, ``/metrics`` and the log page.

    Raises
    ------
    InputError
        The page can be reached by other computers, but its file of users names nobody.
    DataError
        That file is absent or damaged.
    """
    settings = config.page
    access = Access(settings)
    site = Site(config, history, access, upload, status)
    hosts = (*_LOCAL_NAMES, *settings.hosts, *(() if settings.host in _ANY else (settings.host,)))
    application = FastAPI(
        title="swashtwin watch",
        version=VERSION,
        description="Machines, recordings, alarms and trends of a watch. Send a token: `Authorization: Bearer TOKEN`.",
        openapi_url="/api/openapi.json",
        docs_url=None,
        redoc_url=None,
        middleware=[Middleware(Guard, hosts=hosts, access=access)],
    )
    for routes in (
        page_routes(site),
        change_routes(site, is_page=True),
        visit_routes(site),
        metric_routes(site),
        upload_routes(site),
        machine_answers(site),
        record_answers(site),
        change_routes(site, is_page=False),
    ):
        application.include_router(routes)
    application.mount("/static", StaticFiles(packages=[(__package__, "static")]))
    _answer_errors(application, site)
    return application


def _answer_errors(application: FastAPI, site: Site) -> None:
    def answer(request: Request, code: int, title: str, text: str) -> Response:
        if request.url.path.startswith(("/api/", "/metrics", "/health")):
            return JSONResponse({"detail": text}, code)
        return site.render(request, "problem.html.jinja", code, title=title, text=text)

    @application.exception_handler(HTTPException)
    async def refuse(request: Request, error: HTTPException) -> Response:
        return await asyncio.to_thread(
            answer, request, error.status_code, "This did not work", str(error.detail)
        )

    @application.exception_handler(RequestValidationError)
    async def refuse_values(request: Request, error: RequestValidationError) -> Response:
        values = ", ".join(
            ".".join(map(str, problem["loc"][1:])) + f": {problem['msg']}"
            for problem in error.errors()
        )
        return await asyncio.to_thread(answer, request, 422, "This did not work", values)

    @application.exception_handler(HistoryError)
    async def report_history(request: Request, error: HistoryError) -> Response:
        text = "The history cannot be reached at the moment; the watch tries again."
        return await asyncio.to_thread(answer, request, 503, "No history", text)
