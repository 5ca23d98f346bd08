"""Build the application of the page from its routes."""

import asyncio
from collections.abc import Callable

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.responses import JSONResponse, Response
from starlette.staticfiles import StaticFiles

from swashtwin.foundation import VERSION
from swashtwin.monitoring.config.settings import PageSettings, WatchConfig
from swashtwin.monitoring.history.database import HistoryError
from swashtwin.monitoring.history.history import History
from swashtwin.monitoring.page.actions import change_routes, visit_routes
from swashtwin.monitoring.page.api import machine_routes, record_routes
from swashtwin.monitoring.page.guard import LOCAL_NAMES, Guard
from swashtwin.monitoring.page.pages import page_routes
from swashtwin.monitoring.page.prometheus import metric_routes
from swashtwin.monitoring.page.sessions import Access
from swashtwin.monitoring.page.site import Site, Upload
from swashtwin.monitoring.page.uploads import upload_routes
from swashtwin.monitoring.status import WatchStatus

_ANY_ADDRESS = ("0.0.0.0", "::", "")
_PROGRAM_PATHS = ("/api/", "/metrics", "/health")


def build_watch_page(
    config: WatchConfig,
    history: History,
    upload: Upload | None = None,
    status: Callable[[], WatchStatus] | None = None,
) -> FastAPI:
    """Return the page of a watch, to be served by `serving_page`.

    Parameters
    ----------
    upload : takes recordings that are sent to ``POST /api/recordings``; without it they are
        refused.
    status : returns the status of the watch, for ``/health``, ``/metrics`` and the log page.

    Raises
    ------
    InputError
        The page can be reached by other computers, but its file of users has no entry.
    DataError
        The file of users is absent or damaged.
    """
    access = Access(config.page)
    site = Site(config, history, access, upload, status)
    application = FastAPI(
        title="swashtwin watch",
        version=VERSION,
        description=(
            "Machines, recordings, alarms and trends of a watch."
            " If there are logins, send a token: `Authorization: Bearer TOKEN`."
        ),
        openapi_url="/api/openapi.json",
        docs_url=None,
        redoc_url=None,
        middleware=[Middleware(Guard, hosts=_allowed_hosts(config.page), access=access)],
    )

    for routes in (
        page_routes(site),
        change_routes(site, is_page=True),
        visit_routes(site),
        metric_routes(site),
        upload_routes(site),
        machine_routes(site),
        record_routes(site),
        change_routes(site, is_page=False),
    ):
        application.include_router(routes)
    # The turning pump of an alarm is that of the reports.
    packages: list[str | tuple[str, str]] = [
        (__package__, "static"),
        ("swashtwin.report", "static"),
    ]
    application.mount("/static", StaticFiles(packages=packages))
    _handle_errors(application, site)
    return application


def _allowed_hosts(settings: PageSettings) -> list[str]:
    hosts = [*LOCAL_NAMES, *settings.hosts]
    # An address that means "all addresses" is not a name by which a browser calls the page.
    if settings.host not in _ANY_ADDRESS:
        hosts.append(settings.host)
    return hosts


def _handle_errors(application: FastAPI, site: Site) -> None:
    """Answer errors as a page for people and as JSON for programs."""

    async def answer(request: Request, code: int, title: str, text: str) -> Response:
        if request.url.path.startswith(_PROGRAM_PATHS):
            return JSONResponse({"detail": text}, code)
        # Rendering reads the history, which must not block the event loop.
        return await asyncio.to_thread(
            site.render, request, "problem.html.jinja", code, title=title, text=text
        )

    @application.exception_handler(HTTPException)
    async def answer_refusal(request: Request, error: HTTPException) -> Response:
        title = "Request refused"
        if error.status_code == 404:
            title = "Not found"
        return await answer(request, error.status_code, title, str(error.detail))

    @application.exception_handler(RequestValidationError)
    async def answer_invalid_values(request: Request, error: RequestValidationError) -> Response:
        problems = []
        for problem in error.errors():
            # The first part of a location is where the value stood, such as "query".
            name = ".".join(str(part) for part in problem["loc"][1:])
            problems.append(f"{name}: {problem['msg']}")
        return await answer(request, 422, "Invalid values", ", ".join(problems))

    @application.exception_handler(HistoryError)
    async def answer_history_error(request: Request, error: HistoryError) -> Response:
        # The error's text may hold the address and the password of the database.
        text = "The history cannot be reached at the moment. The watch keeps trying."
        return await answer(request, 503, "History unavailable", text)
