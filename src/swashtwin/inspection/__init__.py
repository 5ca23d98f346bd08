"""Is a measurement fit to learn from? What a careful person would look for before using it."""

from swashtwin.inspection.channels import clipped_readings
from swashtwin.inspection.findings import ChannelReport, Finding, InspectionReport, RecordingReport
from swashtwin.inspection.fitness import refuse_unfit, stated_speed
from swashtwin.inspection.inspecting import inspect_recording, inspect_recordings

__all__ = [
    "ChannelReport",
    "Finding",
    "InspectionReport",
    "RecordingReport",
    "clipped_readings",
    "inspect_recording",
    "inspect_recordings",
    "refuse_unfit",
    "stated_speed",
]
