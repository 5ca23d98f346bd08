"""A recording from a file and from what its entry of an index says."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from fractions import Fraction
from functools import partial
from math import ceil, pi
from pathlib import Path
from typing import Any

import numpy as np

from swashtwin.foundation import (
    DataError,
    InputError,
    as_path,
    parse_quantity,
    plural,
    require_memory,
    sha256_of,
)
from swashtwin.pump import OperatingCondition
from swashtwin.recordings.entry import QUANTITIES, Entry
from swashtwin.recordings.fact_extraction import (
    describe_contradictions,
    parse_header_facts,
    pressures_without_unit,
)
from swashtwin.recordings.files import open_raw, stem_of
from swashtwin.recordings.formats.columns import Column
from swashtwin.recordings.formats.raw_file import (
    SAMPLE_RATE_RANGE_HZ,
    RawFile,
    file_stamp,
    require_unchanged,
)
from swashtwin.recordings.recording import Recording
from swashtwin.recordings.samples import Columns, Samples, hash_channels
from swashtwin.recordings.scaling import resolve_scaling, vibration_columns

PUMP_KEYS = {key: key for key in QUANTITIES if key not in ("sample_rate", "resample")}
PUMP_KEYS["pressure"] = "discharge_pressure"
"""Keys of an entry, and the fields of an `OperatingCondition` that they state."""
_RATE_TOLERANCE = 1e-3
_TIMES = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Seconds of the units that times may be in where the file has them for seconds."""


def load_recording(path: str | Path, **facts: Any) -> Recording:
    """Recording of one file, with what the file itself does not say; its samples are read when they
    are asked for.

    HDF5, TDMS, WAV and Parquet stay on the disk. A file of another format is read whole when it is
    opened.

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
    for name, unit in {**QUANTITIES, "discharge_pressure": "Pa"}.items():
        if isinstance(facts.get(name), (int, float)):
            facts[name] = f"{float(facts[name])!r} {unit}"
    return load_entry(
        as_path(path), Entry.from_mapping({"file": str(path), **facts}, where="load_recording")
    )


def load_entry(path: Path, entry: Entry) -> Recording:
    """Recording of the file at `path` with the facts of `entry`."""
    stamp = file_stamp(path)
    if entry.sha256 and entry.sha256.lower() != (digest := sha256_of(path)):
        raise DataError(
            f"{path} is not the file that was indexed (sha256 {digest[:12]}, index {entry.sha256[:12]})."
        )
    raw = open_raw(path, entry.options)
    header = parse_header_facts(raw)
    header = {
        key: text for key, text in header.items() if key not in pressures_without_unit(header)
    }
    contradicted = describe_contradictions(entry, header)
    entry = replace(
        entry, **{key: text for key, text in header.items() if getattr(entry, key) is None}
    )
    chosen = select_columns(raw, entry, str(path))
    rate = resolve_sample_rate(raw, tuple(chosen), entry, str(path))
    columns, unit = _columns(raw, entry, chosen, path)
    names = entry.names or tuple(chosen)
    if len(names) != len(chosen):
        raise DataError(
            f"{path}: {plural(len(names), 'name')} for {len(chosen)} channels ({', '.join(chosen)}); on the command "
            "line --names stands once for each, in order."
        )
    stated = raw.facts
    attributes = {
        **raw.attributes,
        **entry.attributes,
        **({"contradicted": contradicted} if contradicted else {}),
    }
    if entry.channels is None and (others := [name for name in raw.columns if name not in chosen]):
        attributes["other_columns"] = ", ".join(others)
    name = entry.id or stated.get("recording_id") or stem_of(path)
    samples = Samples.from_columns(name, columns, partial(_reopen, path.absolute(), stamp, entry))
    if entry.resample is not None:
        samples, rate, words = resampled(samples, rate, entry.resample, str(path))
        attributes |= {"resampled": words} if words else {}
    return Recording(
        samples=samples,
        sample_rate=rate,
        recording_id=name,
        channels=names,
        unit=unit,
        label=entry.label or stated.get("label"),
        condition=_condition(entry, raw.condition, str(path), attributes),
        specimen=entry.specimen or stated.get("specimen"),
        synthetic=entry.synthetic or bool(stated.get("synthetic")),
        attributes=attributes
        | {"file": entry.file}
        | ({"sha256": entry.sha256.lower()} if entry.sha256 else {}),
    )


def _columns(
    raw: RawFile, entry: Entry, chosen: Mapping[str, Column], path: Path
) -> tuple[Columns, str]:
    factors, unit = resolve_scaling(raw, entry, tuple(chosen), str(path))
    return Columns(tuple(chosen.values()), tuple(factors), raw.speeds), unit


def _reopen(path: Path, stamp: tuple[int, int, int], entry: Entry) -> Columns:
    require_unchanged(path, stamp)
    raw = open_raw(path, entry.options)
    return _columns(raw, entry, select_columns(raw, entry, str(path)), path)[0]


def load_extra_channel(recording: Recording, channel: str) -> Recording:
    """Another column of a recording's file in its own unit, such as the volts of a tachometer
    beside accelerations.

    Raises
    ------
    DataError
        The recording is of no file, or the file has no such column.
    """
    opened = recording.samples.open_columns
    if not (isinstance(opened, partial) and opened.func is _reopen):
        raise DataError(
            f"{recording.recording_id} has no channel {channel!r}; it has {', '.join(recording.channels)}."
        )
    path, _, entry = opened.args
    raw = open_raw(path, entry.options)
    unit = None if channel in raw.units else "1"
    return load_entry(
        path,
        replace(entry, channels=(channel,), names=None, unit=unit, sensitivity=None, sha256=None),
    )


def select_columns(raw: RawFile, entry: Entry, where: str) -> dict[str, Column]:
    """Columns the entry asks for, in its order; where it asks for none, `vibration_columns`."""
    chosen: dict[str, Column] = {}
    for channel in vibration_columns(raw, entry) if entry.channels is None else entry.channels:
        names = _matching(raw, channel)
        if not names:
            listed = ", ".join(f"{number} {name!r}" for number, name in enumerate(raw.columns))
            raise DataError(f"{where} has no channel {channel!r}; it has {listed}.")
        chosen |= {name: raw.columns[name] for name in names}
    rate_in_file(raw, list(chosen), where)
    starts = {name: raw.starts[name] for name in chosen if name in raw.starts}
    lengths = {name: str(len(column)) for name, column in chosen.items()}
    for values, words, advice in (
        (starts, "that start at different times", "start together"),
        (lengths, "of several lengths", "have one length"),
    ):
        if len(set(values.values())) > 1:
            listed = ", ".join(f"{name}: {value}" for name, value in values.items())
            raise DataError(
                f"{where} holds channels {words} ({listed}), which are no one recording; name those that {advice}: "
                "channels = [...]."
            )
    return chosen


def _matching(raw: RawFile, channel: str | int) -> list[str]:
    names = list(raw.columns)
    if isinstance(channel, str) and channel.isdecimal() and channel not in names:
        channel = int(channel)
    if isinstance(channel, int):
        return [names[channel]] if 0 <= channel < len(names) else []
    if channel in names:
        return [channel]
    return [name for name in names if fnmatchcase(name, channel)]


def resolve_sample_rate(raw: RawFile, chosen: Sequence[str], entry: Entry, where: str) -> float:
    """Sample rate [Hz] of the index or the file, which must not contradict each other."""
    in_index = (
        None
        if entry.sample_rate is None
        else parse_quantity(entry.sample_rate, "Hz", name=f"{where}: sample_rate")
    )
    in_file = rate_in_file(raw, chosen, where)
    if in_index is None and in_file is None:
        doubt = f" ({raw.attributes['time_gaps']})" if "time_gaps" in raw.attributes else ""
        raise DataError(
            f'{where} does not say its sample rate{doubt}; add sample_rate = "25.6 kHz" (or whatever it was).'
        )
    if in_file is None:
        if in_index is None or in_index <= 0:
            raise DataError(f"{where}: sample_rate ({in_index!r} Hz) must be positive.")
        return in_index
    if in_index is None:
        return in_file
    if abs(in_index / in_file - 1) > _RATE_TOLERANCE:
        by_unit = (
            unit
            for unit, size in _TIMES.items()
            if abs(in_index / in_file * size - 1) < _RATE_TOLERANCE
        )
        advice = next(
            (
                f', or, if its times are in {unit}, say time_unit = "{unit}" instead'
                for unit in by_unit
            ),
            "",
        )
        rates = f"{where} says its sample rate is {in_file:g} Hz, the index says {in_index:g} Hz"
        raise DataError(f"{rates}; correct the index{advice}.")
    return in_index


def rate_in_file(raw: RawFile, chosen: Sequence[str], where: str) -> float | None:
    """Sample rate [Hz] that the file itself states for the chosen columns, or None."""
    if not raw.rates:
        return raw.sample_rate
    names = {raw.rates.get(name, raw.sample_rate): name for name in reversed(chosen)}
    if len(names) > 1:
        listed = ", ".join(
            f"{name}: {f'{rate:g} Hz' if rate else 'none'}"
            for rate, name in reversed(names.items())
        )
        raise DataError(
            f"{where} holds channels of several rates ({listed}), and a recording has one; name those of one rate: "
            "channels = [...]."
        )
    return next(iter(names))


def _condition(
    entry: Entry, in_file: OperatingCondition | None, where: str, attributes: dict[str, str]
) -> OperatingCondition | None:
    """Operating condition of the index and the file, which must not contradict each other.

    A speed, or pressures, alone go to the attributes.
    """
    values = {
        field: parse_quantity(text, QUANTITIES[key], name=f"{where}: {key}")
        for key, field in PUMP_KEYS.items()
        if (text := getattr(entry, key)) is not None
    }
    for key in ("speed", "pressure"):
        if values.get(PUMP_KEYS[key], 1.0) <= 0:
            raise DataError(f"{where}: {key} = {getattr(entry, key)!r} must be above zero.")
    if in_file is not None or {"speed", "discharge_pressure"} <= values.keys():
        try:
            condition = (
                OperatingCondition(**values) if in_file is None else replace(in_file, **values)
            )
        except InputError as cause:
            raise DataError(f"{where}: {cause}") from cause
        if in_file is not None and not in_file.matches(condition):
            raise DataError(
                f"{where} says it ran at {_operating_point(in_file)}, the index says {_operating_point(condition)}; "
                "correct the index."
            )
        return condition
    attributes |= {
        field: str(getattr(entry, key)) for key, field in PUMP_KEYS.items() if field in values
    }
    return None


def _operating_point(condition: OperatingCondition) -> str:
    return f"{condition.speed * 30 / pi:.4g} rpm and {condition.discharge_pressure / 1e6:.4g} MPa"


def resampled(samples: Samples, rate: float, wanted: str, where: str) -> tuple[Samples, float, str]:
    """Samples of another rate, that rate [Hz], and how they are made; the file is read when they
    are asked for.

    At the rate that they have it is the same samples and no words.

    Parameters
    ----------
    rate : sample rate of `samples` [Hz].
    wanted : the new one, such as ``"12 kHz"``.
    where : how messages call the file.
    """
    new = parse_quantity(wanted, "Hz", name=f"{where}: resample")
    if not SAMPLE_RATE_RANGE_HZ[0] <= new <= SAMPLE_RATE_RANGE_HZ[1]:
        raise DataError(
            f'{where}: resample = {wanted!r} is no rate of a measurement; write such as "12 kHz".'
        )
    if new == rate:
        return samples, rate, ""
    ratio = Fraction(new / rate).limit_denominator(1000)
    if ratio == 0 or abs(float(ratio) * rate / new - 1) > 1e-9:
        raise DataError(
            f"{where}: {rate:g} Hz cannot be resampled to {new:g} Hz; choose a ratio of whole numbers."
        )
    count = ceil(samples.shape[1] * ratio)
    require_memory(
        samples.name,
        8 * samples.shape[0] * (count + samples.shape[1]),
        reason=f"resampled to {new:g} Hz takes",
    )
    words = f"scipy.signal.resample_poly({ratio.numerator}, {ratio.denominator})"
    words = f"from {rate:.15g} Hz to {new:.15g} Hz by {words}"
    open_columns = partial(_resample_columns, samples.unopened(), rate, new, ratio)
    shape = (samples.shape[0], count)
    return (
        Samples(samples.name, shape, np.dtype(np.float64), samples.has_speed, open_columns),
        new,
        words,
    )


def _resample_columns(samples: Samples, rate: float, new: float, ratio: Fraction) -> Columns:
    from scipy.signal import resample_poly

    count = samples.shape[1]
    signal, speed = samples.signal_part(0, count), samples.speed_part(0, count)
    hashes = hash_channels([signal])
    signal = resample_poly(signal, ratio.numerator, ratio.denominator, axis=1, padtype="line")
    if speed is not None:
        speed = np.interp(np.arange(signal.shape[1]) / new, np.arange(count) / rate, speed)
    return Columns(tuple(signal), (1.0,) * len(signal), speed, hashes)
