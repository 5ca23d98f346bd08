"""How a watch is doing, for the page's health and metrics."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime


@dataclass(frozen=True)
class SourceStatus:
    """How a source of recordings is doing."""

    name: str
    """Its name in the configuration."""
    kind: str
    """``folder``, ``mqtt`` or ``http``."""
    connected: bool
    """Whether it is reached."""
    detail: str
    """What is wrong, in one line without secrets; empty while it works."""
    received: int
    """Recordings that it delivered since the start."""


@dataclass(frozen=True)
class WatchStatus:
    """How a watch is doing."""

    started: datetime
    """When it started (UTC)."""
    waiting: int
    """Recordings that arrived and are not judged yet."""
    outbox: int
    """Messages that are not sent yet."""
    sources: tuple[SourceStatus, ...]
    """Each source."""
    free_bytes: int
    """Free space on the disk of the watch's folder."""
    counters: Mapping[str, float]
    """What was counted since the start: ``judged``, ``rejected``, ``failures`` (recordings that our own error stopped),
    and ``seconds_judging``."""
    problems: tuple[str, ...] = ()
    """What keeps the watch from its work, one line each; empty while all is well."""
