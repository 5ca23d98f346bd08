"""Measurement data format of ASAM, versions 3 and 4, as vehicles and test benches record it."""

from pathlib import Path

import numpy as np

from swashtwin.foundation import DataError, require_memory
from swashtwin.recordings.formats.clock import read_time_column
from swashtwin.recordings.formats.raw import Options, RawFile, known_unit, load_extra
from swashtwin.recordings.recording import Recording

_COUNTED = {2: "angle", 3: "distance", 4: "samples"}
"""What a master channel that is no time counts, by its kind of synchronization."""


def read(path: Path, options: Options) -> RawFile:
    """Channels of numbers of every group, whose master channel (the time) gives their rate.

    A name that stands in several groups is called ``GROUP/NAME``, with the group's number from 0.
    """
    asammdf = load_extra("asammdf", "mdf")
    columns: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}
    rates: dict[str, float] = {}
    gaps: dict[str, str] = {}
    starts: dict[str, str] = {}
    starts_of: dict[int, str] = {}
    with path.open("rb") as stream, asammdf.MDF(stream) as file:
        names = [channel.name for group in file.groups for channel in group.channels]
        require_memory(path, sum(8 * group.channel_group.cycles_nr * len(group.channels) for group in file.groups))
        for number, group in enumerate(file.groups):
            master = file.masters_db.get(number)
            counted = None if master is None else _COUNTED.get(getattr(group.channels[master], "sync_type", 1))
            if counted:
                raise DataError(
                    f"{path}: the master {group.channels[master].name!r} of group {number} counts {counted}, not time; "
                    "export the group with its time."
                )
            for position, channel in enumerate(group.channels):
                if position == master:
                    continue
                signal = file.get(group=number, index=position, ignore_invalidation_bits=True)
                if signal.samples.ndim != 1 or signal.samples.dtype.kind not in "fiu" or len(signal.samples) < 2:
                    continue
                name = channel.name if names.count(channel.name) == 1 else f"{number}/{channel.name}"
                columns[name] = signal.samples.astype(np.float64)
                if (invalid := getattr(signal, "invalidation_bits", None)) is not None:
                    columns[name][np.asarray(invalid, dtype=bool)] = np.nan
                if unit := known_unit(signal.unit):
                    units[name] = unit
                if master is not None:
                    if number not in starts_of and len(signal.timestamps):
                        starts_of[number] = f"{float(signal.timestamps[0]):.6g} s"
                    starts[name] = starts_of.get(number, "")
                    rate, gap = read_time_column(path, np.asarray(signal.timestamps, dtype=np.float64))
                    rates |= {name: rate} if rate else {}
                    gaps |= {"time_gaps": gap} if gap else {}
        start = str(file.start_time)
    return RawFile(columns, None, units, {"start_time": start, **gaps}, rates=rates, starts=starts)


def write(recording: Recording, path: Path) -> None:
    """Write one group of doubles with its time, version 4.10."""
    asammdf = load_extra("asammdf", "mdf")
    time = recording.time
    with asammdf.MDF(version="4.10") as file:
        signals = [
            asammdf.Signal(np.ascontiguousarray(row), timestamps=time, name=name, unit=recording.unit)
            for name, row in zip(recording.channels, recording.signal, strict=True)
        ]
        file.append(signals)
        file.save(path, overwrite=True)
