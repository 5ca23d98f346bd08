"""Names that the rest of the room imports, and where each lives."""

from .database import HistoryError as HistoryError
from .history import History as History
from .reading import FACTS as FACTS
from .reading import Counts as Counts
from .reading import MachineOverview as MachineOverview
from .reading import Trend as Trend
from .tables import Alarm as Alarm
from .tables import Event as Event
from .tables import Judgment as Judgment
from .tables import Message as Message
from .tables import Point as Point
from .tables import Rejection as Rejection
from .tables import Silence as Silence
from .transaction import MachineTransaction as MachineTransaction
