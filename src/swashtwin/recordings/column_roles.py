"""What each column of a file is: a vibration, another quantity, a class or state, or in doubt.

`vibration_columns` selects the channels of a recording if nobody named them.
"""

import re
from collections.abc import Iterable, Mapping
from enum import Enum
from typing import NamedTuple

import numpy as np

from swashtwin.foundation import DataError
from swashtwin.recordings.columns import BLOCK_SAMPLES, Column
from swashtwin.recordings.findings import join_names
from swashtwin.recordings.formats.column_names import (
    Meaning,
    PlaceSupport,
    Quantity,
    axis_stem,
    is_name_empty,
    meaning_of_name,
    meaning_of_unit,
    names_machine_place,
    names_place,
    names_state,
    unknown_unit,
)
from swashtwin.recordings.formats.raw_file import RawFile, ReadOptions
from swashtwin.recordings.formats.sample_units import (
    acceleration_factor,
    has_dimension,
)
from swashtwin.recordings.scaling import SENSED_UNIT, unit_after_scaling

EXCLUDED_COLUMNS = {
    "other_columns": "columns of other quantities than vibration",
    "state_columns": "columns of a class, a state or pulses",
}
"""What columns hold that are left out, by the attribute of a recording that lists them."""

# Samples at the beginning by which most columns are recognized as signals.
_HEAD_SAMPLES = 1024

# Fewer samples may take few values by chance.
_MIN_STATE_SAMPLES = 32

# More values are not those of classes or states, but of a coarse converter.
_MAX_STATES = 16

# Samples for each change of a state; the noise of a converter changes nearly every sample.
_SAMPLES_PER_CHANGE = 20

# Samples at the beginning in which pulses are looked for: two seconds of most recordings.
_PULSE_SAMPLES = 1 << 16

# Two pulses have four edges; a single step is that of a sensor that came loose.
_MIN_PULSE_EDGES = 4

# Deviation from a level of pulses by their height: a vibration that is a tenth of it has more.
_MAX_PULSE_NOISE = 0.05

# Samples on the edges of pulses are on neither level.
_MIN_LEVEL_SHARE = 0.97

# A level with fewer values has no noise.
_MIN_NOISY_VALUES = 5

# Letters before an axis that stand for another sensor beside accelerations, as in gx or mx.
_OTHER_AXES = {"g": "gyroscope?", "m": "magnetometer?", "w": "rotation?", "q": "quaternion?"}

# Component of a quaternion beside those that are named by axes, and the numbers of all four.
_QUATERNION_SCALAR = re.compile(r"q[_ ]?w", re.IGNORECASE)
_QUATERNION_NUMBERS = {"q0", "q1", "q2", "q3"}

# Words of a value that is measured beside its set point.
_ACTUAL_VALUE = re.compile(
    r"(?:.*[\W_])?(?:ist|ist[_ -]?wert|actual|actual[_ -]?value)", re.IGNORECASE
)

# What a sensor of vibration measures.
_VIBRATING = (Quantity.vibration, Quantity.motion)

# Number of a recording that a file holds after others.
_PART_NUMBER = re.compile(r" \[\d+\]$")


class NoVibrationError(DataError):
    """A file holds other quantities only than the one whose unit is specified."""


class RoleKind(Enum):
    """How certain it is that a column is a vibration."""

    vibration = "its unit or name says that it is a vibration"
    candidate = "nothing says what it is"
    doubtful = "it may be something else"
    state = "a class or a state"
    other = "another quantity"


class Role(NamedTuple):
    """What a column is, and by which evidence."""

    kind: RoleKind
    reason: str = ""
    """Words for a message, such as ``in dBm``."""
    place: PlaceSupport | None = None
    """By what the name of another quantity may be that of a place."""


def vibration_columns(raw: RawFile, options: ReadOptions, source_name: str) -> list[str]:
    """Return the columns of a file that are its vibrations, or all of them if none is.

    A specified unit holds for columns without another unit. Columns of other quantities, such as
    temperatures, gyroscopes or labels, are left out.

    Parameters
    ----------
    source_name : name of the file in messages.

    Raises
    ------
    NoVibrationError
        A unit or a sensitivity is specified, and all columns are of other quantities.
    DataError
        A unit of acceleration is specified, and which columns it is for cannot be decided.
    """
    if "recording_id" in raw.facts:
        return list(raw.columns)  # a recording that was written here

    roles = _roles_of(raw, options)
    names_by_kind: dict[RoleKind, list[str]] = {kind: [] for kind in RoleKind}
    for name, role in roles.items():
        names_by_kind[role.kind].append(name)

    unit = unit_after_scaling(raw, options, source_name)
    if unit not in (None, "1") and acceleration_factor(unit) is None:
        return _columns_in_unit(raw, roles, unit, source_name)

    is_scaled = options.sensitivity is not None or bool(raw.sensitivities)
    if not (is_scaled or unit is not None or names_by_kind[RoleKind.vibration]):
        selected = [name for name, role in roles.items() if role.kind is not RoleKind.state]
        return selected or list(roles)

    channel_kinds = {RoleKind.vibration, RoleKind.candidate}
    if names_by_kind[RoleKind.vibration]:
        _require_no_unclear_name(roles, source_name)
    elif names_by_kind[RoleKind.doubtful] and unit not in (None, "1"):
        _require_one_reading(roles, source_name)
        channel_kinds.add(RoleKind.doubtful)
    selected = [name for name, role in roles.items() if role.kind in channel_kinds]
    if not selected and unit not in (None, "1"):
        return _require_contradiction(raw, roles, unit, source_name)
    return selected or list(roles)


def describe_excluded(raw: RawFile, options: ReadOptions, names: Iterable[str]) -> dict[str, str]:
    """Return the notes about columns that are left out, by the attribute of a recording.

    Parameters
    ----------
    names : columns that are left out.
    """
    texts: dict[str, list[str]] = {attribute: [] for attribute in EXCLUDED_COLUMNS}
    excluded = list(names)
    roles = _roles_of(raw, options) if excluded else {}
    for name in excluded:
        role = roles[name]
        is_state = role.kind is RoleKind.state
        texts["state_columns" if is_state else "other_columns"].append(_with_reason(name, role))
    return {attribute: ", ".join(parts) for attribute, parts in texts.items() if parts}


def _with_reason(name: str, role: Role) -> str:
    """Return the name of a column with the reason, unless the name ends with it."""
    unit = role.reason.removeprefix("in ").rstrip("?")
    is_evident = not role.reason or re.search(rf"{re.escape(unit)}\W?$", name) is not None
    return name if is_evident else f"{name} ({role.reason})"


# ---- questions


def _require_no_unclear_name(roles: Mapping[str, Role], source_name: str) -> None:
    """Refuse columns whose names are words of unknown meaning beside those of vibrations."""
    unclear = []
    for name, role in roles.items():
        is_clear = role.place is not None or is_name_empty(name) or names_place(name)
        if role.kind is RoleKind.candidate and not is_clear:
            unclear.append(name)
    if unclear:
        raise _undecided(roles, unclear, source_name)


def _require_one_reading(roles: Mapping[str, Role], source_name: str) -> None:
    """Refuse columns in doubt beside others, unless all are alike."""
    doubtful = [name for name, role in roles.items() if role.kind is RoleKind.doubtful]
    has_candidates = any(role.kind is RoleKind.candidate for role in roles.values())
    if has_candidates or any(axis_stem(name) in _OTHER_AXES for name in doubtful):
        raise _undecided(roles, doubtful, source_name)


def _undecided(roles: Mapping[str, Role], unclear: Iterable[str], source_name: str) -> DataError:
    texts = [_with_reason(name, roles[name]) for name in unclear]
    likely_kinds = (RoleKind.vibration, RoleKind.candidate)
    likely = [name for name, role in roles.items() if role.kind in likely_kinds]
    likely = [name for name in likely if name not in unclear] or list(roles)
    proposed = ", ".join(repr(name) for name in likely[:6])
    return DataError(
        f"{source_name} does not state whether these columns are vibrations: "
        f"{join_names(texts, 9)}.",
        field="channels",
        remedy=f"Select each vibration with {{channels}}, such as {_without_braces(proposed)}; "
        "'*' selects all columns.",
    )


def _without_braces(text: str) -> str:
    return text.replace("{", "{{").replace("}", "}}")


# ---- roles


def _roles_of(raw: RawFile, options: ReadOptions) -> dict[str, Role]:
    """Return the role of each column; the others decide about names that may be those of places.

    "Position 1" beside "Motor DE" is a place, and a quantity beside the axes of an accelerometer.
    """
    roles = {name: _role_of(raw, options, name) for name in raw.columns}
    signal_kinds = (RoleKind.vibration, RoleKind.candidate)
    signals = [name for name, role in roles.items() if role.kind in signal_kinds]
    has_vibrations = any(role.kind is RoleKind.vibration for role in roles.values())
    are_places = bool(signals) and all(
        names_machine_place(name) and axis_stem(name) is None for name in signals
    )
    for name, role in roles.items():
        if role.place is None or (signals and not are_places):
            continue

        is_part = role.place is PlaceSupport.part and are_places and not has_vibrations
        if is_part or role.place is PlaceSupport.number:
            roles[name] = role._replace(kind=RoleKind.candidate)
        elif are_places:
            # A load may be measured, or the side of the load.
            roles[name] = role._replace(kind=RoleKind.doubtful)
    return roles


def _role_of(raw: RawFile, options: ReadOptions, name: str) -> Role:
    """Return the role of a column by its unit, its name, and its values, in this order."""
    return (
        _role_by_unit(raw, options, name)
        or _role_by_name(raw, name)
        or _role_by_values(raw.columns[name], name)
        or _role_by_pulses(raw.columns[name], name)
        or Role(RoleKind.candidate)
    )


def _role_by_unit(raw: RawFile, options: ReadOptions, name: str) -> Role | None:
    unit = raw.units.get(name)
    if unit is None:
        return _role_by_foreign_unit(raw, name)

    is_sensed = options.sensitivity is not None or name in raw.sensitivities
    if unit != "1" and acceleration_factor(unit) is not None:
        return Role(RoleKind.vibration, f"in {unit}")
    if is_sensed and SENSED_UNIT.fullmatch(unit):
        # One sensitivity for all columns does not make a vibration of the volts of a temperature.
        meaning = None if name in raw.sensitivities else _meaning_of(name)
        if meaning is None or meaning.quantity is not Quantity.other:
            return Role(RoleKind.vibration, f"in {unit}")
        return Role(RoleKind.other, meaning.reason)
    if unit == "1":
        return None
    return Role(RoleKind.other, f"in {unit}")


def _role_by_foreign_unit(raw: RawFile, name: str) -> Role | None:
    """Return that a column is in a unit of something else, unless it tells nothing apart."""
    unit = raw.foreign_units.get(name)
    if unit is None:
        return None
    # A word for all columns may as well be a remark, or the name of the machine.
    is_for_all = all(raw.foreign_units.get(other) == unit for other in raw.columns)
    if is_for_all and meaning_of_unit(unit) is None:
        return None
    return Role(RoleKind.other, f"in {unit}")


def _meaning_of(full_name: str) -> Meaning | None:
    return meaning_of_name(_PART_NUMBER.sub("", full_name))


def _role_by_name(raw: RawFile, full_name: str) -> Role | None:
    name = _PART_NUMBER.sub("", full_name)
    meaning = meaning_of_name(name)
    if meaning is not None:
        return _role_of_meaning(meaning, raw.columns[full_name])

    unit = unknown_unit(name)
    if unit and not names_place(name):
        # A plain word in brackets may be the place of a sensor; "[q]" and "(q/s)" are units.
        is_word = re.fullmatch(r"[^\W\d_]+(?: [^\W\d_]+)*\d*", unit) is not None
        is_unit = name.rstrip().endswith("]") or not is_word
        return Role(RoleKind.other if is_unit else RoleKind.doubtful, f"in {unit}?")

    reason = _OTHER_AXES.get(axis_stem(name) or "")
    if _QUATERNION_SCALAR.fullmatch(name) or _is_quaternion_number(name, raw.columns):
        reason = "quaternion?"
    if _ACTUAL_VALUE.fullmatch(name):
        reason = "an actual value?"
    return None if reason is None else Role(RoleKind.doubtful, reason)


def _is_quaternion_number(name: str, names: Iterable[str]) -> bool:
    """Return whether a name is that of one of the four components of a quaternion by number."""
    is_component = name.lower() in _QUATERNION_NUMBERS
    return is_component and {other.lower() for other in names} >= _QUATERNION_NUMBERS


def _role_of_meaning(meaning: Meaning, column: Column) -> Role | None:
    match meaning.quantity:
        case Quantity.vibration:
            return Role(RoleKind.vibration, meaning.reason)
        case Quantity.label:
            return Role(RoleKind.state, _describe_states(column))
        case Quantity.electric:
            return None  # the voltage of any sensor
    return Role(RoleKind.other, meaning.reason, meaning.place)


# ---- units of other quantities than acceleration


def _columns_in_unit(
    raw: RawFile, roles: Mapping[str, Role], unit: str, source_name: str
) -> list[str]:
    """Return the columns that may be in a unit of another quantity than acceleration.

    Columns whose names say that quantity, or none, come first. If there are none, the specified
    unit decides what those columns are whose names contradict it least.
    """
    selected = [name for name, role in roles.items() if _may_have_unit(raw, name, role, unit)]
    if not selected:
        selected = [name for name, role in roles.items() if _is_unit_open(raw, name, role, unit)]
    return selected or _require_contradiction(raw, roles, unit, source_name)


def _may_have_unit(raw: RawFile, name: str, role: Role, unit: str) -> bool:
    """Return whether nothing says that a column is in another unit, or of another quantity."""
    unit_in_file = raw.units.get(name, "")
    is_scaled = role.kind is RoleKind.vibration and SENSED_UNIT.fullmatch(unit_in_file) is not None
    if unit_in_file == unit or is_scaled:
        return True
    if not _is_without_unit(raw, name, role):
        return False

    meaning = _meaning_of(name)
    if role.kind is RoleKind.candidate or meaning is None:
        return True
    if meaning.quantity in _VIBRATING and SENSED_UNIT.fullmatch(unit):
        return True
    if meaning.dimension:
        return has_dimension(unit, meaning.dimension)
    return meaning.quantity is Quantity.vibration


def _is_unit_open(raw: RawFile, name: str, role: Role, unit: str) -> bool:
    """Return whether a name leaves its unit open, as "load" does, or a unit may be that of any.

    Any quantity may be recorded in volts, and what is called an acceleration may be its integral.
    """
    if not _is_without_unit(raw, name, role):
        return False

    meaning = _meaning_of(name)
    is_motion = has_dimension(unit, "m/s") or has_dimension(unit, "m")
    if meaning is None or SENSED_UNIT.fullmatch(unit) or meaning.quantity is Quantity.vibration:
        return True
    return meaning.quantity is Quantity.other and not (meaning.dimension or is_motion)


def _is_without_unit(raw: RawFile, name: str, role: Role) -> bool:
    is_stated = name in raw.foreign_units or role.reason.startswith("in ")
    return not is_stated and role.kind is not RoleKind.state


def _require_contradiction(
    raw: RawFile, roles: Mapping[str, Role], unit: str, source_name: str
) -> list[str]:
    """Return the columns with a unit, which contradicts the specified one and is reported then.

    Raises
    ------
    NoVibrationError
        No column has a unit: the names say that all are of other quantities.
    """
    if raw.units:
        return list(raw.units)

    listed = join_names([_with_reason(name, role) for name, role in roles.items()], 9)
    raise NoVibrationError(
        f"{source_name} holds no column that may be in {unit}: {listed}.",
        field="channels",
        remedy="If one is a vibration all the same, select it with {channels}.",
    )


# ---- states


def _role_by_values(column: Column, name: str) -> Role | None:
    """Return that a column holds a class, a state or pulses, by the few values that it takes."""
    if len(column) < _MIN_STATE_SAMPLES or not _are_states(column[0:_HEAD_SAMPLES]):
        return None

    values: set[float] = set()
    n_changes = 0
    for start in range(0, len(column), BLOCK_SAMPLES):
        block = np.asarray(column[start : start + BLOCK_SAMPLES])
        if not _are_states(block):
            return None
        block = block[np.isfinite(block)]
        values |= set(np.unique(block).tolist())
        n_changes += int((np.diff(block) != 0).sum())
    if not _are_states(np.array(sorted(values))):
        return None

    is_slow = n_changes * _SAMPLES_PER_CHANGE <= len(column)
    are_whole = all(value == round(value) for value in values)
    if len(values) == 1:
        is_state = names_state(name)  # else a dead sensor, which is reported
    elif names_state(name):
        is_state = True
    else:
        # A dead axis of a sensor may flicker: it is reported as such.
        is_pulse = len(values) == 2 and min(values) == 0
        is_state = axis_stem(name) is None and (is_pulse or (is_slow and are_whole))
    return Role(RoleKind.state, _describe_values(values)) if is_state else None


def _role_by_pulses(column: Column, name: str) -> Role | None:
    """Return that a column holds the noisy pulses of a tachometer: two levels, one near zero."""
    if axis_stem(name) is not None:
        return None

    samples = np.asarray(column[0:_PULSE_SAMPLES], dtype=np.float64)
    samples = samples[np.isfinite(samples)]
    if len(samples) < _MIN_STATE_SAMPLES:
        return None

    is_high = samples > (samples.min() + samples.max()) / 2
    n_changes = int((np.diff(is_high)).sum())
    is_slow = n_changes * _SAMPLES_PER_CHANGE <= len(samples)
    if n_changes < _MIN_PULSE_EDGES or not is_slow:
        return None

    low, high = (float(np.median(samples[mask])) for mask in (~is_high, is_high))
    height = high - low
    is_from_zero = min(abs(low), abs(high)) < _MAX_PULSE_NOISE * height
    deviations = np.abs(samples - np.where(is_high, high, low))
    is_tight = float(np.mean(deviations < _MAX_PULSE_NOISE * height)) > _MIN_LEVEL_SHARE
    # The mark of a missing value is one number; a level that was measured has noise.
    are_noisy = all(
        np.unique(samples[mask]).size >= _MIN_NOISY_VALUES for mask in (~is_high, is_high)
    )
    if not (is_from_zero and is_tight and are_noisy):
        return None
    return Role(RoleKind.state, f"pulses with a height of {height:.2g}")


def _are_states(values: np.ndarray) -> bool:
    """Return whether values may be those of states: a few whole numbers, or two levels."""
    finite = np.asarray(values, dtype=np.float64)
    finite = finite[np.isfinite(finite)]
    if finite.size == 0 or finite.min() < 0:
        return False
    if np.unique(finite[:_HEAD_SAMPLES]).size > _MAX_STATES:
        return False
    distinct = np.unique(finite)
    are_whole = bool((distinct == np.round(distinct)).all())
    return distinct.size <= (_MAX_STATES if are_whole else 2)


def _describe_states(column: Column) -> str:
    values: set[float] = set()
    for start in range(0, len(column), BLOCK_SAMPLES):
        block = np.asarray(column[start : start + BLOCK_SAMPLES], dtype=np.float64)
        values |= set(np.unique(block[np.isfinite(block)]).tolist())
        if len(values) > _MAX_STATES:
            break
    return _describe_values(values)


def _describe_values(values: set[float]) -> str:
    ordered = sorted(values)
    if len(ordered) == 1:
        return f"{ordered[0]:g} in the whole file"
    listed = ", ".join(f"{value:g}" for value in ordered[:6])
    more = ", ..." if len(ordered) > 6 else ""
    return f"changes within the file: {listed}{more}"
