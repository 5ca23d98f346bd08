"""TDMS files of National Instruments."""

import logging
from collections.abc import Mapping
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from swashtwin.foundation import DataError, load_extra
from swashtwin.recordings.formats.clock import TIME_UNITS, extract_time
from swashtwin.recordings.formats.columns import Column, LazyColumn, slice_column
from swashtwin.recordings.formats.headings import header_rate, read_sensitivities
from swashtwin.recordings.formats.raw_file import RawFile, ReadOptions, snap_rate
from swashtwin.recordings.formats.sample_units import recognize_unit
from swashtwin.recordings.recording import Recording

nptdms: Any = load_extra("nptdms", "readers", "a TDMS file")

_UNIT_PROPERTIES = ("unit_string", "NI_UnitDescription", "NI_ChannelUnit")
_CLOCK_PROPERTIES = ("wf_start_time", "wf_start_offset", "wf_increment")


def read(path: Path, options: ReadOptions) -> RawFile:
    """Channels of a TDMS file, called ``group/channel`` where it has several groups.

    Scales are applied by npTDMS; one that it does not know is refused. Recordings that were
    appended to one channel, with another start or rate, are columns of their own, called ``channel
    [1]``, ``channel [2]``, ...
    """
    nptdms = _noting_nptdms()
    _warnings.clear()
    file = nptdms.TdmsFile.open(path)
    if file.file_status.incomplete_final_segment:
        raise DataError(f"{path} is cut off: its last segment is incomplete.")
    raw = extract_time(path, _columns(path, file, file._reader.history), options)
    if unknown := [text for text in _warnings if "scal" in text.lower()]:
        raise DataError(
            f"{path}: {unknown[0]}; it cannot be applied, so export the scaled samples."
        )
    return raw


_warnings: list[str] = []
"""What npTDMS has warned of, such as that it leaves out a scale."""


@cache
def _noting_nptdms() -> Any:
    """npTDMS, whose warnings are noted, and for each channel its properties with the sample from
    which they hold.

    The library itself keeps the last properties only. Its module is changed for all that this
    process reads, which is one file at a time.
    """
    handler = logging.Handler(logging.WARNING)
    handler.emit = lambda record: _warnings.append(record.getMessage())  # type: ignore[method-assign]
    logging.getLogger("nptdms").addHandler(handler)

    base: Any = nptdms.reader.TdmsReader

    class Reader(base):
        def __init__(self, file: Any) -> None:
            self.history: dict[str, list[tuple[int, dict[str, Any]]]] = {}
            self._counts: dict[str, int] = {}
            super().__init__(file)

        def _update_object_metadata(self, segment: Any) -> None:
            self._counts = {path: item.num_values for path, item in self.object_metadata.items()}
            super()._update_object_metadata(segment)

        def _update_object_properties(self, values: Any) -> None:
            super()._update_object_properties(values)
            for path, pairs in (values or {}).items():
                known = self.history.setdefault(path, [])
                known.append(
                    (self._counts.get(path, 0), (known[-1][1] if known else {}) | dict(pairs))
                )

    nptdms.tdms.TdmsReader = Reader
    return nptdms


def _columns(
    path: Path, file: Any, history: dict[str, list[tuple[int, dict[str, Any]]]]
) -> RawFile:
    groups, size = file.groups(), 0
    columns: dict[str, Column] = {}
    stated: dict[str, tuple[str, dict[str, Any], Any]] = {}
    for group in groups:
        for channel in group.channels():
            kind = channel.dtype.kind
            if kind == "V":
                raise DataError(
                    f"{path}: {channel.name!r} holds raw data of DAQmx and no scale; export it scaled."
                )
            if len(channel) < 2 or kind not in "fiuM":
                continue
            size += len(channel) * (getattr(channel.data_type, "size", None) or 1)
            name = channel.name if len(groups) == 1 else f"{group.name}/{channel.name}"
            parts = _parts(history.get(channel.path, []), channel)
            for number, (start, stop, properties) in enumerate(parts, 1):
                key = name if len(parts) == 1 else f"{name} [{number}]"
                columns[key] = slice_column(
                    LazyColumn(partial(_samples, channel), len(channel)), start, stop
                )
                stated[key] = kind, properties, group
    if size > path.stat().st_size:
        raise DataError(
            f"{path} is damaged: its channels state {size} bytes, it has {path.stat().st_size}."
        )
    raw = RawFile(columns, attributes={name: str(value) for name, value in file.properties.items()})
    return _with_facts(path, raw, stated, file)


def _with_facts(
    path: Path, raw: RawFile, stated: Mapping[str, tuple[str, dict[str, Any], Any]], file: Any
) -> RawFile:
    units, rates, starts, moments, sensitivities = {}, {}, {}, {}, {}  # type: ignore[var-annotated]
    for key, (kind, properties, group) in stated.items():
        pairs = [(name, str(value)) for name, value in properties.items()]
        texts = [
            text
            for name, text in pairs
            if name in _UNIT_PROPERTIES or name.lower() in ("unit", "units")
        ]
        if unit := "ns" if kind == "M" else next(filter(None, map(recognize_unit, texts)), None):
            units[key] = unit
        if (along := recognize_unit(properties.get("wf_xunit_string", ""))) not in (
            None,
            *TIME_UNITS,
        ):
            raise DataError(
                f"{path}: {key!r} runs along {along}, not time; export it as it was recorded."
            )
        step = float(properties.get("wf_increment") or 0.0)
        around = (
            (name, str(value)) for of in (group, file) for name, value in of.properties.items()
        )
        if rate := snap_rate(step, 1e-9) if step > 0 else header_rate(pairs) or header_rate(around):
            rates[key] = rate
        if texts := read_sensitivities(pairs):
            sensitivities[key] = texts[0]
        if (moment := _moment(properties)) is not None:
            near = np.timedelta64(round(1e6 * step), "us")  # less than a sample apart is together
            same = next(
                (starts[other] for other, known in moments.items() if abs(known - moment) < near),
                None,
            )
            starts[key], moments[key] = same or str(moment).removeprefix("1970-01-01T"), moment
    return replace(raw, units=units, rates=rates, starts=starts, sensitivities=sensitivities)


def _moment(properties: dict[str, Any]) -> np.datetime64 | None:
    """When the first sample was taken, after 1970 where only an offset is stated, or None."""
    start = properties.get(
        "wf_start_time", np.datetime64(0, "us") if "wf_start_offset" in properties else None
    )
    if start is None:
        return None
    start = start.as_datetime64() if hasattr(start, "as_datetime64") else start
    return np.datetime64(start, "us") + np.timedelta64(
        round(1e6 * float(properties.get("wf_start_offset", 0.0))), "us"
    )


def _parts(
    history: list[tuple[int, dict[str, Any]]], channel: Any
) -> list[tuple[int, int, dict[str, Any]]]:
    """First sample, last sample and properties of each recording of a channel: a new one has
    another clock.
    """
    parts: list[tuple[int, dict[str, Any]]] = []
    for at, properties in history:
        clock = {name: properties.get(name) for name in _CLOCK_PROPERTIES}
        if not parts or at == parts[-1][0]:
            parts = (
                [(0 if not parts else at, properties)]
                if len(parts) < 2
                else [*parts[:-1], (at, properties)]
            )
            continue
        first, last = parts[-1]
        if clock == {name: last.get(name) for name in _CLOCK_PROPERTIES}:
            continue
        begun, now, step = (
            _moment(last),
            _moment(properties),
            float(last.get("wf_increment") or 0.0),
        )
        same_rate = step == float(properties.get("wf_increment") or 0.0)
        if same_rate and begun is not None and now is not None:
            late = (now - begun) / np.timedelta64(1, "s") - (at - first) * step
            if abs(late) <= max(step, 1e-3):
                continue  # it goes on without a gap
        parts.append((at, properties))
    parts = [(at, properties) for at, properties in parts if at < len(channel)] or [
        (0, dict(channel.properties))
    ]
    ends = [at for at, _ in parts[1:]] + [len(channel)]
    return [(at, end, properties) for (at, properties), end in zip(parts, ends, strict=True)]


def _samples(channel: Any, start: int, stop: int) -> np.ndarray:
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
        nptdms.ChannelObject("recording", name, np.ascontiguousarray(row), properties=properties)
        for name, row in zip(recording.channels, recording.signal, strict=True)
    ]
    with nptdms.TdmsWriter(str(path)) as writer:
        writer.write_segment(channels)
