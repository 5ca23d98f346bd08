"""Windows that are learnt from: cut from recordings, and split by recording, never by window."""

from swashtwin.windows.cutting import cut_windows, window_batches
from swashtwin.windows.folding import group_folds, without_overlap
from swashtwin.windows.grouping import recording_groups
from swashtwin.windows.saving import load_windows, save_windows
from swashtwin.windows.splitting import check_disjoint, hold_out, hold_out_specimens, split_by_recording
from swashtwin.windows.window_set import WindowLayout, WindowSet

__all__ = [
    "WindowLayout",
    "WindowSet",
    "check_disjoint",
    "cut_windows",
    "group_folds",
    "hold_out",
    "hold_out_specimens",
    "load_windows",
    "recording_groups",
    "save_windows",
    "split_by_recording",
    "window_batches",
    "without_overlap",
]
