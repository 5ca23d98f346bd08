"""Names that the rest of the room imports, and where each lives."""

from .loading import load_watch_config as load_watch_config
from .loading import write_example as write_example
from .settings import AlarmSettings as AlarmSettings
from .settings import Broker as Broker
from .settings import Channel as Channel
from .settings import EmailChannel as EmailChannel
from .settings import FolderSource as FolderSource
from .settings import HttpSource as HttpSource
from .settings import LogChannel as LogChannel
from .settings import Machine as Machine
from .settings import MqttChannel as MqttChannel
from .settings import MqttSource as MqttSource
from .settings import PageSettings as PageSettings
from .settings import Retention as Retention
from .settings import Secret as Secret
from .settings import Source as Source
from .settings import WatchConfig as WatchConfig
from .settings import WebhookChannel as WebhookChannel
