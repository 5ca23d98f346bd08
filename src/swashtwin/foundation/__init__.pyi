"""Names that other rooms import, and where each lives."""

from .artifacts import add_prefix as add_prefix
from .artifacts import artifact_kind as artifact_kind
from .artifacts import load_artifact as load_artifact
from .artifacts import optimizer_tensors as optimizer_tensors
from .artifacts import read_artifact as read_artifact
from .artifacts import read_run as read_run
from .artifacts import refuse_misfits as refuse_misfits
from .artifacts import require_form as require_form
from .artifacts import restore_optimizer as restore_optimizer
from .artifacts import save_artifact as save_artifact
from .artifacts import select_prefix as select_prefix
from .artifacts import write_artifact as write_artifact
from .artifacts import write_run as write_run
from .cards import from_table as from_table
from .cards import parse_json as parse_json
from .cards import to_table as to_table
from .compiling import compiled as compiled
from .errors import ArtifactError as ArtifactError
from .errors import DataError as DataError
from .errors import InputError as InputError
from .errors import LeakError as LeakError
from .errors import MissingExtraError as MissingExtraError
from .errors import MissingFileError as MissingFileError
from .errors import StabilityError as StabilityError
from .errors import SwashTwinError as SwashTwinError
from .errors import UnitError as UnitError
from .files import TEXT as TEXT
from .files import file_name as file_name
from .files import open_pieces as open_pieces
from .files import partial_results as partial_results
from .files import read_text as read_text
from .files import replacing as replacing
from .files import require_disk_space as require_disk_space
from .files import sha256_of as sha256_of
from .files import write_text as write_text
from .memory import MEMORY_VARIABLE as MEMORY_VARIABLE
from .memory import keep_freed_memory as keep_freed_memory
from .memory import memory_limit as memory_limit
from .memory import require_memory as require_memory
from .memory import return_memory as return_memory
from .multiple_testing import holm_correction as holm_correction
from .printing import escape_controls as escape_controls
from .processes import end_with as end_with
from .processes import parallel as parallel
from .seeding import derive_seed as derive_seed
from .seeding import stream as stream
from .texts import csv_text as csv_text
from .texts import plain_text as plain_text
from .texts import plural as plural
from .texts import spreadsheet_text as spreadsheet_text
from .torch_state import TorchStream as TorchStream
from .torch_state import has_bfloat16_arithmetic as has_bfloat16_arithmetic
from .torch_state import one_thread as one_thread
from .units import MPa as MPa
from .units import bar as bar
from .units import celsius as celsius
from .units import deg as deg
from .units import hertz as hertz
from .units import is_unit as is_unit
from .units import mm as mm
from .units import parse as parse
from .units import rpm as rpm
from .units import um as um
from .version import VERSION as VERSION
from .version import __version__ as __version__

__all__ = [
    "MEMORY_VARIABLE",
    "TEXT",
    "VERSION",
    "ArtifactError",
    "DataError",
    "InputError",
    "LeakError",
    "MPa",
    "MissingExtraError",
    "MissingFileError",
    "StabilityError",
    "SwashTwinError",
    "TorchStream",
    "UnitError",
    "__version__",
    "add_prefix",
    "artifact_kind",
    "bar",
    "celsius",
    "compiled",
    "csv_text",
    "deg",
    "derive_seed",
    "end_with",
    "escape_controls",
    "file_name",
    "from_table",
    "has_bfloat16_arithmetic",
    "hertz",
    "holm_correction",
    "is_unit",
    "keep_freed_memory",
    "load_artifact",
    "memory_limit",
    "mm",
    "one_thread",
    "open_pieces",
    "optimizer_tensors",
    "parallel",
    "parse",
    "parse_json",
    "partial_results",
    "plain_text",
    "plural",
    "read_artifact",
    "read_run",
    "read_text",
    "refuse_misfits",
    "replacing",
    "require_disk_space",
    "require_form",
    "require_memory",
    "restore_optimizer",
    "return_memory",
    "rpm",
    "save_artifact",
    "select_prefix",
    "sha256_of",
    "spreadsheet_text",
    "stream",
    "to_table",
    "um",
    "write_artifact",
    "write_run",
    "write_text",
]
