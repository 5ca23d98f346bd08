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

MAX_CONCURRENT_UPLOADS = 4
"""Uploads that are accepted at the same time, so that memory and disk stay bounded."""
MAX_FACT_BYTES = 10_000
"""Longest value of a form's field."""
_CHUNK_BYTES = 1 << 20
_RETRY_AFTER_S = "2"

_FIELDS = ("machine", *FACTS)
_TEXT_SCHEMA = {"type": "string"}
_FORM_SCHEMA = {
    "type": "object",
    "required": ["file"],
    "properties": {
        "file": {"type": "string", "format": "binary"},
        **dict.fromkeys(_FIELDS, _TEXT_SCHEMA),
    },
}
_OPENAPI = {
    "requestBody": {"required": True, "content": {"multipart/form-data": {"schema": _FORM_SCHEMA}}},
    "parameters": [{"name": name, "in": "query", "schema": _TEXT_SCHEMA} for name in _FIELDS],
}


def upload_routes(site: Site) -> APIRouter:
    """Return the address that accepts recordings."""
    routes = APIRouter(tags=["recordings"])
    slots = asyncio.Semaphore(MAX_CONCURRENT_UPLOADS)

    # A watch that was killed may have left incomplete uploads.
    shutil.rmtree(_upload_folder(site), ignore_errors=True)

    @routes.post(UPLOAD_PATH, status_code=202, openapi_extra=_OPENAPI)
    async def upload_recording(request: Request) -> dict[str, str]:
        """Accept a recording: a form with `file` and facts about the recording.

        The answer is sent once the recording cannot be lost; the verdict follows in the history.
        """
        if site.upload is None:
            raise HTTPException(
                404,
                "This watch accepts no recordings by HTTP."
                ' Add a [[source]] of kind "http" to its configuration.',
            )
        if slots.locked():
            raise HTTPException(
                429,
                f"{MAX_CONCURRENT_UPLOADS} uploads are in progress. Try again in"
                f" {_RETRY_AFTER_S} s.",
                headers={"retry-after": _RETRY_AFTER_S},
            )

        async with slots:
            return {"id": await _accept(site, request), "state": "accepted"}

    return routes


async def _accept(site: Site, request: Request) -> str:
    """Hand the recording in a request to the watch, and return its id."""
    path = _upload_folder(site) / secrets.token_hex(16)
    try:
        await asyncio.to_thread(path.parent.mkdir, parents=True, exist_ok=True)
        file_name, form_facts = await _write_form(request, path)

        # Facts may stand in the address or in the form; both together must not contradict.
        specified_facts = [*request.query_params.multi_items(), *form_facts]
        facts = dict(specified_facts)
        if len(facts) < len(specified_facts):
            raise HTTPException(422, "A fact is specified twice. Specify each fact once.")

        machine = facts.pop("machine", "") or None
        assert site.upload is not None
        return await asyncio.to_thread(site.upload, path, safe_name(file_name), machine, facts)
    except SwashTwinError as error:
        raise HTTPException(422, str(error)) from None
    except ClientDisconnect:
        raise HTTPException(400, "The upload was interrupted.") from None
    except OSError:
        raise HTTPException(507, "The recording cannot be stored at the moment.") from None
    finally:
        with contextlib.suppress(OSError):
            path.unlink(missing_ok=True)


def _upload_folder(site: Site) -> Path:
    return site.config.folder / "uploads"


async def _write_form(request: Request, path: Path) -> tuple[str, list[tuple[str, str]]]:
    """Write the file of a form to `path`, and return its name and the form's facts."""
    try:
        # One field more than there are names, so that a field too many is reported by its name.
        async with request.form(
            max_files=1, max_fields=len(_FIELDS) + 1, max_part_size=MAX_FACT_BYTES
        ) as form:
            upload = form.get("file")
            if not isinstance(upload, UploadFile):
                raise HTTPException(422, 'The form has no file in its field "file".')

            with path.open("xb") as file:
                while chunk := await upload.read(_CHUNK_BYTES):
                    await asyncio.to_thread(file.write, chunk)

            facts = [(key, value) for key, value in form.multi_items() if isinstance(value, str)]
            return upload.filename or "", facts
    except MultiPartException as error:
        raise HTTPException(400, error.message) from None
