"""Units of channels, and the factors that a sensitivity gives their numbers."""

import re
from collections.abc import Sequence
from fnmatch import fnmatchcase
from typing import NamedTuple

from swashtwin.foundation import DataError, UnitError, parse_quantity, propose_setting
from swashtwin.recordings.formats.column_names import Quantity, meaning_of_name, meaning_of_unit
from swashtwin.recordings.formats.raw_file import RawFile, ReadOptions
from swashtwin.recordings.formats.sample_units import (
    acceleration_factor,
    normalize_unit,
    require_sample_unit,
)
from swashtwin.recordings.formats.trailing_units import count_unit

_NUMBER = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*?)\s*")
_BARE_NUMBER = re.compile(r"[\d.eE+-]+")
_COUNT = r"(?i:counts?|cts?|lsb|digits?|bits?|fs|full[ _-]?scale)"
_ELECTRIC = r"[nmuµμ]?V|[pn]C|[muµμ]?A"

SENSED_UNIT = re.compile(rf"{_ELECTRIC}|1|{_COUNT}")
"""Units of numbers that a sensitivity scales."""

_SENSITIVITY_FORMS = (
    '"99.7 mV/g" for channels in volts, "0.488 mg/count" or "0.1 g" for one unit of the file'
)
_FULL_SCALE_REMEDY = (
    "Set {sensitivity='50 m/s^2'} (value of full scale), or {unit='1'} if it is unknown."
)


class _Sensitivity(NamedTuple):
    """Quantity for one electrical unit, or for one unit of the numbers in the file."""

    factor: float
    unit: str
    per: str | None
    """Electrical unit that a channel must be in, or None for one unit of the file's numbers."""
    text: str
    """Text that it was parsed from."""

    @classmethod
    def parse(cls, text: str, source_name: str) -> "_Sensitivity":
        """Return the sensitivity of a text such as ``"99.7 mV/g"``."""
        match = _NUMBER.fullmatch(text)
        number = float(match[1]) if match else 0.0
        unit = match[2] if match else ""
        if number:
            factor, unit, per = _parse_sensitivity_unit(number, unit)
            if _is_sample_unit(unit or "1"):
                return cls(factor, normalize_unit(unit or "1"), per, text)

        raise UnitError(
            f"{source_name}: sensitivity ({text}) must be a number with its unit: "
            f"{_SENSITIVITY_FORMS}.",
            field="sensitivity",
        )

    def value_of(self, unit: str) -> float | None:
        """Return the quantity for one `unit` of a channel, or None for another kind of signal."""
        dimension = str(self.per)[-1]  # V, A or C
        try:
            channel_unit = parse_quantity(f"1 {unit}", dimension)
            return self.factor * channel_unit / parse_quantity(f"1 {self.per}", dimension)
        except UnitError:
            return None


def _parse_sensitivity_unit(number: float, unit: str) -> tuple[float, str, str | None]:
    """Return factor, unit, and the electrical unit that both are for."""
    if match := re.fullmatch(rf"(.*?)\s*/\s*{_COUNT}", unit):  # 0.488 mg/count
        return number, match[1], None
    if match := re.fullmatch(rf"{_COUNT}\s*/\s*\(?(.+?)\)?", unit):  # 256 LSB/g
        return 1 / number, match[1], None
    if match := re.fullmatch(rf"({_ELECTRIC})\s*/\s*\(?(.+?)\)?", unit):  # 99.7 mV/g
        return 1 / number, match[2], normalize_unit(match[1])
    if match := re.fullmatch(rf"\(?(.+?)\)?\s*/\s*({_ELECTRIC})", unit):  # 10 g/V
        return number, match[1], normalize_unit(match[2])
    return number, unit, None


def _is_sample_unit(unit: str) -> bool:
    try:
        require_sample_unit(unit)
    except UnitError:
        return False
    return True


def unit_after_scaling(raw: RawFile, options: ReadOptions, source_name: str) -> str | None:
    """Return the unit of the scaled numbers: of the sensitivity, else the specified one, or None.

    The first sensitivity decides, for the channels of a recording have one unit. A volt is not
    the unit of the result if the file states a sensitivity, even if that is incomplete.
    """
    if options.sensitivity is not None:
        texts = (
            [options.sensitivity] if isinstance(options.sensitivity, str) else options.sensitivity
        )
        quantity = texts[0].rpartition("=")[2]
        return _Sensitivity.parse(quantity, source_name).unit

    unit = None if options.unit is None else normalize_unit(options.unit)
    if not raw.sensitivities or (unit is not None and not SENSED_UNIT.fullmatch(unit)):
        return unit
    try:
        return _Sensitivity.parse(next(iter(raw.sensitivities.values())), source_name).unit
    except UnitError:
        return None


def resolve_scaling(
    raw: RawFile, options: ReadOptions, channels: Sequence[str], source_name: str
) -> tuple[list[float], str]:
    """Return the factor of each channel and the resulting unit: m/s^2 for accelerations.

    Parameters
    ----------
    channels : names of the channels in the file.
    source_name : name of the file in messages.

    Raises
    ------
    DataError
        A unit is missing or contradicts the file, a sensitivity does not fit, or the channels have
        several units.
    UnitError
        A unit or a sensitivity is invalid.
    """
    if raw.full_scale and options.sensitivity is None and options.unit != "1":
        raise DataError(
            f"{source_name} holds integers without a scale.",
            field="sensitivity",
            remedy=_FULL_SCALE_REMEDY,
        )

    sensitivities = _resolve_sensitivities(raw, options, channels, source_name)
    factors: list[float] = []
    names_by_unit: dict[str, list[str]] = {}
    for name in channels:
        if name not in sensitivities and name not in raw.units:
            _refuse_other_unit(raw, options, name, channels, source_name)
        number, unit = _scale_channel(raw, options, name, sensitivities.get(name), source_name)
        factor = acceleration_factor(unit)
        if factor is not None:
            number *= factor
            unit = "m/s^2"
        factors.append(number)
        names_by_unit.setdefault(unit, []).append(name)

    if len(names_by_unit) > 1:
        listed = "; ".join(
            f"{unit}: {', '.join(names_by_unit[unit])}" for unit in sorted(names_by_unit)
        )
        raise DataError(
            f"{source_name}: the channels have different units ({listed}).",
            field="channels",
            remedy="Select those of one unit with {channels}.",
        )
    return factors, next(iter(names_by_unit))


def _scale_channel(
    raw: RawFile,
    options: ReadOptions,
    name: str,
    sensitivity: _Sensitivity | None,
    source_name: str,
) -> tuple[float, str]:
    """Return the quantity for one unit of a channel's numbers: a factor and its unit."""
    if sensitivity is None:
        if name in raw.sensitivities and name not in raw.units and options.unit is None:
            raise DataError(
                f"{source_name} states the sensitivity {raw.sensitivities[name]} of {name!r}, "
                "but not its unit.",
                field="unit",
                remedy="Set {unit='V'} or {unit='mV'}, or {unit='g'} if it is applied already.",
            )
        if name not in raw.units:
            _refuse_counts(options, name, source_name)
        return 1.0, _resolve_unit(raw.units.get(name), options.unit, name, source_name)

    unit_in_file = raw.units.get(name, raw.facts.get("unit"))
    unit = None
    if unit_in_file is not None or options.unit is not None:
        unit = _resolve_unit(unit_in_file, options.unit, name, source_name)
    if sensitivity.per is None:
        _require_plain_numbers(raw, name, unit, unit_in_file, sensitivity, source_name)
        return sensitivity.factor, sensitivity.unit

    if raw.full_scale:
        raise DataError(
            f"{source_name} holds integers without a scale, and {sensitivity.text} is for channels "
            f"in {sensitivity.per}.",
            field="sensitivity",
            remedy="Set the value of full scale, such as {sensitivity='50 m/s^2'}.",
        )
    if unit is None:
        raise DataError(
            f"{source_name} does not state the unit in which {name!r} was recorded.",
            field="unit",
            remedy=(
                "Set {unit='V'} or {unit='mV'} in addition to the sensitivity, or the value of one "
                "number: {sensitivity='0.1 g'}."
            ),
        )
    factor = sensitivity.value_of(unit)
    if factor is None:
        raise DataError(
            f"{source_name}: {name!r} is in {unit}, and the sensitivity {sensitivity.text} is for "
            f"channels in {sensitivity.per}; correct one of them.",
            field="sensitivity",
        )
    return factor, sensitivity.unit


def _refuse_other_unit(
    raw: RawFile, options: ReadOptions, name: str, channels: Sequence[str], source_name: str
) -> None:
    """Refuse a specified unit for a column whose heading says another one, such as ``dBm``."""
    if name in raw.foreign_units:
        meaning = meaning_of_unit(raw.foreign_units[name])
    else:
        meaning = meaning_of_name(name)
    if meaning is None or meaning.quantity is not Quantity.other:
        return

    text = meaning.reason.removeprefix("in ")
    is_unit = text != meaning.reason
    if is_unit and options.unit != "1" and normalize_unit(options.unit or "") != text:
        specified = f", but {options.unit} is specified" if options.unit else ""
        # A channel with a unit beside it contradicts the unit of plain numbers.
        is_unit_stated = any(channel in raw.units for channel in channels)
        raise DataError(
            f"{source_name} states that {name!r} is in {text}{specified}.",
            field="channels" if is_unit_stated else "unit",
            remedy="Select other {channels}."
            if is_unit_stated
            else "Set {unit='1'} to read the plain numbers, or select other {channels}.",
        )


def _refuse_counts(options: ReadOptions, name: str, source_name: str) -> None:
    """Refuse a unit of a quantity, or none, for a column whose heading says counts."""
    unit = count_unit(name)
    if unit is None or options.unit == "1":
        return
    specified = f", but {options.unit} is specified" if options.unit else ""
    raise DataError(
        f"{source_name} states that {name!r} is in {unit}{specified}.",
        field="sensitivity",
        remedy=_count_remedy(options),
    )


def _count_remedy(options: ReadOptions) -> str:
    """Return what to do about a channel in counts."""
    per_count = "the value of one count, such as {sensitivity='0.488 mg/count'}"
    if options.unit is None:
        return f"Set {per_count}, or {{unit='1'}} if it is unknown."
    return f"Replace {{unit}} by {per_count}, or by {{unit='1'}} if it is unknown."


def _require_plain_numbers(
    raw: RawFile,
    name: str,
    unit: str | None,
    unit_in_file: str | None,
    sensitivity: _Sensitivity,
    source_name: str,
) -> None:
    """Refuse a sensitivity of plain numbers for a channel that has a unit."""
    if unit in (None, "1") or re.fullmatch(_COUNT, str(unit)):
        return

    if raw.full_scale:
        raise DataError(
            f"{source_name} holds integers, and their full scale is {sensitivity.text} by the "
            "sensitivity.",
            field="unit",
            remedy="Remove {unit}, or set it for the other files only, not in [defaults].",
        )
    source = "the file" if unit_in_file else "unit"
    raise DataError(
        f"{source_name}: {name!r} is in {unit} already, according to {source}, and the sensitivity "
        f"{sensitivity.text} is for numbers without a unit; remove one of them.",
        field="sensitivity",
    )


def _resolve_sensitivities(
    raw: RawFile, options: ReadOptions, channels: Sequence[str], source_name: str
) -> dict[str, _Sensitivity]:
    """Return the sensitivity of each channel that has one."""
    if options.sensitivity is None:
        return _sensitivities_in_file(raw, options, channels, source_name)

    if isinstance(options.sensitivity, str):
        texts: Sequence[str] = (options.sensitivity,)
    else:
        texts = options.sensitivity
    if any("=" in text for text in texts):
        return _named_sensitivities(texts, options, channels, source_name)

    if len(texts) == 1:
        sensitivity = _Sensitivity.parse(texts[0], source_name)
        matching = _channels_of_sensitivity(raw, options, channels, sensitivity)
        return dict.fromkeys(matching or channels, sensitivity)
    if len(texts) != len(channels):
        raise DataError(
            f"{source_name}: {len(texts)} sensitivities for {len(channels)} channels "
            f"({', '.join(channels)}).",
            field="sensitivity",
        )
    return {
        name: _Sensitivity.parse(text, source_name)
        for name, text in zip(channels, texts, strict=True)
    }


def _channels_of_sensitivity(
    raw: RawFile, options: ReadOptions, channels: Sequence[str], sensitivity: _Sensitivity
) -> list[str]:
    """Return the channels to which a single sensitivity applies."""
    matching = []
    for name in channels:
        unit = raw.units.get(name, options.unit)
        if sensitivity.per is None or unit is None or sensitivity.value_of(unit) is not None:
            matching.append(name)
    return matching


def _named_sensitivities(
    texts: Sequence[str], options: ReadOptions, channels: Sequence[str], source_name: str
) -> dict[str, _Sensitivity]:
    """Return the sensitivities of texts ``NAME=QUANTITY``; the last one of a channel counts."""
    new_names = dict(zip(channels, options.names or (), strict=False))
    sensitivities: dict[str, _Sensitivity] = {}
    for text in texts:
        pattern, _, quantity = text.partition("=")
        pattern = pattern.strip()
        names = []
        for name in channels:
            if pattern == new_names.get(name) or fnmatchcase(name, pattern):
                names.append(name)
        if not names or not quantity:
            raise DataError(
                f"{source_name}: sensitivity ({text}) names no channel; use NAME=QUANTITY for some "
                f"of {', '.join(channels)}.",
                field="sensitivity",
            )
        sensitivity = _Sensitivity.parse(quantity, source_name)
        sensitivities.update(dict.fromkeys(names, sensitivity))
    return sensitivities


def _sensitivities_in_file(
    raw: RawFile, options: ReadOptions, channels: Sequence[str], source_name: str
) -> dict[str, _Sensitivity]:
    """Return the sensitivities that the file states for channels in volts."""
    sensitivities: dict[str, _Sensitivity] = {}
    for name in channels:
        if name not in raw.sensitivities:
            continue
        unit = raw.units.get(name, options.unit)
        if unit is not None and not SENSED_UNIT.fullmatch(unit):
            continue  # it is applied already, or the numbers would not be in this unit

        text = raw.sensitivities[name]
        if _BARE_NUMBER.fullmatch(text):
            raise DataError(
                f"{source_name} states the sensitivity {text} of {name!r} without its unit.",
                field="sensitivity",
                remedy=_bare_sensitivity_remedy(text, raw.units.get(name), options),
            )
        sensitivity = _Sensitivity.parse(text, source_name)
        if unit and sensitivity.value_of(unit) is not None:
            sensitivities[name] = sensitivity
    return sensitivities


def _bare_sensitivity_remedy(text: str, unit_in_file: str | None, options: ReadOptions) -> str:
    """Return what to do about a sensitivity without a unit, by the unit that the file states."""
    if unit_in_file is None:
        return (
            f"Set {{sensitivity='{text} mV/g'}} or whatever it is, or {{unit='g'}} if it is "
            "applied already."
        )

    start = "Set" if options.unit is None else "Replace {unit} by"
    if re.fullmatch(_ELECTRIC, unit_in_file) is None:
        return (
            f"{start} the value of one number, such as {{sensitivity='0.01 g'}}, or "
            "{sensitivity='1 g'} if the numbers are in g already."
        )
    return (
        f"{start} {{sensitivity='{text} mV/g'}} or whatever it is, or "
        f"{{sensitivity='1 {unit_in_file}/g'}} if the numbers are in g already."
    )


def _resolve_unit(in_file: str | None, specified: str | None, name: str, source_name: str) -> str:
    """Return the unit of the file or the options, which must not contradict each other."""
    if specified is None:
        if in_file is None:
            raise DataError(
                f"{source_name} does not state the unit of {name!r}.",
                field="unit",
                remedy="Set {unit='g'}, {unit='m/s^2'}, or {unit='1'} if it is unknown.",
            )
        return in_file
    if in_file is None:
        return specified

    specified_factor = acceleration_factor(specified)
    factor_in_file = acceleration_factor(in_file)
    is_other_quantity = specified_factor is None and specified != in_file
    if specified_factor == factor_in_file and not is_other_quantity:
        return specified

    is_voltage_of_acceleration = specified_factor is not None and re.fullmatch(_ELECTRIC, in_file)
    if in_file == "1":
        scale = propose_setting("sensitivity", f"1 {specified}")
        remedy = f"Remove {{unit}}, or set its scale: {scale}."
    elif re.fullmatch(_COUNT, in_file):
        remedy = "Remove {unit}, or set its scale: {sensitivity='0.488 mg/count'}."
    elif is_voltage_of_acceleration:
        remedy = "Remove {unit}, or set its scale: {sensitivity='100 mV/g'}."
    else:
        remedy = "Remove {unit}, or correct the file."
    raise DataError(
        f"{source_name} states that {name!r} is in {in_file}, but {specified} is specified.",
        field="unit",
        remedy=remedy,
    )
