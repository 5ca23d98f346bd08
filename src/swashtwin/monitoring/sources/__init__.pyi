"""Names that the rest of the room imports, and where each lives."""

from .contents import Contents as Contents
from .contents import read_contents as read_contents
from .delivery import FACTS as FACTS
from .delivery import Accept as Accept
from .delivery import Delivery as Delivery
from .delivery import Standing as Standing
from .delivery import UnfitError as UnfitError
from .delivery import check_facts as check_facts
from .delivery import safe_name as safe_name
from .folder import FolderWatch as FolderWatch
from .mqtt import MqttWatch as MqttWatch
from .spool import Spool as Spool
from .spool import SpoolFile as SpoolFile
from .spool import lock_file as lock_file
from .spool import lock_folder as lock_folder
from .tags import Tags as Tags
