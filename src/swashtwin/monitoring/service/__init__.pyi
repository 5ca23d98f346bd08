"""Names that the rest of the room imports, and where each lives."""

from .events import record_event as record_event
from .pipeline import Outcome as Outcome
from .running import run_watch as run_watch
from .status import SourceStatus as SourceStatus
from .status import WatchStatus as WatchStatus
from .twins import TwinUpdate as TwinUpdate
from .twins import update_twin as update_twin

__all__ = ["Outcome", "SourceStatus", "TwinUpdate", "WatchStatus", "record_event", "run_watch", "update_twin"]
