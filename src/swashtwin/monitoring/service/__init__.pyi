"""Names that the rest of the room imports, and where each lives."""

from .judging import Outcome as Outcome
from .judging import record_event as record_event
from .running import SourceStatus as SourceStatus
from .running import WatchStatus as WatchStatus
from .running import run_watch as run_watch
