"""Names for distributions that add commands, and where each lives."""

from .application import app as app
from .application import main as main
from .console import print_note as print_note
from .console import print_result as print_result
from .console import print_table as print_table
from .console import print_text as print_text
from .console import progress as progress
from .console import require_existing as require_existing
from .options import Cluster as Cluster
from .options import Index as Index
from .options import Jobs as Jobs
from .options import Json as Json
from .options import Seed as Seed
from .options import Window as Window
from .options import read_list as read_list
from .options import read_pairs as read_pairs
from .options import split_names as split_names
from .outputs import require_folder as require_folder
from .outputs import require_output as require_output
from .watching import require_extra as require_extra
from .watching import stop_signals as stop_signals
