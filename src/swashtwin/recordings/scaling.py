"""Units of channels, and what a stated sensitivity makes of their numbers."""

import re
from collections.abc import Sequence
from fnmatch import fnmatchcase
from typing import NamedTuple

from swashtwin.foundation import DataError, UnitError, parse_quantity
from swashtwin.recordings.formats.raw_file import RawFile, ReadOptions
from swashtwin.recordings.formats.sample_units import (
    acceleration_factor,
    normalize_unit,
    require_sample_unit,
)

_OTHER_QUANTITY = re.compile(
    r"(?:^|[^a-z])(?:temp|temperatur|temperature|druck|pressure|drehzahl|rpm|speed|flow|durchfluss|torque|drehmoment|"
    r"case[ _-]?drain|leck(?:öl)?)(?:[^a-z]|$)",
    re.IGNORECASE,
)
"""Names of channels that are no vibration; a tachometer stays, for the commands that follow it."""
_NUMBER = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*?)\s*")
_COUNT = r"(?i:counts?|cts?|lsb|digits?|bits?|fs|full[ _-]?scale)"
_ELECTRIC = r"[nmuµμ]?V|[pn]C|[muµμ]?A"
_FORMS = '"99.7 mV/g" for channels in volts, "0.488 mg/count" or "0.1 g" for one unit of the file'


class _Sensitivity(NamedTuple):
    """Quantity that stands for one `per`."""

    factor: float
    unit: str
    per: str | None
    """Electrical unit that a channel must be in, or None for one unit of the numbers in the
    file.
    """
    text: str
    """As it is stated."""

    @classmethod
    def read(cls, text: str, where: str) -> "_Sensitivity":
        match = _NUMBER.fullmatch(text)
        number, unit = (float(match[1]), match[2]) if match else (0.0, "")
        per, factor = None, number
        if parts := re.fullmatch(rf"(.*?)\s*/\s*{_COUNT}", unit):
            unit = parts[1]
        elif number and (parts := re.fullmatch(rf"{_COUNT}\s*/\s*\(?(.+?)\)?", unit)):
            unit, factor = parts[1], 1 / number
        elif number and (parts := re.fullmatch(rf"({_ELECTRIC})\s*/\s*\(?(.+?)\)?", unit)):
            unit, per, factor = parts[2], normalize_unit(parts[1]), 1 / number
        elif parts := re.fullmatch(rf"\(?(.+?)\)?\s*/\s*({_ELECTRIC})", unit):
            unit, per = parts[1], normalize_unit(parts[2])
        try:
            require_sample_unit(unit or "1")
        except UnitError:
            number = 0.0
        if not number:
            raise UnitError(
                f"{where}: sensitivity = {text!r} must be a number with its unit: {_FORMS}."
            )
        return cls(factor, normalize_unit(unit or "1"), per, text)

    def of(self, unit: str) -> float | None:
        """Quantity that stands for one `unit` of a channel, or None where the channel is no such
        signal.
        """
        kind = str(self.per)[-1]  # V, A or C
        try:
            return (
                self.factor
                * parse_quantity(f"1 {unit}", kind)
                / parse_quantity(f"1 {self.per}", kind)
            )
        except UnitError:
            return None


def resolve_scaling(
    raw: RawFile, options: ReadOptions, chosen: Sequence[str], where: str
) -> tuple[list[float], str]:
    """Factor of each channel and the unit that comes out: m/s^2 for accelerations, the unit itself
    otherwise.

    Parameters
    ----------
    chosen : channels, by their names in the file.
    where : how messages call the file.

    Raises
    ------
    DataError
        A unit is missing or contradicts the file, a sensitivity does not fit, or the channels have
        several units.
    UnitError
        A unit or a sensitivity is none.
    """
    if raw.full_scale and options.sensitivity is None and options.unit != "1":
        raise DataError(
            f'{where} holds integers without a scale; add sensitivity = "50 m/s^2" (what full scale stands for), or '
            'unit = "1" where nobody knows.'
        )
    sensitivities = _sensitivities(raw, options, chosen, where)
    pairs = [_scale_of(raw, options, name, sensitivities.get(name), where) for name in chosen]
    factors: list[float] = []
    names: dict[str, list[str]] = {}
    for (number, unit), name in zip(pairs, chosen, strict=True):
        factor = acceleration_factor(unit)
        factors.append(number * (1.0 if factor is None else factor))
        names.setdefault(unit if factor is None else "m/s^2", []).append(name)
    if len(names) > 1:
        listed = "; ".join(f"{unit}: {', '.join(names[unit])}" for unit in sorted(names))
        raise DataError(
            f"{where}: the channels have different units ({listed}); name those of one unit with channels = [...]."
        )
    return factors, next(iter(names))


def _scale_of(
    raw: RawFile, options: ReadOptions, name: str, sensitivity: _Sensitivity | None, where: str
) -> tuple[float, str]:
    """Quantity that one unit of a channel's numbers stands for: a factor and its unit."""
    in_file = raw.units.get(name, raw.facts.get("unit"))
    if sensitivity is None:
        if name in raw.sensitivities and name not in raw.units and options.unit is None:
            raise DataError(
                f"{where} states the sensitivity {raw.sensitivities[name]} of {name!r} and not its unit; add unit = "
                '"V" or "mV", or "g" where it is applied already.'
            )
        return 1.0, _unit(raw.units.get(name), options.unit, name, where)
    unit = (
        None
        if in_file is None and options.unit is None
        else _unit(in_file, options.unit, name, where)
    )
    if sensitivity.per is None:
        if unit in (None, "1") or re.fullmatch(_COUNT, str(unit)):
            return sensitivity.factor, sensitivity.unit
        if raw.full_scale:
            raise DataError(
                f'{where} holds integers, whose full scale is sensitivity = "{sensitivity.text}"; remove unit, or '
                "state it of the other files only, not in [defaults]."
            )
        raise DataError(
            f"{where}: {name!r} is in {unit} already, as {'the file' if in_file else 'unit'} says, and sensitivity = "
            f'"... {sensitivity.unit}" is for numbers without a unit; leave one of them out.'
        )
    if raw.full_scale:
        raise DataError(
            f'{where} holds integers without a scale; state what full scale stands for: sensitivity = "50 m/s^2", and '
            f'not "{sensitivity.text}".'
        )
    if unit is None:
        raise DataError(
            f'{where} does not say in what {name!r} was recorded; add unit = "V" or "mV" beside the sensitivity, or '
            'state what one number stands for: sensitivity = "0.1 g".'
        )
    if (factor := sensitivity.of(unit)) is None:
        raise DataError(
            f'{where}: {name!r} is in {unit}, and sensitivity = "{sensitivity.text}" is for channels in '
            f"{sensitivity.per}; correct one of them."
        )
    return factor, sensitivity.unit


def _sensitivities(
    raw: RawFile, options: ReadOptions, chosen: Sequence[str], where: str
) -> dict[str, _Sensitivity]:
    stated = options.sensitivity
    if stated is None:
        return _sensitivities_in_file(raw, options, chosen, where)
    texts = (stated,) if isinstance(stated, str) else stated
    if not any("=" in text for text in texts):
        if len(texts) not in (1, len(chosen)):
            raise DataError(
                f"{where}: {len(texts)} sensitivities for {len(chosen)} channels ({', '.join(chosen)})."
            )
        if len(texts) > 1:
            return {
                name: _Sensitivity.read(text, where)
                for name, text in zip(chosen, texts, strict=True)
            }
        only = _Sensitivity.read(texts[0], where)
        units = {name: raw.units.get(name, options.unit) for name in chosen}
        fits = [
            name
            for name, unit in units.items()
            if only.per is None or unit is None or only.of(unit) is not None
        ]
        return dict.fromkeys(fits or chosen, only)
    new_names = dict(zip(chosen, options.names or (), strict=False))
    sensitivities: dict[str, _Sensitivity] = {}
    for text in texts:
        pattern, _, quantity = text.partition("=")
        pattern = pattern.strip()
        names = [
            name for name in chosen if pattern == new_names.get(name) or fnmatchcase(name, pattern)
        ]
        if not names or not quantity:
            raise DataError(
                f"{where}: sensitivity = {text!r} names no channel; write NAME=QUANTITY for some of "
                f"{', '.join(chosen)}."
            )
        sensitivities |= dict.fromkeys(names, _Sensitivity.read(quantity, where))
    return sensitivities


def _sensitivities_in_file(
    raw: RawFile, options: ReadOptions, chosen: Sequence[str], where: str
) -> dict[str, _Sensitivity]:
    """The sensitivities that the file states of channels that are in volts."""
    found: dict[str, _Sensitivity] = {}
    for name in (name for name in chosen if name in raw.sensitivities):
        text, unit = raw.sensitivities[name], raw.units.get(name, options.unit)
        if unit is not None and not re.fullmatch(rf"{_ELECTRIC}|1|{_COUNT}", unit):
            continue  # it is applied already, as the unit in the file or the stated one says
        if re.fullmatch(r"[\d.eE+-]+", text):
            raise DataError(
                f"{where} states the sensitivity {text} of {name!r} without its unit; say sensitivity = "
                f'"{text} mV/g" or what it is, or unit = "g" where it is applied already.'
            )
        sensitivity = _Sensitivity.read(text, where)
        if unit and sensitivity.of(unit) is not None:
            found[name] = sensitivity
    return found


def vibration_columns(raw: RawFile, options: ReadOptions) -> list[str]:
    """Columns of a file but for those of another quantity beside accelerations: pressures,
    tachometers, temperatures.

    Where nothing says what the columns are, all of them.
    """
    factors = {
        name: None if unit == "1" else acceleration_factor(unit) for name, unit in raw.units.items()
    }
    is_acceleration = options.unit is not None and acceleration_factor(options.unit) is not None
    vibration, known = (
        [],
        is_acceleration or options.sensitivity is not None or bool(raw.sensitivities),
    )
    for name in raw.columns:
        if name in raw.units:
            sensed = options.sensitivity is not None or name in raw.sensitivities
            is_sensed = sensed and re.fullmatch(rf"{_ELECTRIC}|1|{_COUNT}", raw.units[name])
            is_other = factors[name] is None and not is_sensed
            known = known or factors[name] is not None
        else:
            is_other = bool(_OTHER_QUANTITY.search(name))
        if not is_other:
            vibration.append(name)
    return vibration if known and vibration else list(raw.columns)


def _unit(in_file: str | None, stated: str | None, name: str, where: str) -> str:
    """Unit of the file or the options, which must not contradict each other."""
    if stated is None and in_file is None:
        raise DataError(
            f'{where} does not say the unit of {name!r}; add unit = "g", "m/s^2", or "1" where nobody knows.'
        )
    if stated is None or in_file is None:
        return stated or str(in_file)
    factors = acceleration_factor(stated), acceleration_factor(in_file)
    if factors[0] != factors[1] or (factors[0] is None and stated != in_file):
        sensed = {"1": f'sensitivity = "1 {stated}"'}.get(in_file, 'sensitivity = "100 mV/g"')
        is_scaled = in_file == "1" or (factors[0] is not None and re.fullmatch(_ELECTRIC, in_file))
        advice = f"or say what they stand for: {sensed}" if is_scaled else "or correct the file"
        raise DataError(
            f"{where} says {name!r} is in {in_file}, the index says {stated}; remove unit, {advice}."
        )
    return stated
