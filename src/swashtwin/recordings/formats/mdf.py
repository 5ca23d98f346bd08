"""Measurement data format of ASAM, versions 3 and 4, as vehicles and test benches record it."""

from pathlib import Path
from typing import Any

import numpy as np

from swashtwin.foundation import DataError, load_extra
from swashtwin.recordings.formats.clock import TIME_UNITS
from swashtwin.recordings.formats.raw_file import RawFile, ReadOptions
from swashtwin.recordings.formats.sample_units import recognize_unit
from swashtwin.recordings.formats.time_column import read_time_column
from swashtwin.recordings.recording import Recording

asammdf: Any = load_extra("asammdf", "mdf", "an MDF file")

_COUNTED = {2: "angle", 3: "distance", 4: "samples"}
"""What a master channel that is no time counts, by its kind of synchronization."""


def read(path: Path, options: ReadOptions) -> RawFile:
    """Channels of numbers of every group, whose master channel (the time) gives their rate.

    A name that stands in several groups is called ``GROUP/NAME``, with the group's number from 0.
    """
    columns: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}
    rates: dict[str, float] = {}
    gaps: dict[str, str] = {}
    starts: dict[str, str] = {}
    with path.open("rb") as stream, asammdf.MDF(stream) as file:
        names = [channel.name for group in file.groups for channel in group.channels]
        for number, group in enumerate(file.groups):
            master = file.masters_db.get(number)
            is_timed = master is not None and _is_time(
                path, number, group.channels[master], options
            )
            rate: float | None = None
            for position, channel in enumerate(group.channels):
                if position == master:
                    continue
                signal = file.get(group=number, index=position, ignore_invalidation_bits=True)
                if (
                    signal.samples.ndim != 1
                    or signal.samples.dtype.kind not in "fiu"
                    or len(signal.samples) < 2
                ):
                    continue
                name = (
                    channel.name if names.count(channel.name) == 1 else f"{number}/{channel.name}"
                )
                columns[name] = signal.samples.astype(np.float64)
                if signal.invalidation_bits is not None:
                    columns[name][np.asarray(signal.invalidation_bits, dtype=bool)] = np.nan
                if unit := recognize_unit(signal.unit):
                    units[name] = unit
                if is_timed and rate is None:
                    rate, gap = read_time_column(
                        path, np.asarray(signal.timestamps, dtype=np.float64)
                    )
                    gaps |= {"time_gaps": gap} if gap else {}
                    start = float(signal.timestamps[0])
                if is_timed:
                    rates |= {name: rate} if rate else {}
                    near = (
                        text
                        for text in starts.values()
                        if abs(float(text[:-2]) - start) < 1 / (rate or np.inf)
                    )
                    starts[name] = next(
                        near, f"{start:.9g} s"
                    )  # less than a sample apart is together
        gaps["start_time"] = str(file.start_time)
    return RawFile(columns, None, units, gaps, rates=rates, starts=starts)


def _is_time(path: Path, group: int, master: Any, options: ReadOptions) -> bool:
    counted, unit = _COUNTED.get(getattr(master, "sync_type", 1)), recognize_unit(master.unit or "")
    if counted is None and unit not in (None, *TIME_UNITS):
        counted = unit
    if counted is not None and (counted != "samples" or options.sample_rate is None):
        advice = (
            'add sample_rate = "25.6 kHz" (or whatever it was)'
            if counted == "samples"
            else "export the group with its time"
        )
        raise DataError(
            f"{path}: the master {master.name!r} of group {group} counts {counted}, not time; {advice}."
        )
    return counted is None


def write(recording: Recording, path: Path) -> None:
    """Write one group of doubles with its time, version 4.10."""
    time = recording.time
    with asammdf.MDF(version="4.10") as file:
        signals = [
            asammdf.Signal(
                np.ascontiguousarray(row), timestamps=time, name=name, unit=recording.unit
            )
            for name, row in zip(recording.channels, recording.signal, strict=True)
        ]
        file.append(signals)
        file.save(path, overwrite=True)
