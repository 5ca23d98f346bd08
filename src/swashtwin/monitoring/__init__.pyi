"""Names that other rooms import, and where each lives."""

from .alarms import PointJudgment as PointJudgment
from .alarms import PointMonitor as PointMonitor
from .alarms import PointState as PointState
from .alarms import SensorFinding as SensorFinding
from .config import WatchConfig as WatchConfig
from .config import load_watch_config as load_watch_config
from .config import write_example as write_example
from .history import History as History
from .history import HistoryError as HistoryError
from .page.users import add_token as add_token
from .page.users import add_user as add_user
from .page.users import remove_entry as remove_entry
from .service import Outcome as Outcome
from .service import WatchStatus as WatchStatus
from .service import record_event as record_event
from .service import run_watch as run_watch
