"""One entry of an index: what is known of a file, and the recording it makes with that file."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from difflib import get_close_matches
from fnmatch import fnmatchcase
from fractions import Fraction
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from jaxtyping import Float

from swashtwin.condition import OperatingCondition
from swashtwin.errors import DataError, InputError, UnitError
from swashtwin.files import sha256_of
from swashtwin.readers.formats import read_raw, stem_of
from swashtwin.readers.raw import Options, RawFile, acceleration_factor
from swashtwin.recording import Recording
from swashtwin.units import parse

QUANTITIES = {
    "sample_rate": "Hz",
    "resample": "Hz",
    "speed": "rad/s",
    "discharge_pressure": "Pa",
    "suction_pressure": "Pa",
    "case_pressure": "Pa",
    "oil_temperature": "K",
}
"""Keys of an entry that are written with a unit, and the SI unit each is kept in."""
_PUMP_KEYS = ("discharge_pressure", "suction_pressure", "case_pressure", "oil_temperature")
_RATE_TOLERANCE = 1e-3
_FACTOR = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*?)\s*")


@dataclass(frozen=True)
class Entry:
    """What an index says of one file; quantities are text with their unit."""

    file: str
    """Path of the file, relative to the index (or to its ``root``)."""
    id: str | None = None
    """Unique name of the recording; the file's stem where None."""
    label: str | None = None
    """Class."""
    specimen: str | None = None
    """Machine, bearing or part that was measured."""
    speed: str | None = None
    """Speed of the shaft, such as ``"860 rpm"``; without `discharge_pressure` it is kept as an attribute."""
    discharge_pressure: str | None = None
    """Absolute pressure at the outlet, such as ``"15 MPa"``."""
    suction_pressure: str | None = None
    """Absolute pressure at the inlet."""
    case_pressure: str | None = None
    """Absolute pressure in the housing."""
    oil_temperature: str | None = None
    """Oil temperature, such as ``"45 degC"``."""
    channels: tuple[str | int, ...] | None = None
    """Columns or variables to read: names, patterns such as ``"*_DE_time"``, or numbers from 0; all where None."""
    names: tuple[str, ...] | None = None
    """What to call the channels; as in the file where None."""
    unit: str | None = None
    """Unit of the readings; ``"1"`` where the scale is unknown."""
    sample_rate: str | None = None
    """Readings per second, such as ``"25.6 kHz"``, where the file does not say it."""
    calibration_factor: str | tuple[str, ...] | None = None
    """Quantity that one unit of the file stands for, such as ``"0.1 g"`` (full scale of an integer WAV), or one each
    channel; it overrides what the file says of its unit."""
    resample: str | None = None
    """Rate to resample to with `scipy.signal.resample_poly`, such as ``"12 kHz"``."""
    separator: str | None = None
    """Character between the columns of a text file."""
    decimal: str | None = None
    """Decimal mark of a text file."""
    header_lines: int | None = None
    """Lines before the first reading of a text file."""
    time_column: str | int | None = None
    """Column of a text file with the time [s]."""
    sha256: str | None = None
    """Checksum the file must have."""
    synthetic: bool = False
    """Whether a model made the recording."""
    attributes: Mapping[str, str] = field(default_factory=dict)
    """Whatever else is known."""

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any], where: str) -> "Entry":
        """Entry of one table of an index, refused with `where` in the message where a key or a value cannot be."""
        known = {one.name for one in fields(cls)}
        for key in values:
            if key not in known:
                near = get_close_matches(key, known, n=1)
                hint = f"did you mean {near[0]!r}?" if near else f"known are {', '.join(sorted(known))}."
                raise DataError(f"{where}: unknown key {key!r}; {hint}")
        cleaned = {key: tuple(value) if isinstance(value, list) else value for key, value in values.items()}
        texts = ("file", "id", "label", "specimen", "unit", "separator", "decimal", "sha256")
        expected: dict[str, Any] = dict.fromkeys(texts, str)
        expected |= {"channels": tuple, "names": tuple, "header_lines": int, "synthetic": bool, "attributes": Mapping}
        for key, kind in expected.items():
            if cleaned.get(key) is not None and not isinstance(cleaned[key], kind):
                raise DataError(f"{where}: {key} = {cleaned[key]!r} must be {_KINDS[kind]}.")
        for key, unit in QUANTITIES.items():
            value = cleaned.get(key)
            if value is not None and not isinstance(value, str):
                raise UnitError(
                    f'{where}: {key} is the bare number {value!r}; write it with its unit: "{value} {unit}".'
                )
        if not all(isinstance(item, str) for item in cleaned.get("names") or ()):
            raise DataError(f"{where}: names = {values['names']!r} must be a list of texts.")
        if not all(isinstance(item, (str, int)) for item in cleaned.get("channels") or ()):
            raise DataError(f"{where}: channels = {values['channels']!r} must be a list of texts or whole numbers.")
        if not cleaned.get("file"):
            raise DataError(f'{where}: an entry needs file = "...".')
        return cls(**dict[str, Any](cleaned))


_KINDS: dict[Any, str] = {
    str: 'text, such as "normal"',
    tuple: 'a list, such as ["a", "b"]',
    int: "a whole number",
    bool: "true or false",
    Mapping: "a table of texts",
}


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
    for name, unit in QUANTITIES.items():
        if isinstance(facts.get(name), (int, float)):
            facts[name] = f"{float(facts[name])!r} {unit}"
    entry = Entry.from_mapping({"file": str(path), **facts}, where="read_recording")
    return recording_from(path, entry)


def recording_from(path: Path, entry: Entry) -> Recording:
    """Recording of the file at `path` with the facts of `entry`."""
    where = str(path)
    raw = read_raw(path, Options(entry.separator, entry.decimal, entry.header_lines, entry.time_column))
    digest = sha256_of(path)
    if entry.sha256 and entry.sha256.lower() != digest:
        raise DataError(f"{where} is not the file that was indexed (sha256 {digest[:12]}, index {entry.sha256[:12]}).")
    own = raw.recording
    chosen = choose_columns(raw, entry, where)
    names = entry.names or tuple(chosen)
    if len(names) != len(chosen):
        raise DataError(f"{where}: {len(names)} names for {len(chosen)} channels ({', '.join(chosen)}).")
    rate = stated_rate(raw, entry, where)
    factors, unit = scale(raw, entry, list(chosen), where)
    signal = np.stack(list(chosen.values())).astype(np.float64) * np.array(factors)[:, None]
    attributes = dict(raw.attributes) | dict(entry.attributes)
    condition = _condition(entry, where, attributes)
    if entry.resample is not None:
        signal, rate = _resampled(signal, rate, entry, where, attributes)
    attributes |= {"file": entry.file, "sha256": digest}
    return Recording(
        signal=signal,
        sample_rate=rate,
        recording_id=entry.id or (own.recording_id if own else stem_of(path)),
        channels=tuple(names),
        unit=unit,
        label=entry.label or (own.label if own else None),
        condition=condition or (own.condition if own else None),
        specimen=entry.specimen or (own.specimen if own else None),
        synthetic=entry.synthetic or bool(own and own.synthetic),
        attributes=MappingProxyType(attributes),
    )


def choose_columns(raw: RawFile, entry: Entry, where: str) -> dict[str, np.ndarray]:
    """Columns the entry asks for, in its order; all where it asks for none."""
    chosen: dict[str, np.ndarray] = {}
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


def stated_rate(raw: RawFile, entry: Entry, where: str) -> float:
    """Sample rate [Hz] of the index or the file, which must not contradict each other."""
    told = None if entry.sample_rate is None else parse(entry.sample_rate, "Hz", name=f"{where}: sample_rate")
    if told is None and raw.sample_rate is None:
        raise DataError(f'{where} does not say its sample rate; add sample_rate = "25.6 kHz" (or whatever it was).')
    if told is None or raw.sample_rate is None:
        return raw.sample_rate or positive(told, where)
    if abs(told / raw.sample_rate - 1) > _RATE_TOLERANCE:
        raise DataError(
            f"{where} says its sample rate is {raw.sample_rate:g} Hz, the index says {told:g} Hz; correct the index."
        )
    return told


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
        if name == "speed" and "hz" in text.lower():
            raise UnitError(f'{where}: speed = "{text}" is a frequency; write it as "{given[name] * 60:g} rpm".')
    if "speed" in given and "discharge_pressure" in given:
        try:
            return OperatingCondition(**given)
        except InputError as cause:
            raise DataError(f"{where}: {cause}") from cause
    if "discharge_pressure" in given:
        raise DataError(f'{where}: discharge_pressure without speed; add speed = "860 rpm".')
    attributes |= {name: str(getattr(entry, name)) for name in given}
    return None


def _resampled(
    signal: Float[np.ndarray, "channel time"], rate: float, entry: Entry, where: str, attributes: dict[str, str]
) -> tuple[Float[np.ndarray, "channel time2"], float]:
    from scipy.signal import resample_poly

    target = parse(str(entry.resample), "Hz", name=f"{where}: resample")
    if target == rate:
        return signal, rate
    ratio = Fraction(target / rate).limit_denominator(1000) if target > 0 else Fraction(0)
    if ratio == 0 or abs(float(ratio) * rate / target - 1) > 1e-9:
        raise DataError(f"{where}: {rate:g} Hz cannot be resampled to {target:g} Hz; choose a ratio of whole numbers.")
    attributes["resampled"] = (
        f"from {rate:.15g} Hz to {target:.15g} Hz by scipy.signal.resample_poly({ratio.numerator}, {ratio.denominator})"
    )
    return resample_poly(signal, ratio.numerator, ratio.denominator, axis=1, padtype="line"), target
