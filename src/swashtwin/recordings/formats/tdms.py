"""TDMS files of National Instruments."""

import logging
import weakref
from pathlib import Path
from typing import Any

import numpy as np

from swashtwin.foundation import DataError
from swashtwin.recordings.columns import Column
from swashtwin.recordings.formats.raw import Options, RawFile, known_unit, load_extra, snapped_rate
from swashtwin.recordings.recording import Recording

_UNIT_PROPERTIES = ("unit_string", "NI_UnitDescription", "Unit")


def read(path: Path, options: Options) -> RawFile:
    """Channels of a TDMS file, called ``group/channel`` where it has several groups."""
    nptdms = load_extra("nptdms")
    for name in ("reader", "types", "tdms_segment", "base_segment", "tdms"):
        logging.getLogger(f"nptdms.{name}").setLevel(logging.CRITICAL)  # damage is refused below
    stream = path.open("rb")
    try:
        file = nptdms.TdmsFile.open(stream)
        if file.file_status.incomplete_final_segment:
            raise DataError(f"{path} is cut off: its last segment is incomplete.")
        raw = _columns(path, file)
    except BaseException:
        stream.close()
        raise
    weakref.finalize(file, stream.close)
    return raw


def _columns(path: Path, file: Any) -> RawFile:
    groups = file.groups()
    columns: dict[str, Column] = {}
    units: dict[str, str] = {}
    rates: dict[str, float] = {}
    size = 0
    for group in groups:
        for channel in group.channels():
            if len(channel) < 2 or channel.dtype.kind not in "fiu":
                continue
            size += len(channel) * channel.dtype.itemsize
            name = channel.name if len(groups) == 1 else f"{group.name}/{channel.name}"
            columns[name] = _Channel(file, channel)
            unit = next(filter(None, (known_unit(channel.properties.get(key, "")) for key in _UNIT_PROPERTIES)), None)
            if unit:
                units[name] = unit
            if step := float(channel.properties.get("wf_increment", 0.0)):
                rates[name] = snapped_rate(step, 1e-9)
    if size > path.stat().st_size:
        raise DataError(f"{path} is damaged: its channels state {size} bytes, it has {path.stat().st_size}.")
    facts = {name: str(value) for name, value in file.properties.items()}
    return RawFile(columns, None, units, facts, rates=rates)


class _Channel:
    """Samples of one channel, which keep their file open."""

    def __init__(self, file: Any, channel: Any) -> None:
        self._file = file
        self._channel = channel

    def __len__(self) -> int:
        return len(self._channel)

    def __getitem__(self, span: slice, /) -> np.ndarray:
        start, stop, step = span.indices(len(self))
        return np.asarray(self._channel[start:stop], dtype=np.float64)[::step]


def write(recording: Recording, path: Path) -> None:
    """Write one group of double channels with rate and unit."""
    nptdms = load_extra("nptdms")
    properties = {"wf_increment": 1 / recording.sample_rate, "wf_start_offset": 0.0, "unit_string": recording.unit}
    channels = [
        nptdms.ChannelObject("recording", name, np.ascontiguousarray(row), properties=properties)
        for name, row in zip(recording.channels, recording.signal, strict=True)
    ]
    with nptdms.TdmsWriter(str(path)) as writer:
        writer.write_segment(channels)
