"""Server-sent events that tell an open page that the history changed.

Several processes may write into one history, so its sequence number is asked for, by one task for all open pages and
only while there are any.
"""

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable

from fastapi import APIRouter, HTTPException
from starlette.requests import Request
from starlette.responses import StreamingResponse
from starlette.types import Receive, Scope, Send

from swashtwin.foundation import SwashTwinError
from swashtwin.monitoring.page.security.access import Access
from swashtwin.monitoring.page.site import Site

POLL_SECONDS = 0.5
"""Time between two looks at the history [s]."""
_BEAT_SECONDS = 15.0
_MOST_STREAMS = 100


class ChangeSignal:
    """The history's sequence number as the open pages see it."""

    def __init__(self, site: Site) -> None:
        self._site = site
        self._sequence = -1
        self._changed = asyncio.Event()
        self._task: asyncio.Task[None] | None = None
        self.streams = 0
        """Streams that were let in."""

    async def follow(self, is_welcome: Callable[[], bool]) -> AsyncIterator[str]:
        """The number now and whenever it changes, and a comment now and then that finds lost connections; it ends
        where the reader `is_welcome` no longer.
        """
        if self._task is None:
            self._task = asyncio.create_task(self._poll())
        last = -2
        while is_welcome():
            event = self._changed
            if self._sequence != last and self._sequence >= 0:
                last = self._sequence
                yield f"event: change\ndata: {last}\n\n"
            try:
                await asyncio.wait_for(event.wait(), _BEAT_SECONDS)
            except TimeoutError:
                yield ": beat\n\n"

    def leave(self) -> None:
        """One stream less; the last one ends the looks at the history."""
        self.streams -= 1
        if self.streams == 0 and self._task is not None:
            self._task.cancel()
            self._task = None

    async def _poll(self) -> None:
        while True:
            with contextlib.suppress(SwashTwinError):  # the database stopped: ask again
                sequence = await asyncio.to_thread(self._site.history.read.sequence)
                if sequence != self._sequence:
                    self._sequence = sequence
                    self._changed.set()
                    self._changed = asyncio.Event()
            await asyncio.sleep(POLL_SECONDS)


class _CountedStream(StreamingResponse):
    """A stream that leaves its signal however it ends, also before its first event."""

    signal: ChangeSignal

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        try:
            await super().__call__(scope, receive, send)
        finally:
            self.signal.leave()


def live_routes(site: Site, access: Access) -> APIRouter:
    """The address that open pages listen to."""
    routes = APIRouter(include_in_schema=False)
    signal = ChangeSignal(site)

    @routes.get("/live")
    async def live(request: Request) -> StreamingResponse:
        if signal.streams >= _MOST_STREAMS:
            raise HTTPException(503, "Too many pages are open.")
        signal.streams += 1  # at once, so that streams that are asked for together are all counted

        def is_welcome() -> bool:
            with contextlib.suppress(SwashTwinError, OSError):  # no file of users is a no
                return access.visitor(request) is not None
            return False

        headers = {"x-accel-buffering": "no"}  # a proxy passes each event on at once
        answer = _CountedStream(signal.follow(is_welcome), media_type="text/event-stream", headers=headers)
        answer.signal = signal
        return answer

    return routes
