"""The recording that a file and what is known of it make together."""

import re
from collections.abc import Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from swashtwin.foundation import DataError, InputError, UnitError, parse, sha256_of
from swashtwin.pump import OperatingCondition
from swashtwin.recordings.entry import QUANTITIES, Entry
from swashtwin.recordings.formats.raw import Options, RawFile, acceleration_factor
from swashtwin.recordings.formats.registry import open_raw, read_raw, stem_of
from swashtwin.recordings.recording import Recording
from swashtwin.recordings.stored import Column, StoredRecording, in_memory

_PUMP_KEYS = ("discharge_pressure", "suction_pressure", "case_pressure", "oil_temperature")
_RATE_TOLERANCE = 1e-3
_FACTOR = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*?)\s*")


def read_recording(path: str | Path, **facts: Any) -> Recording:
    """Recording of one file, with what the file itself does not say.

    Parameters
    ----------
    path : file to read; `SUFFIXES` can be.
    facts : any field of `Entry`: ``sample_rate=25600`` (or ``"25.6 kHz"``), ``unit="g"``, ``label="normal"``. Numbers
        are in SI units.

    Raises
    ------
    DataError
        The file is missing, damaged, or contradicts a fact; or a fact is missing that nobody knows.
    """
    path = Path(path)
    return recording_from(path, _told(path, facts))


def open_recording(path: str | Path, **facts: Any) -> StoredRecording:
    """Recording of one file, whose readings are read in slices when they are asked for.

    HDF5, TDMS, WAV, Parquet and text tables stay on the disk (a text table as numbers, in a temporary file); a file of
    another format, and one that is to be resampled, is read whole. The slices hold what `read_recording` gives, bit by
    bit. The file's checksum is only taken where the index states one.

    Parameters
    ----------
    path : file to open.
    facts : as in `read_recording`.

    Raises
    ------
    DataError
        As in `read_recording`.
    """
    path = Path(path)
    return opened_from(path, _told(path, facts))


def opened_from(path: Path, entry: Entry) -> StoredRecording:
    """Recording of the file at `path` with the facts of `entry`, to be read in slices."""
    if entry.resample is not None:
        return in_memory(recording_from(path, entry))
    digest = _checked_digest(path, entry) if entry.sha256 else ""
    raw = open_raw(path, _options(entry))
    return _stored(raw, entry, path, {"sha256": digest} if digest else {})


def recording_from(path: Path, entry: Entry) -> Recording:
    """Recording of the file at `path` with the facts of `entry`."""
    digest = _checked_digest(path, entry)
    raw = read_raw(path, _options(entry))
    recording = _stored(raw, entry, path, {"sha256": digest}).loaded()
    return recording if entry.resample is None else _resampled(recording, entry, str(path))


def _told(path: Path, facts: dict[str, Any]) -> Entry:
    for name, unit in QUANTITIES.items():
        if isinstance(facts.get(name), (int, float)):
            facts[name] = f"{float(facts[name])!r} {unit}"
    return Entry.from_mapping({"file": str(path), **facts}, where="read_recording")


def _options(entry: Entry) -> Options:
    return Options(entry.separator, entry.decimal, entry.header_lines, entry.time_column)


def _checked_digest(path: Path, entry: Entry) -> str:
    """SHA-256 of the file, refused where the entry states another; empty where there is no file."""
    digest = sha256_of(path) if path.is_file() else ""
    if digest and entry.sha256 and entry.sha256.lower() != digest:
        raise DataError(f"{path} is not the file that was indexed (sha256 {digest[:12]}, index {entry.sha256[:12]}).")
    return digest


def _stored(raw: RawFile, entry: Entry, path: Path, digest: dict[str, str]) -> StoredRecording:
    """The recording that a file's columns and an entry make."""
    where, own = str(path), raw.recording
    chosen = choose_columns(raw, entry, where)
    names = entry.names or tuple(chosen)
    if len(names) != len(chosen):
        raise DataError(
            f"{where}: {len(names)} name{'s' * (len(names) != 1)} for {len(chosen)} channels ({', '.join(chosen)}); on "
            "the command line --names stands once for each, in order."
        )
    rate = stated_rate(raw, list(chosen), entry, where)
    factors, unit = scale(raw, entry, list(chosen), where)
    columns = tuple(chosen.values())
    attributes = dict(raw.attributes) | dict(entry.attributes)
    condition = _condition(entry, where, attributes)
    attributes |= {"file": entry.file} | digest
    facts = Recording(
        signal=np.zeros((len(columns), 1)),
        sample_rate=rate,
        recording_id=entry.id or (own.recording_id if own else stem_of(path)),
        channels=tuple(names),
        unit=unit,
        label=entry.label or (own.label if own else None),
        condition=condition or (own.condition if own else None),
        speed=None if raw.speeds is None else np.zeros(1),
        specimen=entry.specimen or (own.specimen if own else None),
        synthetic=entry.synthetic or bool(own and own.synthetic),
        attributes=attributes,
    )
    stored = StoredRecording(facts, columns, tuple(factors), raw.speeds)
    return replace(stored, facts=stored.slice(0, 1))


def choose_columns(raw: RawFile, entry: Entry, where: str) -> dict[str, Column]:
    """Columns the entry asks for, in its order; all where it asks for none."""
    chosen: dict[str, Column] = {}
    for wanted in raw.columns if entry.channels is None else entry.channels:
        found = _matching(raw, wanted)
        if not found:
            listed = ", ".join(f"{number} {name!r}" for number, name in enumerate(raw.columns))
            raise DataError(f"{where} has no channel {wanted!r}; it has {listed}.")
        chosen |= {name: raw.columns[name] for name in found}
    lengths = {name: len(column) for name, column in chosen.items()}
    if len(set(lengths.values())) > 1:
        listed = ", ".join(f"{name}: {length}" for name, length in lengths.items())
        raise DataError(f"{where} holds columns of several lengths ({listed}); name those to read: channels = [...].")
    return chosen


def _matching(raw: RawFile, wanted: str | int) -> list[str]:
    names: Sequence[str] = list(raw.columns)
    if isinstance(wanted, int):
        return [names[wanted]] if 0 <= wanted < len(names) else []
    if wanted in names:
        return [wanted]
    return [name for name in names if fnmatchcase(name, wanted)]


def stated_rate(raw: RawFile, chosen: Sequence[str], entry: Entry, where: str) -> float:
    """Sample rate [Hz] of the index or the file, which must not contradict each other."""
    told = None if entry.sample_rate is None else parse(entry.sample_rate, "Hz", name=f"{where}: sample_rate")
    own = rate_in_file(raw, chosen, where)
    if told is None and own is None:
        raise DataError(f'{where} does not say its sample rate; add sample_rate = "25.6 kHz" (or whatever it was).')
    if told is None or own is None:
        return own or positive(told, where)
    if abs(told / own - 1) > _RATE_TOLERANCE:
        raise DataError(f"{where} says its sample rate is {own:g} Hz, the index says {told:g} Hz; correct the index.")
    return told


def rate_in_file(raw: RawFile, chosen: Sequence[str], where: str) -> float | None:
    """Sample rate [Hz] that the file itself states for the chosen columns, or None."""
    if not raw.rates:
        return raw.sample_rate
    names = {raw.rates.get(name): name for name in chosen}
    if len(names) > 1:
        listed = ", ".join(f"{name}: {f'{rate:g} Hz' if rate else 'none'}" for rate, name in names.items())
        raise DataError(f"{where} holds channels of several rates ({listed}); name those of one: channels = [...].")
    return next(iter(names))


def positive(rate: float | None, where: str) -> float:
    """The rate [Hz], refused where it is not positive."""
    if rate is None or rate <= 0:
        raise DataError(f"{where}: sample_rate ({rate!r} Hz) must be positive.")
    return rate


def scale(raw: RawFile, entry: Entry, chosen: Sequence[str], where: str) -> tuple[list[float], str]:
    """Factor of each channel and the unit that comes out: m/s^2 for accelerations, the unit itself otherwise."""
    if entry.calibration_factor is not None:
        pairs = _calibration(entry, len(chosen), where)
    else:
        if raw.full_scale and entry.unit != "1":
            raise DataError(
                f'{where} holds integers without a scale; add calibration_factor = "50 m/s^2" (what full scale stands '
                'for), or unit = "1" where nobody knows.'
            )
        pairs = [(1.0, _unit(raw.units.get(name), entry.unit, name, where)) for name in chosen]
    factors, units = [], set()
    for number, unit in pairs:
        factor = acceleration_factor(unit)
        factors.append(number * (1.0 if factor is None else factor))
        units.add(unit if factor is None else "m/s^2")
    if len(units) > 1:
        raise DataError(
            f"{where}: the channels have different units ({', '.join(sorted(units))}); "
            "name those of one unit with channels = [...]."
        )
    return factors, units.pop()


def _unit(in_file: str | None, told: str | None, name: str, where: str) -> str:
    if told is None and in_file is None:
        raise DataError(
            f'{where} does not say the unit of {name!r}; add unit = "g", "m/s^2", or "1" where nobody knows.'
        )
    if told is None or in_file is None:
        return told or str(in_file)
    ours, theirs = acceleration_factor(told), acceleration_factor(in_file)
    if ours != theirs or (ours is None and told != in_file):
        raise DataError(
            f"{where} says {name!r} is in {in_file}, the index says {told}; "
            f'remove unit, or overrule the file with calibration_factor = "1 {told}".'
        )
    return told


def _calibration(entry: Entry, count: int, where: str) -> list[tuple[float, str]]:
    given = entry.calibration_factor
    texts = given if isinstance(given, tuple) else (given,) * count
    if len(texts) != count:
        raise DataError(f"{where}: {len(texts)} calibration factors for {count} channels.")
    pairs = []
    for text in texts:
        match = _FACTOR.fullmatch(text) if isinstance(text, str) else None
        if match is None or float(match[1]) == 0:
            raise UnitError(
                f'{where}: calibration_factor = {text!r} must be a number with its unit, such as "0.1 m/s^2", or "1 1".'
            )
        pairs.append((float(match[1]), match[2] or "1"))
    return pairs


def _condition(entry: Entry, where: str, attributes: dict[str, str]) -> OperatingCondition | None:
    """Operating condition of an entry; a speed alone goes to the attributes."""
    given = {}
    for name in ("speed", *_PUMP_KEYS):
        text = getattr(entry, name)
        if text is None:
            continue
        given[name] = parse(text, QUANTITIES[name], name=f"{where}: {name}")
    if "speed" in given and "discharge_pressure" in given:
        try:
            return OperatingCondition(**given)
        except InputError as cause:
            raise DataError(f"{where}: {cause}") from cause
    if "discharge_pressure" in given:
        raise DataError(f'{where}: discharge_pressure without speed; add speed = "860 rpm".')
    attributes |= {name: str(getattr(entry, name)) for name in given}
    return None


def _resampled(recording: Recording, entry: Entry, where: str) -> Recording:
    from scipy.signal import resample_poly

    rate, target = recording.sample_rate, parse(str(entry.resample), "Hz", name=f"{where}: resample")
    if target == rate:
        return recording
    ratio = Fraction(target / rate).limit_denominator(1000) if target > 0 else Fraction(0)
    if ratio == 0 or abs(float(ratio) * rate / target - 1) > 1e-9:
        raise DataError(f"{where}: {rate:g} Hz cannot be resampled to {target:g} Hz; choose a ratio of whole numbers.")
    said = (
        f"from {rate:.15g} Hz to {target:.15g} Hz by scipy.signal.resample_poly({ratio.numerator}, {ratio.denominator})"
    )
    signal = resample_poly(recording.signal, ratio.numerator, ratio.denominator, axis=1, padtype="line")
    speed = recording.speed
    if speed is not None:
        speed = np.interp(np.arange(signal.shape[1]) / target, recording.time, speed)
    attributes = {**recording.attributes, "resampled": said}
    return replace(recording, signal=signal, sample_rate=target, speed=speed, attributes=attributes)
