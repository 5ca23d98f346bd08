"""The recording that a file and what is known of it make together."""

import re
from collections.abc import Sequence
from fnmatch import fnmatchcase
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from swashtwin.condition import OperatingCondition
from swashtwin.errors import DataError, InputError, UnitError
from swashtwin.files import sha256_of
from swashtwin.readers.entry import QUANTITIES, Entry
from swashtwin.readers.formats import read_raw, stem_of
from swashtwin.readers.raw import Options, RawFile, acceleration_factor
from swashtwin.recording import Recording
from swashtwin.units import parse

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
    for name, unit in QUANTITIES.items():
        if isinstance(facts.get(name), (int, float)):
            facts[name] = f"{float(facts[name])!r} {unit}"
    entry = Entry.from_mapping({"file": str(path), **facts}, where="read_recording")
    return recording_from(path, entry)


def recording_from(path: Path, entry: Entry) -> Recording:
    """Recording of the file at `path` with the facts of `entry`."""
    where = str(path)
    digest = sha256_of(path) if path.is_file() else ""
    if digest and entry.sha256 and entry.sha256.lower() != digest:
        raise DataError(f"{where} is not the file that was indexed (sha256 {digest[:12]}, index {entry.sha256[:12]}).")
    raw = read_raw(path, Options(entry.separator, entry.decimal, entry.header_lines, entry.time_column))
    own = raw.recording
    chosen = choose_columns(raw, entry, where)
    names = entry.names or tuple(chosen)
    if len(names) != len(chosen):
        raise DataError(f"{where}: {len(names)} names for {len(chosen)} channels ({', '.join(chosen)}).")
    rate = stated_rate(raw, list(chosen), entry, where)
    factors, unit = scale(raw, entry, list(chosen), where)
    signal = np.stack(list(chosen.values())).astype(np.float64) * np.array(factors)[:, None]
    attributes = dict(raw.attributes) | dict(entry.attributes)
    condition = _condition(entry, where, attributes)
    speed, measured_rate = own.speed if own else None, rate
    if entry.resample is not None:
        signal, rate = _resampled(signal, rate, entry, where, attributes)
    if speed is not None and rate != measured_rate:
        speed = np.interp(np.arange(signal.shape[1]) / rate, np.arange(len(speed)) / measured_rate, speed)
    attributes |= {"file": entry.file, "sha256": digest}
    return Recording(
        signal=signal,
        sample_rate=rate,
        recording_id=entry.id or (own.recording_id if own else stem_of(path)),
        channels=tuple(names),
        unit=unit,
        label=entry.label or (own.label if own else None),
        condition=condition or (own.condition if own else None),
        speed=speed,
        specimen=entry.specimen or (own.specimen if own else None),
        synthetic=entry.synthetic or bool(own and own.synthetic),
        attributes=attributes,
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
    rates = {raw.rates[name]: name for name in chosen if name in raw.rates}
    if len(rates) > 1:
        listed = ", ".join(f"{name}: {rate:g} Hz" for rate, name in rates.items())
        raise DataError(f"{where} holds channels of several rates ({listed}); name those of one: channels = [...].")
    return next(iter(rates), raw.sample_rate)


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
