"""Names that other rooms import, and where each lives."""

from .alarms.monitor import OperatingPointJudgment as OperatingPointJudgment
from .alarms.monitor import OperatingPointMonitor as OperatingPointMonitor
from .alarms.monitor import OperatingPointState as OperatingPointState
from .alarms.sensors import SensorFinding as SensorFinding
from .alarms.suspect import Suspect as Suspect
from .config.config_file import load_watch_config as load_watch_config
from .config.config_file import write_example as write_example
from .config.settings import PageSettings as PageSettings
from .config.settings import WatchConfig as WatchConfig
from .history.database import HistoryError as HistoryError
from .history.history import History as History
from .history.history import record_event as record_event
from .page.guard import Guard as Guard
from .page.server import serving_page as serving_page
from .page.sessions import Access as Access
from .page.users import add_token as add_token
from .page.users import add_user as add_user
from .page.users import remove_entry as remove_entry
from .service.judging import Outcome as Outcome
from .service.running import run_watch as run_watch
from .sources.live_device import DeviceSettings as DeviceSettings
from .sources.live_recorder import LiveRecorder as LiveRecorder
from .sources.live_recorder import LiveSettings as LiveSettings
from .status import WatchStatus as WatchStatus
