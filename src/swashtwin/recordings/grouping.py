"""What recordings state of themselves, and the groups of them that a split keeps whole."""

import math
import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from operator import itemgetter

import numpy as np
from jaxtyping import Float, Int, Shaped

from swashtwin.foundation import DataError, InputError, UnitError, parse_quantity
from swashtwin.pump import PRESSURE_TOLERANCE, merge_close_values
from swashtwin.recordings.recording import Recording

GROUPS = ("recording", "specimen", "condition")
"""Groups of every data set: each gives one split (L2, L4, L3)."""
GROUP_SPEED_TOLERANCE = 0.03
"""Relative difference of speeds of the same condition: more than elsewhere, since conditions that
are joined wrongly make a test harder, and conditions that are separated wrongly make it leak.
"""


def recording_groups(recordings: Iterable[Recording], group: str) -> dict[str, str]:
    """Group of each recording by its id, for the ``group=`` of `split_by_recording` and
    `group_folds`.

    Parameters
    ----------
    group : ``"recording"``, ``"specimen"``, ``"condition"`` (speed and discharge pressure, as far
        as they are stated), or the name of an attribute, such as ``"pump_run"``.

    Raises
    ------
    InputError
        No recording has such an attribute.
    DataError
        Some recordings have it and some have not.

    Examples
    --------
    >>> day = {"a": "Monday", "b": "Friday"}
    >>> recordings = [Recording(np.ones((1, 4)), 10.0, name, attributes={"day": day[name]}) for name in day]
    >>> recording_groups(recordings, "day")
    {'a': 'Monday', 'b': 'Friday'}
    """
    recordings = list(recordings)
    ids = [recording.recording_id for recording in recordings]
    if group == "recording":
        return dict(zip(ids, ids, strict=True))
    if group == "condition":
        speed = np.array([specified_speed(recording) for recording in recordings], dtype=np.float64)
        pressure = np.array(
            [specified_pressure(recording) for recording in recordings], dtype=np.float64
        )
        return dict(zip(ids, name_conditions(ids, speed, pressure), strict=True))
    if group == "specimen":
        names = [recording.specimen or "" for recording in recordings]
    else:
        names = [str(recording.attributes.get(group, "")) for recording in recordings]
        if not any(names):
            raise unknown_attribute(recordings, group, GROUPS)
    missing = [name for name, value in zip(ids, names, strict=True) if not value]
    if missing:
        raise DataError(missing_group_message(missing, len(ids), group))
    return dict(zip(ids, names, strict=True))


def specified_shaft_frequency(recording: Recording) -> float | None:
    """Revolutions per second [Hz] that the recording's condition or its attribute ``speed`` states,
    or None.

    For a recording along the shaft's angle it is the frequency at which the turns are played back.

    Raises
    ------
    DataError
        A recording along the shaft's angle does not state its samples per turn.
    """
    if recording.attributes.get("domain") == "angle":
        text = recording.attributes.get("samples_per_turn")
        try:
            per_turn = float(text or 0)
            if not 0 < per_turn < math.inf:
                raise ValueError("not positive")
            return recording.sample_rate / per_turn
        except ValueError as cause:
            raise DataError(
                f"{recording.recording_id} runs along the shaft's angle, but its samples_per_turn ({text!r}) is no "
                'positive number; state it in the index, such as attributes = { samples_per_turn = "512" }.'
            ) from cause
    if recording.condition is not None:
        return recording.condition.shaft_frequency
    try:
        return parse_quantity(recording.attributes["speed"], "rad/s") / (2 * math.pi)
    except (KeyError, UnitError):
        return None


def specified_speed(recording: Recording) -> float:
    """The same as an angular speed [rad/s], NaN where none is stated."""
    return (specified_shaft_frequency(recording) or math.nan) * 2 * math.pi


def specified_pressure(recording: Recording) -> float:
    """Discharge pressure [Pa] that the condition or the attribute ``discharge_pressure`` states, or
    NaN.
    """
    if recording.condition is not None:
        return recording.condition.discharge_pressure
    try:
        return parse_quantity(str(recording.attributes["discharge_pressure"]), "Pa")
    except (KeyError, UnitError):
        return math.nan


def name_conditions(
    ids: Sequence[str], speed: Float[np.ndarray, " n"], pressure: Float[np.ndarray, " n"]
) -> list[str]:
    """Name of each condition; speeds, and pressures, that follow each other closely are the same.

    Parameters
    ----------
    ids : recordings, for messages.
    speed : angular speed [rad/s], NaN where not stated.
    pressure : discharge pressure [Pa], NaN where not stated.
    """
    parts = []
    for fact, values, tolerance, scale, unit in (
        ("speed", speed, GROUP_SPEED_TOLERANCE, 30 / math.pi, "rev/min"),
        ("pressure", pressure, PRESSURE_TOLERANCE, 1e-6, "MPa"),
    ):
        missing = np.isnan(values)
        if missing.all():
            continue
        if missing.any():
            raise DataError(
                f"{ids[int(np.flatnonzero(missing)[0])]} states no {fact} and {ids[int(np.flatnonzero(~missing)[0])]} "
                "does, so their conditions cannot be compared; complete the index."
            )
        parts.append(
            [f"{level * scale:.4g} {unit}" for level in merge_close_values(values, tolerance)]
        )
    if not parts:
        raise DataError(
            f"{ids[0]} has no condition written down (no speed, no discharge_pressure), nor has any other recording, "
            "so they cannot be split by it; add speed to the index."
        )
    return [", ".join(part) for part in zip(*parts, strict=True)]


def describe_conditions(
    ids: Sequence[str], speed: Sequence[float], pressure: Sequence[float]
) -> list[str]:
    """The same for recordings of which each states what it does; a dash where that is nothing."""
    facts = np.array([speed, pressure], dtype=np.float64)
    words = np.full(len(ids), "-", dtype=object)
    for stated in {tuple(column) for column in (~np.isnan(facts)).T.tolist() if any(column)}:
        indices = np.flatnonzero((~np.isnan(facts) == np.array(stated)[:, None]).all(axis=0))
        words[indices] = name_conditions(
            [ids[index] for index in indices.tolist()], *facts[:, indices]
        )
    return [str(word) for word in words]


def missing_group_message(missing: Sequence[str], count: int, group: str) -> str:
    """Message that some of `count` recordings state no group."""
    more = f" and {len(missing) - 1} more of {count}" if len(missing) > 1 else ""
    have = "has" if len(missing) == 1 else "have"
    return f"{missing[0]}{more} {have} no {group} written down, so nothing can be split by it; complete the index."


def unknown_attribute(
    recordings: Sequence[Recording], name: str, others: Sequence[str]
) -> InputError:
    """Error that no recording has an attribute of that name, with the nearest of `others` and of
    those that differ.
    """
    keys = dict.fromkeys(key for recording in recordings for key in recording.attributes)
    differ = (
        key for key in keys if len({recording.attributes.get(key) for recording in recordings}) > 1
    )
    names = [*others, *(key for key in differ if key not in ("file", "sha256"))]
    near = get_close_matches(name, names, n=1)
    hint = f"did you mean {near[0]!r}?" if near else f"there are {', '.join(names)}."
    return InputError(f"no recording has the attribute {name!r}; {hint}")


def select_test_rows(
    classes: Int[np.ndarray, " row"],
    cells: Int[np.ndarray, " row"],
    groups: Shaped[np.ndarray, " row"],
    test_fraction: float,
    seed: int,
    *,
    every_class: bool = True,
) -> Int[np.ndarray, " _tested"] | None:
    """Rows of a test set that shares no group with the rest and has every class on both sides, or
    None.

    The groups are dealt into k folds (scikit-learn's `StratifiedGroupKFold`), from k =
    1/`test_fraction` down. Of the first k that gives such a fold, it is the one with most cells on
    both sides and the size nearest to the fraction.

    Parameters
    ----------
    classes : class of each row.
    cells : finer strata, such as class and pressure together.
    groups : what is kept whole.
    every_class : False: where no fold has every class on both sides, fewest classes miss in the
        test set, and none in training.
    """
    partial: list[tuple[tuple[int, int, float], Int[np.ndarray, " _tested"]]] = []
    for n_folds in range(min(round(1 / test_fraction), np.unique(groups).size), 1, -1):
        for strata in (cells, classes) if every_class else (cells, classes, None):
            ranked = [
                (
                    (
                        _one_sided(classes, rows),
                        _one_sided(cells, rows),
                        abs(rows.size / len(classes) - test_fraction),
                    ),
                    rows,
                )
                for rows in _folds(
                    np.zeros_like(classes) if strata is None else strata, groups, n_folds, seed
                )
            ]
            whole = [pair for pair in ranked if pair[0][0] == 0 and strata is not None]
            if whole:
                return min(whole, key=itemgetter(0))[1]
            partial += [
                pair
                for pair in ranked
                if np.isin(classes[pair[1]], np.delete(classes, pair[1])).all()
            ]
    return min(partial, key=itemgetter(0))[1] if partial and not every_class else None


def _one_sided(strata: Int[np.ndarray, " row"], rows: Int[np.ndarray, " _tested"]) -> int:
    counts = np.bincount(strata)
    tested = np.bincount(strata[rows], minlength=counts.size)
    return int(np.sum((counts > 0) & ((tested == 0) | (tested == counts))))


def _folds(
    strata: Int[np.ndarray, " row"], groups: Shaped[np.ndarray, " row"], n_folds: int, seed: int
) -> list[Int[np.ndarray, " _tested"]]:
    from sklearn.model_selection import StratifiedGroupKFold

    if np.bincount(strata).max() < n_folds:
        return []
    splitter = StratifiedGroupKFold(n_splits=n_folds, shuffle=True, random_state=seed)
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore", UserWarning
        )  # a cell smaller than n_folds is dealt as far as it goes
        return [rows for _, rows in splitter.split(np.zeros(len(strata)), strata, groups)]


_DATES = ("date", "datetime", "timestamp", "measured", "recorded", "time")
"""Attributes that say when a recording was made."""
_MOST = 3
"""Values that are listed one by one."""


@dataclass(frozen=True)
class RecordingSummary:
    """Facts of one recording, or of several together; empty where none is stated."""

    machine: str = ""
    """Which machine."""
    date: str = ""
    """When it was recorded."""
    condition: str = ""
    """Speed and discharge pressure."""
    file: str = ""
    """File as the index or the command names it."""
    origin: str = ""
    """Where recordings come from that are of no machine, such as the virtual rig."""
    shaft: float | None = None
    """Shaft frequency [Hz], where it is one for all."""
    pistons: int | None = None
    """Number of pistons, where it is one for all."""


def summarize_recordings(recordings: Sequence[Recording]) -> RecordingSummary:
    """What recordings state; several values are listed, or counted where there are more than three.

    Examples
    --------
    >>> import numpy as np
    >>> names = ("A", "B")
    >>> summarize_recordings([Recording(np.ones((1, 4)), 1.0, name, specimen=name) for name in names]).machine
    'A, B'
    """
    dates = [
        next((str(item.attributes[name]) for name in _DATES if item.attributes.get(name)), "")
        for item in recordings
    ]
    origins = dict.fromkeys(str(recording.attributes.get("origin", "")) for recording in recordings)
    shafts = {_shaft(recording) for recording in recordings}
    counts = {str(recording.attributes.get("pistons", "")) for recording in recordings}
    pistons = {int(text) if text.isdecimal() and 0 < int(text) < 100 else None for text in counts}
    return RecordingSummary(
        machine=_listed(sorted(recording.specimen or "" for recording in recordings), "machines"),
        date=_listed(sorted(" ".join(date.replace("T", " ").split())[:40] for date in dates)),
        condition=_condition(recordings),
        file=_listed(
            sorted(str(recording.attributes.get("file", "")) for recording in recordings), "files"
        ),
        origin="; ".join(origin for origin in origins if origin),
        shaft=shafts.pop() if len(shafts) == 1 else None,
        pistons=pistons.pop() if len(pistons) == 1 else None,
    )


def _listed(values: Iterable[str], noun: str = "", joint: str = ", ") -> str:
    distinct = list(dict.fromkeys(filter(None, values)))
    if len(distinct) <= _MOST:
        return joint.join(distinct)
    return f"{len(distinct)} {noun}" if noun else f"{distinct[0]} to {distinct[-1]}"


def _condition(recordings: Sequence[Recording]) -> str:
    shafts = [60 * shaft for recording in recordings if (shaft := _shaft(recording)) is not None]
    pressures = [specified_pressure(recording) / 1e6 for recording in recordings]
    about = "about " if any(recording.has_speed for recording in recordings) else ""
    pairs = (
        (about, shafts, "rev/min"),
        ("", [value for value in pressures if not math.isnan(value)], "MPa"),
    )
    return ", ".join(
        f"{prefix}{_listed((f'{value:.4g}' for value in sorted(values)), joint=' / ')} {unit}"
        for prefix, values, unit in pairs
        if values
    )


def _shaft(recording: Recording) -> float | None:
    try:
        return specified_shaft_frequency(recording)
    except DataError:  # along an angle, without samples per turn
        return None
