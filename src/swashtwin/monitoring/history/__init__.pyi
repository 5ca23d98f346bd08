"""Names that the rest of the room imports, and where each lives."""

from .database import History as History
from .engine import HistoryError as HistoryError
from .records import Alarm as Alarm
from .records import Counts as Counts
from .records import Estimate as Estimate
from .records import Event as Event
from .records import Judgment as Judgment
from .records import MachineOverview as MachineOverview
from .records import Message as Message
from .records import Point as Point
from .records import Recalibration as Recalibration
from .records import Rejection as Rejection
from .records import Silence as Silence
from .records import StoredRecording as StoredRecording
from .records import Trend as Trend
from .transaction import MachineTransaction as MachineTransaction

__all__ = [
    "Alarm",
    "Counts",
    "Estimate",
    "Event",
    "History",
    "HistoryError",
    "Judgment",
    "MachineOverview",
    "MachineTransaction",
    "Message",
    "Point",
    "Recalibration",
    "Rejection",
    "Silence",
    "StoredRecording",
    "Trend",
]
