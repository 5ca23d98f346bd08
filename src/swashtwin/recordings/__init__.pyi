"""Names that other rooms import, and where each lives."""

from .checks.channels import clipped_samples as clipped_samples
from .checks.channels import refuse_unfit as refuse_unfit
from .checks.comparison import inspect_recording as inspect_recording
from .checks.comparison import inspect_recordings as inspect_recordings
from .checks.comparison import layout_findings as layout_findings
from .checks.comparison import several_healthy as several_healthy
from .checks.comparison import usual_window as usual_window
from .checks.comparison import window_findings as window_findings
from .checks.findings import Finding as Finding
from .checks.findings import InspectionReport as InspectionReport
from .checks.findings import RecordingReport as RecordingReport
from .collection import Recordings as Recordings
from .collection import load_recordings as load_recordings
from .columns import BLOCK as BLOCK
from .entry import Entry as Entry
from .facts import RecordingFacts as RecordingFacts
from .facts import facts_of as facts_of
from .formats.raw import RATES as RATES
from .formats.raw import Options as Options
from .formats.raw import RawFile as RawFile
from .formats.raw import acceleration_factor as acceleration_factor
from .formats.raw import require_sample_unit as require_sample_unit
from .formats.registry import WRITABLE as WRITABLE
from .formats.registry import open_raw as open_raw
from .formats.registry import register_format as register_format
from .formats.registry import stem_of as stem_of
from .formats.registry import suffix_of as suffix_of
from .formats.registry import suffixes as suffixes
from .formats.registry import write_blocks as write_blocks
from .formats.registry import write_recording as write_recording
from .grouping import GROUPS as GROUPS
from .grouping import best_test_rows as best_test_rows
from .grouping import condition_names as condition_names
from .grouping import no_group as no_group
from .grouping import recording_groups as recording_groups
from .grouping import stated_pressure as stated_pressure
from .grouping import stated_speed as stated_speed
from .index import declared_classes as declared_classes
from .index import narrow_index as narrow_index
from .index import save_index as save_index
from .index import source_files as source_files
from .index import write_index as write_index
from .loading import load_recording as load_recording
from .loading import recording_of as recording_of
from .manifest import Manifest as Manifest
from .manifest import join_manifests as join_manifests
from .manifest import manifest_of as manifest_of
from .manifest import repeated_recordings as repeated_recordings
from .manifest import say_seen as say_seen
from .manifest import seen_recordings as seen_recordings
from .proposal import propose_index as propose_index
from .recording import Recording as Recording
from .recording import join_blocks as join_blocks
from .samples import rises_evenly as rises_evenly
from .store import is_store as is_store
from .store import write_series as write_series
from .store import write_store as write_store

__all__ = [
    "BLOCK",
    "GROUPS",
    "RATES",
    "WRITABLE",
    "Entry",
    "Finding",
    "InspectionReport",
    "Manifest",
    "Options",
    "RawFile",
    "Recording",
    "RecordingFacts",
    "RecordingReport",
    "Recordings",
    "acceleration_factor",
    "best_test_rows",
    "clipped_samples",
    "condition_names",
    "declared_classes",
    "facts_of",
    "inspect_recording",
    "inspect_recordings",
    "is_store",
    "join_blocks",
    "join_manifests",
    "layout_findings",
    "load_recording",
    "load_recordings",
    "manifest_of",
    "narrow_index",
    "no_group",
    "open_raw",
    "propose_index",
    "recording_groups",
    "recording_of",
    "refuse_unfit",
    "register_format",
    "repeated_recordings",
    "require_sample_unit",
    "rises_evenly",
    "save_index",
    "say_seen",
    "seen_recordings",
    "several_healthy",
    "source_files",
    "stated_pressure",
    "stated_speed",
    "stem_of",
    "suffix_of",
    "suffixes",
    "usual_window",
    "window_findings",
    "write_blocks",
    "write_index",
    "write_recording",
    "write_series",
    "write_store",
]
