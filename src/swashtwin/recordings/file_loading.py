"""A recording from a file and the facts of its index entry."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from math import pi
from pathlib import Path
from typing import Any

from swashtwin.foundation import (
    DataError,
    FileStamp,
    InputError,
    as_path,
    file_stamp,
    parse_quantity,
    plural,
    sha256_of,
)
from swashtwin.pump import OperatingCondition
from swashtwin.recordings.column_roles import describe_excluded
from swashtwin.recordings.column_selection import resolve_sample_rate, select_columns
from swashtwin.recordings.columns import Column
from swashtwin.recordings.entry import CONDITION_FIELDS, QUANTITIES, Entry
from swashtwin.recordings.fact_extraction import (
    describe_contradictions,
    parse_header_facts,
    pressures_without_unit,
)
from swashtwin.recordings.file_formats import open_raw, stem_of
from swashtwin.recordings.formats.raw_file import RawFile, require_unchanged
from swashtwin.recordings.recording import Recording
from swashtwin.recordings.resampling import resample
from swashtwin.recordings.samples import Columns, Samples
from swashtwin.recordings.scaling import resolve_scaling


def load_recording(path: str | Path, **facts: Any) -> Recording:
    """Return the recording of one file, with facts that the file itself does not state.

    Its samples are read on demand. HDF5, TDMS, WAV and Parquet stay on the disk; a file of another
    format is read whole when it is opened.

    Parameters
    ----------
    path : file to open.
    facts : any field of `Entry`: ``sample_rate=25600`` (or ``"25.6 kHz"``), ``unit="g"``,
        ``label="normal"``. Numbers are in SI units.

    Raises
    ------
    DataError
        The file is missing, damaged, or contradicts a fact; or a fact is missing.
    """
    units = {**QUANTITIES, "discharge_pressure": "Pa"}
    for name, unit in units.items():
        if isinstance(facts.get(name), (int, float)):
            facts[name] = f"{float(facts[name])!r} {unit}"

    entry = Entry.from_mapping({"file": str(path), **facts}, "load_recording")
    return load_entry(as_path(path), entry)


def load_entry(path: Path, entry: Entry) -> Recording:
    """Return the recording of the file at `path` with the facts of `entry`."""
    source_name = str(path)
    stamp = file_stamp(path)
    if entry.sha256:
        _require_checksum(path, entry.sha256)

    raw = open_raw(path, entry.options)
    header = _header_facts(raw)
    contradictions = describe_contradictions(entry, header)
    missing_facts: dict[str, Any] = {}
    for key, text in header.items():
        if getattr(entry, key) is None:
            missing_facts[key] = text
    entry = replace(entry, **missing_facts)

    selected = select_columns(raw, entry, source_name)
    rate = resolve_sample_rate(raw, tuple(selected), entry, source_name)
    columns, unit = _scale_columns(raw, entry, selected, source_name)
    names = entry.names or tuple(selected)
    if len(names) != len(selected):
        raise DataError(
            f"{source_name}: {plural(len(names), 'name')} for {len(selected)} channels "
            f"({', '.join(selected)}).",
            field="names",
            remedy="Set {names} to one name for each channel, in order.",
        )

    recording_id = entry.id or raw.facts.get("recording_id") or stem_of(path)
    open_columns = partial(_reopen, path.absolute(), stamp, entry)
    samples = Samples.from_columns(recording_id, columns, open_columns, path.absolute())
    attributes = _collect_attributes(raw, entry, selected, contradictions)
    if entry.resample is not None:
        samples, rate, description = resample(samples, rate, entry.resample, source_name)
        if description:
            attributes["resampled"] = description
    condition = _combine_conditions(entry, raw.condition, source_name)
    if condition is None:
        attributes.update(_condition_attributes(entry))

    attributes["file"] = entry.file
    if entry.sha256:
        attributes["sha256"] = entry.sha256.lower()
    return Recording(
        samples=samples,
        sample_rate=rate,
        recording_id=recording_id,
        channels=names,
        unit=unit,
        label=entry.label or raw.facts.get("label"),
        condition=condition,
        specimen=entry.specimen or raw.facts.get("specimen"),
        synthetic=entry.synthetic or bool(raw.facts.get("synthetic")),
        attributes=attributes,
    )


def _require_checksum(path: Path, sha256: str) -> None:
    digest = sha256_of(path)
    if sha256.lower() != digest:
        raise DataError(
            f"{path} is not the file that was indexed (sha256 {digest[:12]}, index {sha256[:12]})."
        )


def _header_facts(raw: RawFile) -> dict[str, str]:
    """Return the facts of the header, without pressures whose unit it leaves open."""
    facts = parse_header_facts(raw)
    ambiguous = pressures_without_unit(facts)
    return {key: text for key, text in facts.items() if key not in ambiguous}


def _collect_attributes(
    raw: RawFile, entry: Entry, selected: Mapping[str, Column], contradictions: str
) -> dict[str, str]:
    attributes = {**raw.attributes, **entry.attributes}
    if contradictions:
        attributes["contradicted"] = contradictions
    if entry.channels is None:
        excluded = [name for name in raw.columns if name not in selected]
        attributes.update(describe_excluded(raw, entry, excluded))
    return attributes


def _scale_columns(
    raw: RawFile, entry: Entry, selected: Mapping[str, Column], source_name: str
) -> tuple[Columns, str]:
    """Return the selected columns with their factors, and the unit of the scaled samples."""
    factors, unit = resolve_scaling(raw, entry, tuple(selected), source_name)
    return Columns(tuple(selected.values()), tuple(factors), raw.speeds), unit


def _reopen(path: Path, stamp: FileStamp, entry: Entry) -> Columns:
    require_unchanged(path, stamp)
    raw = open_raw(path, entry.options)
    selected = select_columns(raw, entry, str(path))
    columns, _ = _scale_columns(raw, entry, selected, str(path))
    return columns


def load_extra_channel(recording: Recording, channel: str) -> Recording:
    """Return another column of a recording's file in its own unit, such as a tachometer's volts.

    Raises
    ------
    DataError
        The recording is not from a file, or the file has no such column.
    """
    open_columns = recording.samples.open_columns
    if not (isinstance(open_columns, partial) and open_columns.func is _reopen):
        raise DataError(
            f"{recording.recording_id} has no channel {channel!r}; it has "
            f"{', '.join(recording.channels)}."
        )

    path, _, entry = open_columns.args
    raw = open_raw(path, entry.options)
    unit = None if channel in raw.units else "1"
    extra_entry = replace(
        entry, channels=(channel,), names=None, unit=unit, sensitivity=None, sha256=None
    )
    return load_entry(path, extra_entry)


def _combine_conditions(
    entry: Entry, in_file: OperatingCondition | None, source_name: str
) -> OperatingCondition | None:
    """Return the operating point of entry and file, which must not contradict each other.

    None if they specify a speed or pressures alone.
    """
    values = {}
    for key, name in CONDITION_FIELDS.items():
        text = getattr(entry, key)
        if text is not None:
            values[name] = parse_quantity(text, QUANTITIES[key], name=f"{source_name}: {key}")
    for key in ("speed", "pressure"):
        if values.get(CONDITION_FIELDS[key], 1.0) <= 0:
            raise DataError(
                f"{source_name}: {key} ({getattr(entry, key)}) must be above zero.", field=key
            )

    if in_file is None and not {"speed", "discharge_pressure"} <= values.keys():
        return None
    try:
        condition = OperatingCondition(**values) if in_file is None else replace(in_file, **values)
    except InputError as cause:
        raise DataError(f"{source_name}: {cause}") from cause

    if in_file is not None and not in_file.matches(condition):
        raise DataError(
            f"{source_name} states an operating point of {_describe_condition(in_file)}, but "
            f"{_describe_condition(condition)} is specified.",
            remedy="Correct {speed} or {pressure}.",
        )
    return condition


def _condition_attributes(entry: Entry) -> dict[str, str]:
    """Return the facts of an incomplete operating point as attributes."""
    attributes = {}
    for key, name in CONDITION_FIELDS.items():
        text = getattr(entry, key)
        if text is not None:
            attributes[name] = str(text)
    return attributes


def _describe_condition(condition: OperatingCondition) -> str:
    speed = condition.speed * 30 / pi
    return f"{speed:.4g} rpm and {condition.discharge_pressure / 1e6:.4g} MPa"
