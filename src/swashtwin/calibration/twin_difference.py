"""Two calibrations side by side: which values differ by more than they are uncertain, and what else differs."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from swashtwin.calibration.result import Calibration
from swashtwin.pump import LETTERS, PARAMETERS

TELLING = 2.0
"""Standard deviations from which a difference is called telling: chance alone makes one in twenty."""


@dataclass(frozen=True)
class ValueDifference:
    """One interface value in two calibrations."""

    name: str
    """Name as in `pump.PARAMETERS`."""
    letter: str
    """The paper's letter."""
    unit: str
    """Unit of the values."""
    values: tuple[float, float]
    """Values found."""
    intervals: tuple[tuple[float, float], tuple[float, float]]
    """Their 90 % intervals."""
    verdicts: tuple[str, str]
    """Their verdicts."""
    log_ratio: float
    """ln(second / first)."""
    deviations: float
    """The same over its standard deviation, sqrt(s1^2 + s2^2) of the two logarithms'."""
    overlap: bool
    """Whether the intervals share a value."""

    @property
    def is_telling(self) -> bool:
        """Whether the values differ by more than two standard deviations."""
        return abs(self.deviations) > TELLING


@dataclass(frozen=True)
class ConstantDifference:
    """One constant searched beside the six values, in two calibrations."""

    name: str
    """Name as in `Unknowns.names`."""
    coordinates: tuple[float | None, float | None]
    """Logarithm of a factor, gain, frequency or damping ratio, or a residue as it is; None where it was not
    searched."""
    log_stds: tuple[float | None, float | None]
    """Standard deviation of each."""


@dataclass(frozen=True)
class Difference:
    """How two calibrations differ."""

    values: tuple[ValueDifference, ...]
    """The six values, in the order of `pump.PARAMETERS`."""
    constants: tuple[ConstantDifference, ...]
    """Constants that either of them searched."""
    fits: Mapping[str, tuple[float, float]]
    """Figures of `Calibration.fit_after` by name."""
    settings: Mapping[str, tuple[Any, Any]]
    """What differs of pump, twin, conditions, bounds, method and its settings, by name; None where one has no such. Of
    different methods only settings that both have."""
    shared: tuple[str, ...]
    """Recordings of both, by hash; named as the first has them."""
    alone: tuple[tuple[str, ...], tuple[str, ...]]
    """Recordings of one only."""
    notes: tuple[str, ...]
    """What the user should know first."""

    def to_dict(self) -> dict[str, Any]:
        """All of it as JSON can hold it."""
        return {**asdict(self), "telling": [value.letter for value in self.values if value.is_telling]}


def difference(first: Calibration, second: Calibration) -> Difference:
    """How `second` differs from `first`.

    Values are compared by the standard deviations of their logarithms, as if the calibrations were independent. On
    the same recordings they are not: two right calibrations then differ by less.
    """
    shared, alone = _recordings(first, second)
    settings = _settings(first, second)
    return Difference(
        values=tuple(_value(first, second, index) for index in range(len(PARAMETERS))),
        constants=_constants(first, second),
        fits={name: (value, getattr(second.fit_after, name)) for name, value in asdict(first.fit_after).items()},
        settings=settings,
        shared=shared,
        alone=alone,
        notes=tuple(_notes(first, second, shared, settings)),
    )


def _value(first: Calibration, second: Calibration, index: int) -> ValueDifference:
    a, b = first.estimates[index], second.estimates[index]
    ratio = math.log(b.value / a.value)
    return ValueDifference(
        name=a.name,
        letter=LETTERS[a.name],
        unit=a.unit,
        values=(a.value, b.value),
        intervals=(a.interval, b.interval),
        verdicts=(a.verdict, b.verdict),
        log_ratio=ratio,
        deviations=ratio / math.hypot(a.log_std, b.log_std),
        overlap=a.interval[0] <= b.interval[1] and b.interval[0] <= a.interval[1],
    )


def _constants(first: Calibration, second: Calibration) -> tuple[ConstantDifference, ...]:
    searched = [_searched(constants) for constants in (first, second)]
    names = dict.fromkeys([*searched[0], *searched[1]])
    rows = [(name, [constants.get(name, (None, None)) for constants in searched]) for name in names]
    return tuple(ConstantDifference(name, (a[0], b[0]), (a[1], b[1])) for name, (a, b) in rows)


def _searched(calibration: Calibration) -> dict[str, tuple[float, float]]:
    """Coordinate and standard deviation of each constant that was searched."""
    posterior = calibration.posterior
    rows = zip(posterior.unknowns.names, posterior.point, np.sqrt(np.diag(posterior.covariance)), strict=True)
    return {name: (float(point), float(std)) for name, point, std in list(rows)[len(PARAMETERS) :]}


def _settings(first: Calibration, second: Calibration) -> dict[str, tuple[Any, Any]]:
    facts = [_facts(calibration) for calibration in (first, second)]
    names = dict.fromkeys([*facts[0], *facts[1]])
    if first.method != second.method:  # settings of only one method are no difference
        names = {name: None for name in names if name in facts[0] and name in facts[1]}
    pairs = {name: (facts[0].get(name), facts[1].get(name)) for name in names}
    return {name: pair for name, pair in pairs.items() if pair[0] != pair[1]}


def _facts(calibration: Calibration) -> dict[str, Any]:
    nominal, fault = calibration.nominal, calibration.nominal.fault
    conditions = [fit.condition for fit in calibration.fits]
    return {
        "pump": nominal.pump.name,
        "fault": None if fault is None else {"kind": type(fault).__name__, **asdict(fault)},
        "topology": nominal.topology,
        "speed [rad/s]": [condition.speed for condition in conditions],
        "discharge pressure [Pa]": [condition.discharge_pressure for condition in conditions],
        "nominal values": [estimate.nominal for estimate in calibration.estimates],
        "bounds": [list(estimate.bounds) for estimate in calibration.estimates],
        "constants searched": list(calibration.posterior.unknowns.names[len(PARAMETERS) :]),
        "channels measured": list(calibration.posterior.channels),
        "method": calibration.method,
        **calibration.settings,
        "version": calibration.version,
    }


def _recordings(
    first: Calibration, second: Calibration
) -> tuple[tuple[str, ...], tuple[tuple[str, ...], tuple[str, ...]]]:
    hashes = [set(calibration.recording_hashes.values()) for calibration in (first, second)]
    both = hashes[0] & hashes[1]
    shared = tuple(name for name, value in first.recording_hashes.items() if value in both)
    alone = [
        tuple(name for name, value in calibration.recording_hashes.items() if value not in both)
        for calibration in (first, second)
    ]
    return shared, (alone[0], alone[1])


def _notes(first: Calibration, second: Calibration, shared: tuple[str, ...], settings: Mapping[str, Any]) -> list[str]:
    notes = []
    if shared:
        notes.append(
            f"both were calibrated on {len(shared)} of the same recordings: they are not independent, and agree better "
            "than their intervals say."
        )
    same = {name for name in first.recording_hashes if name in second.recording_hashes} - set(shared)
    if same:
        notes.append(f"{', '.join(sorted(same))}: the same name stands for different samples.")
    for name in ("pump", "fault", "topology", "discharge pressure [Pa]"):
        if name in settings:
            notes.append(f"{name} differs ({settings[name][0]}, {settings[name][1]}): values need not be the same.")
    weak = [
        a.letter
        for a, b in zip(first.estimates, second.estimates, strict=True)
        if "not identified" in (a.verdict, b.verdict)
    ]
    if weak:
        notes.append(f"{', '.join(weak)}: not identified in at least one of them; its difference means nothing.")
    return notes
