"""Measurement data format of ASAM, versions 3 and 4, as vehicles and test benches record it."""

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from swashtwin.foundation import DataError, load_extra
from swashtwin.recordings.formats.clock import TIME_UNITS
from swashtwin.recordings.formats.column_names import is_foreign_unit
from swashtwin.recordings.formats.raw_file import RawFile, ReadOptions
from swashtwin.recordings.formats.sample_units import recognize_unit
from swashtwin.recordings.formats.time_column import read_time_column
from swashtwin.recordings.recording import Recording

asammdf: Any = load_extra("asammdf", "mdf", "an MDF file")

# Quantity of a master channel that is not the time, by its kind of synchronization.
_MASTER_QUANTITIES = {2: "angle", 3: "distance", 4: "samples"}


def read(path: Path, options: ReadOptions) -> RawFile:
    """Return channels of numbers of every group, with the rate by the group's master channel.

    A name that occurs in several groups becomes ``GROUP/NAME``, with the group's number from 0.
    """
    content = _Content(path)
    with path.open("rb") as stream, asammdf.MDF(stream) as file:
        channels = [channel for group in file.groups for channel in group.channels]
        name_counts = Counter(channel.name for channel in channels)
        for number in range(len(file.groups)):
            content.add_group(file, number, name_counts, options)
        start_time = str(file.start_time)

    attributes = {**content.problems, "start_time": start_time}
    return RawFile(
        content.columns,
        None,
        content.units,
        attributes,
        rates=content.rates,
        starts=content.starts,
        foreign_units=content.foreign_units,
    )


class _Content:
    """Channels of the groups that were added."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.columns: dict[str, np.ndarray] = {}
        self.units: dict[str, str] = {}
        self.foreign_units: dict[str, str] = {}
        self.rates: dict[str, float] = {}
        self.starts: dict[str, str] = {}
        self.problems: dict[str, str] = {}

    def add_group(
        self, file: Any, number: int, name_counts: Counter[str], options: ReadOptions
    ) -> None:
        group = file.groups[number]
        master = file.masters_db.get(number)
        is_timed = master is not None and _is_time(
            self._path, number, group.channels[master], options
        )

        rate: float | None = None
        for index, channel in enumerate(group.channels):
            if index == master:
                continue
            signal = file.get(group=number, index=index, ignore_invalidation_bits=True)
            samples = signal.samples
            if samples.ndim != 1 or samples.dtype.kind not in "fiu" or len(samples) < 2:
                continue

            is_unique = name_counts[channel.name] == 1
            name = channel.name if is_unique else f"{number}/{channel.name}"
            self.columns[name] = samples.astype(np.float64)
            if signal.invalidation_bits is not None:
                is_invalid = np.asarray(signal.invalidation_bits, dtype=bool)
                self.columns[name][is_invalid] = np.nan
            self._add_unit(name, signal.unit)

            if not is_timed:
                continue
            if rate is None:  # the channels of a group share their time
                times = np.asarray(signal.timestamps, dtype=np.float64)
                rate, problem = read_time_column(self._path, times)
                if problem:
                    self.problems["time_gaps"] = problem
            if rate:
                self.rates[name] = rate
            self.starts[name] = self._start(float(signal.timestamps[0]), rate)

    def _add_unit(self, name: str, text: str) -> None:
        unit = recognize_unit(text)
        if unit:
            self.units[name] = unit
        elif is_foreign_unit(text):
            self.foreign_units[name] = text

    def _start(self, start: float, rate: float | None) -> str:
        """Return a start [s] as text; that of another channel if it is less than a sample away."""
        for text in self.starts.values():
            if abs(float(text.removesuffix(" s")) - start) < 1 / (rate or np.inf):
                return text
        return f"{start:.9g} s"


def _is_time(path: Path, group: int, master: Any, options: ReadOptions) -> bool:
    """Return whether a master channel is the time, or counts samples of a specified rate.

    Raises
    ------
    DataError
        It is another quantity.
    """
    quantity = _MASTER_QUANTITIES.get(getattr(master, "sync_type", 1))
    unit = recognize_unit(master.unit or "")
    if quantity is None and unit not in (None, *TIME_UNITS):
        quantity = unit
    if quantity is None:
        return True
    if quantity == "samples" and options.sample_rate is not None:
        return False

    message = f"{path}: the master {master.name!r} of group {group} counts {quantity}, not time."
    if quantity == "samples":
        raise DataError(
            message,
            field="sample_rate",
            remedy="Add {sample_rate='25.6 kHz'} (or whatever it was).",
        )
    raise DataError(f"{message} Export the group with its time.")


def write(recording: Recording, path: Path) -> None:
    """Write one group of doubles with its time, version 4.10."""
    signals = [
        asammdf.Signal(
            np.ascontiguousarray(samples),
            timestamps=recording.time,
            name=name,
            unit=recording.unit,
        )
        for name, samples in zip(recording.channels, recording.signal, strict=True)
    ]
    with asammdf.MDF(version="4.10") as file:
        file.append(signals)
        file.save(path, overwrite=True)
