"""Style, script and icon of the page, and plotly's script out of its wheel: nothing comes from the network."""

import gzip
from functools import cache
from importlib import resources
from importlib.util import find_spec
from pathlib import Path

from fastapi import APIRouter, HTTPException, Request
from starlette.responses import Response

_TYPES = {"page.css": "text/css", "page.js": "text/javascript", "icon.svg": "image/svg+xml"}
_PLOTLY = "plotly.min.js"
_HOUR = {"cache-control": "public, max-age=3600"}


def static_routes() -> APIRouter:
    """Addresses of the files, which everybody may read."""
    routes = APIRouter(prefix="/static", include_in_schema=False)

    @routes.get("/{name}")
    def static(request: Request, name: str) -> Response:
        if name == _PLOTLY:
            if "gzip" in request.headers.get("accept-encoding", ""):
                headers = {**_HOUR, "content-encoding": "gzip", "vary": "accept-encoding"}
                return Response(_packed_plotly(), media_type="text/javascript", headers=headers)
            return Response(_plotly_path().read_bytes(), media_type="text/javascript", headers=_HOUR)
        if name not in _TYPES:
            raise HTTPException(404, "There is no such file.")
        content = resources.files("swashtwin.monitoring.page").joinpath("static", name).read_bytes()
        return Response(content, media_type=_TYPES[name], headers=_HOUR)

    return routes


def _plotly_path() -> Path:
    specification = find_spec("plotly")
    if specification is None or not specification.submodule_search_locations:
        raise HTTPException(404, "plotly is not installed.")
    return Path(specification.submodule_search_locations[0], "package_data", _PLOTLY)


@cache
def _packed_plotly() -> bytes:
    return gzip.compress(_plotly_path().read_bytes(), 6)
