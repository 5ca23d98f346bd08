"""Names that other rooms import, and where each lives."""

from .assembly import open_recording as open_recording
from .assembly import read_recording as read_recording
from .assembly import recording_from as recording_from
from .checks.channels import clipped_readings as clipped_readings
from .checks.findings import InspectionReport as InspectionReport
from .checks.findings import RecordingReport as RecordingReport
from .checks.inspection import inspect_recording as inspect_recording
from .checks.inspection import inspect_recordings as inspect_recordings
from .checks.usability import refuse_unfit as refuse_unfit
from .checks.usability import stated_speed as stated_speed
from .disk_space import require_room as require_room
from .entry import Entry as Entry
from .formats.raw import Options as Options
from .formats.registry import WRITABLE as WRITABLE
from .formats.registry import read_raw as read_raw
from .formats.registry import stem_of as stem_of
from .formats.registry import suffix_of as suffix_of
from .formats.registry import write_blocks as write_blocks
from .formats.registry import write_recording as write_recording
from .index import declared_classes as declared_classes
from .index import open_recordings as open_recordings
from .index import read_recordings as read_recordings
from .index import save_index as save_index
from .index import source_files as source_files
from .index import write_index as write_index
from .proposal import propose_index as propose_index
from .recording import Recording as Recording
from .recording import joined as joined
from .recording import select as select
from .series import write_series as write_series
from .store import is_store as is_store
from .store import open_store as open_store
from .store import write_store as write_store
from .stored import BLOCK as BLOCK
from .stored import StoredRecording as StoredRecording
from .stored import opened as opened
from .subset_index import narrow_index as narrow_index

__all__ = [
    "BLOCK",
    "WRITABLE",
    "Entry",
    "InspectionReport",
    "Options",
    "Recording",
    "RecordingReport",
    "StoredRecording",
    "clipped_readings",
    "declared_classes",
    "inspect_recording",
    "inspect_recordings",
    "is_store",
    "joined",
    "narrow_index",
    "open_recording",
    "open_recordings",
    "open_store",
    "opened",
    "propose_index",
    "read_raw",
    "read_recording",
    "read_recordings",
    "recording_from",
    "refuse_unfit",
    "require_room",
    "save_index",
    "select",
    "source_files",
    "stated_speed",
    "stem_of",
    "suffix_of",
    "write_blocks",
    "write_index",
    "write_recording",
    "write_series",
    "write_store",
]
