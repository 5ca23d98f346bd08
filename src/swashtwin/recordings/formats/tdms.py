"""TDMS files of National Instruments."""

import logging
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from swashtwin.foundation import DataError, load_extra
from swashtwin.recordings.columns import Column, LazyColumn, slice_column
from swashtwin.recordings.formats.clock import TIME_UNITS, extract_time
from swashtwin.recordings.formats.column_names import is_foreign_unit
from swashtwin.recordings.formats.headings import header_rate, read_sensitivities
from swashtwin.recordings.formats.raw_file import UNCLOSED, RawFile, ReadOptions, snap_rate
from swashtwin.recordings.formats.sample_units import recognize_unit
from swashtwin.recordings.recording import Recording

nptdms: Any = load_extra("nptdms", "readers", "a TDMS file")

_UNIT_PROPERTIES = ("unit_string", "NI_UnitDescription", "NI_ChannelUnit")
_CLOCK_PROPERTIES = ("wf_start_time", "wf_start_offset", "wf_increment")

# Scales whose result is in the unit of the channel: those of sensors give other quantities.
_KNOWN_SCALES = ("Linear", "Polynomial", "Table", "Add", "Subtract", "AdvancedAPI")
_SCALE_TYPE = re.compile(r"NI_Scale\[\d+\]_Scale_Type")

# Place of the length in a segment [byte], and the length that a recorder writes before it is known.
_LENGTH_OFFSET = 12
_UNKNOWN_LENGTH = b"\xff" * 8

# Gap between two parts of a channel up to which the second continues the first.
_MAX_GAP_S = 1e-3

History = list[tuple[int, dict[str, Any]]]
"""Properties of a channel, each with the sample from which they hold."""


@dataclass(frozen=True)
class _Part:
    """One recording of a channel, of several that were appended to each other."""

    start: int
    stop: int
    properties: dict[str, Any]


def read(path: Path, options: ReadOptions) -> RawFile:
    """Return the channels of a TDMS file, as ``group/channel`` if it has several groups.

    npTDMS applies scales; one of another quantity, such as a strain, is excluded by its name.
    Recordings that were appended to one channel, with another start or rate, are columns
    ``channel [1]``, ``channel [2]``, ... A file that its recorder never closed is read to its end.
    """
    nptdms = _patched_nptdms()
    _warnings.clear()
    file = nptdms.TdmsFile.open(path)
    is_unclosed = _is_unclosed(path, file)
    if file.file_status.incomplete_final_segment and not is_unclosed:
        raise DataError(f"{path} is cut off: its last segment is incomplete.")

    raw = extract_time(path, _read_channels(path, file, options), options)
    if is_unclosed or any("metadata is incomplete" in text for text in _warnings):
        raw = replace(raw, attributes={**raw.attributes, UNCLOSED: "its end may be missing"})
    scale_warnings = [text for text in _warnings if "scal" in text.lower()]
    if scale_warnings:
        raise DataError(
            f"{path}: {scale_warnings[0]}; it cannot be applied, so export the scaled samples."
        )
    return raw


# Warnings of npTDMS, such as that it ignores a scale.
_warnings: list[str] = []


@cache
def _patched_nptdms() -> Any:
    """Return npTDMS with its warnings kept, and with the history of each channel's properties.

    The library keeps only the last properties. Its module is changed for all that this process
    reads, which is one file at a time.
    """
    handler = logging.Handler(logging.WARNING)
    handler.emit = lambda record: _warnings.append(record.getMessage())  # type: ignore[method-assign]
    logging.getLogger("nptdms").addHandler(handler)

    base: Any = nptdms.reader.TdmsReader

    class Reader(base):  # type: ignore[misc]  # the library has no types
        def __init__(self, file: Any) -> None:
            self.history: dict[str, History] = {}
            self._sample_counts: dict[str, int] = {}
            super().__init__(file)

        def _update_object_metadata(self, segment: Any) -> None:
            self._sample_counts = {
                path: metadata.num_values for path, metadata in self.object_metadata.items()
            }
            super()._update_object_metadata(segment)

        def _update_object_properties(self, values: Any) -> None:
            super()._update_object_properties(values)
            for path, changes in (values or {}).items():
                history = self.history.setdefault(path, [])
                properties = history[-1][1] if history else {}
                history.append((self._sample_counts.get(path, 0), properties | dict(changes)))

    nptdms.tdms.TdmsReader = Reader
    return nptdms


def _is_unclosed(path: Path, file: Any) -> bool:
    """Return whether the last segment does not state its length, as after a crash."""
    if not file._reader._segments:
        return False
    with path.open("rb") as content:
        content.seek(file._reader._segments[-1].position + _LENGTH_OFFSET)
        return content.read(len(_UNKNOWN_LENGTH)) == _UNKNOWN_LENGTH


def _common_length(file: Any, channel: Any) -> int:
    """Return the samples of a channel that the others have, too, if the last block is unfinished.

    A block holds the samples of one channel after those of another: an unfinished one has all of
    the first, and some of the last.
    """
    length = len(channel)
    segment = file._reader._segments[-1]
    counts = dict(segment.final_chunk_lengths_override or {})
    expected = {item.path: item.number_values for item in segment.ordered_objects if item.has_data}
    if (
        channel.path not in counts
        or len(set(expected.values())) != 1
        or len(counts) < len(expected)
    ):
        return length
    return int(length - counts[channel.path] + min(counts.values()))


def _unknown_scale(channel: Any, group: Any, file: Any) -> str:
    """Return the kind of a channel's scale that is not one of numbers, or an empty text."""
    properties = {**file.properties, **group.properties, **channel.properties}
    for name, kind in properties.items():
        if _SCALE_TYPE.fullmatch(name) and str(kind) not in _KNOWN_SCALES:
            return str(kind)
    return ""


def _without_unknown_scales(
    path: Path, channels: Sequence[tuple[Any, Any]], file: Any, options: ReadOptions
) -> tuple[list[tuple[Any, Any]], list[str]]:
    """Return the groups and channels whose scales are known, and the names of the others.

    Raises
    ------
    DataError
        A channel that the options select has an unknown scale, or all have.
    """
    known: list[tuple[Any, Any]] = []
    excluded: list[str] = []
    selected = {str(name) for name in options.channels or ()}
    for group, channel in channels:
        kind = _unknown_scale(channel, group, file)
        if not kind:
            known.append((group, channel))
            continue

        excluded.append(f"{channel.name} (scale type {kind})")
        if selected & {channel.name, f"{group.name}/{channel.name}"}:
            raise _scale_error(path, channel.name, kind)
    if excluded and not any(len(channel) > 1 for _, channel in known):
        group, channel = next(pair for pair in channels if pair not in known)
        raise _scale_error(path, channel.name, _unknown_scale(channel, group, file))
    return known, excluded


def _scale_error(path: Path, name: str, kind: str) -> DataError:
    return DataError(
        f"{path}: Unsupported scale type: {kind}, of {name!r}.",
        field="channels",
        remedy="Export the scaled samples, or select other {channels}.",
    )


def _read_channels(path: Path, file: Any, options: ReadOptions) -> RawFile:
    """Return the parts of all channels with the facts that their properties state."""
    history = file._reader.history
    groups = file.groups()
    columns: dict[str, Column] = {}
    facts = _Facts(path, file)
    stated_size = 0
    all_channels = [(group, channel) for group in groups for channel in group.channels()]
    channels, excluded = _without_unknown_scales(path, all_channels, file, options)
    for group, channel in channels:
        kind = channel.dtype.kind
        if kind == "V":
            raise DataError(
                f"{path}: {channel.name!r} holds raw data of DAQmx and no scale; export it scaled."
            )
        length = _common_length(file, channel)
        if length < 2 or kind not in "fiuM":
            continue

        stated_size += len(channel) * (getattr(channel.data_type, "size", None) or 1)
        name = channel.name if len(groups) == 1 else f"{group.name}/{channel.name}"
        samples = LazyColumn(partial(_read_samples, channel), length)
        parts = _split_channel(history.get(channel.path, []), channel, length)
        for number, part in enumerate(parts, 1):
            key = name if len(parts) == 1 else f"{name} [{number}]"
            columns[key] = slice_column(samples, part.start, part.stop)
            facts.add(key, kind, part.properties, group)

    size = path.stat().st_size
    if stated_size > size:
        raise DataError(
            f"{path} is damaged: its channels state {stated_size} bytes, it has {size}."
        )
    # What a group states is a fact of the file if no other group differs.
    properties = {}
    for name in {name: None for group in groups for name in group.properties}:
        values = {str(group.properties.get(name)) for group in groups}
        if len(values) == 1:
            properties[name] = values.pop()
    properties.update({name: str(value) for name, value in file.properties.items()})
    attributes = properties
    if excluded:
        attributes["left_out"] = ", ".join(excluded)
    return replace(
        RawFile(columns, attributes=attributes),
        units=facts.units,
        rates=facts.rates,
        starts=facts.starts,
        foreign_units=facts.foreign_units,
        sensitivities=facts.sensitivities,
    )


class _Facts:
    """Facts that the properties of channels, groups and the file state of the columns."""

    def __init__(self, path: Path, file: Any) -> None:
        self._path = path
        self._file = file
        self._start_times: dict[str, np.datetime64] = {}
        self.units: dict[str, str] = {}
        self.foreign_units: dict[str, str] = {}
        self.rates: dict[str, float] = {}
        self.starts: dict[str, str] = {}
        self.sensitivities: dict[str, str] = {}

    def add(self, key: str, kind: str, properties: dict[str, Any], group: Any) -> None:
        """Add the facts of one column of a number type."""
        time_unit = recognize_unit(properties.get("wf_xunit_string", ""))
        if time_unit not in (None, *TIME_UNITS):
            raise DataError(
                f"{self._path}: {key!r} runs along {time_unit}, not time; "
                "export it as it was recorded."
            )

        unit = "ns" if kind == "M" else _unit_of(properties)
        if unit:
            self.units[key] = unit
        elif foreign_unit := _foreign_unit_of(properties):
            self.foreign_units[key] = foreign_unit

        pairs = [(name, str(value)) for name, value in properties.items()]
        step = float(properties.get("wf_increment") or 0.0)
        rate = snap_rate(step, 1e-9) if step > 0 else header_rate(pairs)
        if not rate:
            outer_pairs = [*group.properties.items(), *self._file.properties.items()]
            rate = header_rate((name, str(value)) for name, value in outer_pairs)
        if rate:
            self.rates[key] = rate

        sensitivities = read_sensitivities(pairs)
        if sensitivities:
            self.sensitivities[key] = sensitivities[0]

        start_time = _start_time(properties)
        if start_time is not None:
            self.starts[key] = self._start(start_time, step)
            self._start_times[key] = start_time

    def _start(self, start_time: np.datetime64, step: float) -> str:
        """Return a start as text; that of another column if it is less than a sample away."""
        tolerance = np.timedelta64(round(1e6 * step), "us")
        for key, other_time in self._start_times.items():
            if abs(other_time - start_time) < tolerance:
                return self.starts[key]
        return str(start_time).removeprefix("1970-01-01T")


def _unit_texts(properties: dict[str, Any]) -> list[str]:
    return [
        str(value)
        for name, value in properties.items()
        if name in _UNIT_PROPERTIES or name.lower() in ("unit", "units")
    ]


def _unit_of(properties: dict[str, Any]) -> str | None:
    units = map(recognize_unit, _unit_texts(properties))
    return next(filter(None, units), None)


def _foreign_unit_of(properties: dict[str, Any]) -> str | None:
    return next(filter(is_foreign_unit, _unit_texts(properties)), None)


def _start_time(properties: dict[str, Any]) -> np.datetime64 | None:
    """Return the time of the first sample, since 1970 if only an offset is stated, or None."""
    default = np.datetime64(0, "us") if "wf_start_offset" in properties else None
    start: Any = properties.get("wf_start_time", default)
    if start is None:
        return None
    if hasattr(start, "as_datetime64"):
        start = start.as_datetime64()
    offset_s = float(properties.get("wf_start_offset", 0.0))
    return np.datetime64(start, "us") + np.timedelta64(round(1e6 * offset_s), "us")


def _split_channel(history: History, channel: Any, length: int) -> list[_Part]:
    """Return the recordings of a channel: a new one begins where its clock changes."""
    starts: History = []
    for sample, properties in history:
        if not starts:
            starts.append((0, properties))
        elif sample == starts[-1][0]:
            starts[-1] = (sample, properties)
        elif not _continues(starts[-1], sample, properties):
            starts.append((sample, properties))

    starts = [(sample, properties) for sample, properties in starts if sample < length]
    if not starts:
        starts = [(0, dict(channel.properties))]
    ends = [sample for sample, _ in starts[1:]] + [length]
    return [
        _Part(start, end, properties) for (start, properties), end in zip(starts, ends, strict=True)
    ]


def _continues(part: tuple[int, dict[str, Any]], sample: int, properties: dict[str, Any]) -> bool:
    """Return whether new properties have the same clock, or continue it without a gap."""
    first_sample, previous = part
    if all(properties.get(name) == previous.get(name) for name in _CLOCK_PROPERTIES):
        return True

    step = float(previous.get("wf_increment") or 0.0)
    if step != float(properties.get("wf_increment") or 0.0):
        return False

    previous_start = _start_time(previous)
    start = _start_time(properties)
    if previous_start is None or start is None:
        return False
    elapsed = (start - previous_start) / np.timedelta64(1, "s")
    return bool(abs(elapsed - (sample - first_sample) * step) <= max(step, _MAX_GAP_S))


def _read_samples(channel: Any, start: int, stop: int) -> np.ndarray:
    """Return samples as doubles, and times as integers [ns]."""
    samples = np.asarray(channel[start:stop])
    if samples.dtype.kind == "M":
        return samples.astype("datetime64[ns]").astype(np.int64)
    return samples.astype(np.float64)


def write(recording: Recording, path: Path) -> None:
    """Write one group of double channels with rate and unit."""
    properties = {
        "wf_increment": 1 / recording.sample_rate,
        "wf_start_offset": 0.0,
        "unit_string": recording.unit,
    }
    channels = [
        nptdms.ChannelObject(
            "recording", name, np.ascontiguousarray(samples), properties=properties
        )
        for name, samples in zip(recording.channels, recording.signal, strict=True)
    ]
    with nptdms.TdmsWriter(str(path)) as writer:
        writer.write_segment(channels)
