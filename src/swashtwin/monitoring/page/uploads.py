"""Accept recordings that are sent by HTTP."""

import asyncio
import contextlib
import secrets
import shutil
from pathlib import Path

from fastapi import APIRouter, HTTPException, Request
from starlette.datastructures import UploadFile
from starlette.formparsers import MultiPartException
from starlette.requests import ClientDisconnect

from swashtwin.foundation import SwashTwinError
from swashtwin.monitoring.page.guard import UPLOAD_PATH
from swashtwin.monitoring.page.site import Site
from swashtwin.monitoring.sources.delivery import FACTS, safe_name

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
