"""Names for distributions that add commands, and where each lives."""

from .application import app as app
from .application import main as main
from .console import note as note
from .console import progress as progress
from .console import require_files as require_files
from .console import say as say
from .console import table as table
from .console import tell as tell
from .files import as_folder as as_folder
from .files import require_output as require_output
from .options import Index as Index
from .options import Jobs as Jobs
from .options import Json as Json
from .options import Seed as Seed
from .options import Window as Window
from .options import read_list as read_list
from .options import read_pairs as read_pairs
from .options import read_words as read_words
from .watching import require_extra as require_extra
from .watching import stop_signals as stop_signals
