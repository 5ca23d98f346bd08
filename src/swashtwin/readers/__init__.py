"""Recordings from files of ten formats, and one index that says what each file is.

A folder of measurements becomes a data set by one file, ``recordings.toml``::

    format = 1
    classes = ["normal", "swash_plate"]

    [defaults]                        # any key of an entry, for every entry that lacks it
    sample_rate = "25.6 kHz"
    unit = "g"

    [[recording]]
    file = "A01/normal_1.mat"
    label = "normal"
    specimen = "A"
    speed = "860 rpm"
    discharge_pressure = "15 MPa"
    channels = ["X105_DE_time"]       # names, patterns such as "*_DE_time", or numbers from 0
    names = ["drive_end"]
"""

from swashtwin.readers.assembly import open_recording, read_recording
from swashtwin.readers.entry import Entry
from swashtwin.readers.formats import SUFFIXES, WRITABLE, write_blocks, write_recording
from swashtwin.readers.index import (
    declared_classes,
    open_recordings,
    read_recordings,
    save_index,
    source_files,
    write_index,
)
from swashtwin.readers.narrowing import narrow_index
from swashtwin.readers.proposal import IndexProposal, propose_index
from swashtwin.readers.public_sets import PUBLIC_SETS, read_public_set
from swashtwin.readers.room import require_room
from swashtwin.readers.series import write_series
from swashtwin.readers.store import is_store, open_store, write_store

__all__ = [
    "PUBLIC_SETS",
    "SUFFIXES",
    "WRITABLE",
    "Entry",
    "IndexProposal",
    "declared_classes",
    "is_store",
    "narrow_index",
    "open_recording",
    "open_recordings",
    "open_store",
    "propose_index",
    "read_public_set",
    "read_recording",
    "read_recordings",
    "require_room",
    "save_index",
    "source_files",
    "write_blocks",
    "write_index",
    "write_recording",
    "write_series",
    "write_store",
]
