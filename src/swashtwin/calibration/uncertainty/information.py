"""Expected information gain of further measurements.

Linearization at the values found, everything is normal, and a measurement's gain does not depend on what it will read:
half the fall of the logarithm of the posterior covariance's determinant (Bayesian D-optimality; Lindley 1956,
doi:10.1214/aoms/1177728069, Chaloner and Verdinelli 1995, doi:10.1214/ss/1177009939), here of the six values with all
nuisances integrated out. The discrepancy counts as estimated: a channel's error is the same in its next recording, so a
repetition is worth little, and a new position much.

Values that move with pressure and speed are not followed: at another condition the twin has the same films.
"""

import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import torch
from jaxtyping import Float

from swashtwin.calibration.objective.measurement import Measurement
from swashtwin.calibration.objective.spectrum_objective import Comparison, Objective
from swashtwin.calibration.objective.unknowns import VALUES, Unknowns
from swashtwin.calibration.uncertainty.discrepancy import Discrepancy, estimate_discrepancy, linearize, noise_covariance
from swashtwin.foundation import InputError, MPa, mm, rpm
from swashtwin.physics import Twin, prepare
from swashtwin.pump import Fault, Sensor, SwashPlateDefect

PRESSURES = (MPa(5), MPa(10), MPa(15))
SPEEDS = (rpm(600), rpm(1200))
DIRECTIONS = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
DEFECT = SwashPlateDefect(length=mm(30), width=mm(24), depth=mm(0.6))
"""The paper's defect, where a healthy pump was measured."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A measurement that could be taken."""

    name: str
    """What to do, in words."""
    twin: Twin | None = None
    """The pump as it would be measured: at another condition, with or without its fault; None is as before."""
    sensor: Sensor | None = None
    """An accelerometer to be added in all recordings; None adds none."""


@dataclass(frozen=True)
class Gain:
    """Information gain of one further measurement."""

    name: str
    """What to do."""
    nats: float
    """Expected information gain on the six values [nat]; ln 2 halves the interval of one of them."""
    narrower: tuple[tuple[str, float], ...]
    """By what factor each value's interval would shrink, by letter."""

    @property
    def words(self) -> str:
        """The gain in a sentence."""
        letter, factor = max(self.narrower, key=lambda pair: pair[1])
        return f"{self.name}: {self.nats:.2f} nat; most for {letter}, whose interval shrinks {factor:.2g} times"

    def to_dict(self) -> dict[str, Any]:
        """All of it as JSON can hold it."""
        return {**asdict(self), "narrower": dict(self.narrower)}


def expected_information_gain(
    objective: Objective,
    point: Float[np.ndarray, " unknown"],
    candidates: Iterable[Candidate] | None = None,
) -> tuple[Gain, ...]:
    """Information gain of each candidate beside the measurements of `objective`, at `point`, the best first.

    Parameters
    ----------
    candidates : `candidates_for` of the objective by default.

    Raises
    ------
    InputError
        The objective compares phases, or a candidate has no line within the band.
    """
    objective.require_amplitudes("the expected information gain")
    candidates = candidates_for(objective) if candidates is None else tuple(candidates)
    _prepare([_limited(objective, candidate.twin) for candidate in candidates if candidate.twin is not None])
    around = linearize(objective, point)
    discrepancy = estimate_discrepancy(around)
    covariance = _posterior(objective, np.asarray(point), discrepancy)
    gains = []
    for candidate in candidates:
        wider, moved = objective, np.asarray(point)
        if candidate.sensor is not None:
            wider, moved = _with_sensor(wider, moved, candidate.sensor)
        if candidate.twin is not None:
            wider = _with_twin(wider, moved, _limited(objective, candidate.twin))
        covariance_after = _posterior(wider, moved, discrepancy)
        narrower = np.sqrt(np.diag(covariance) / np.diag(covariance_after))
        letters = objective.unknowns.names[VALUES]
        nats = (np.linalg.slogdet(covariance)[1] - np.linalg.slogdet(covariance_after)[1]) / 2
        gains.append(Gain(candidate.name, float(nats), tuple(zip(letters, map(float, narrower), strict=True))))
    return tuple(sorted(gains, key=lambda gain: -gain.nats))


def candidates_for(objective: Objective) -> tuple[Candidate, ...]:
    """The paper's other pressures, two other speeds, the pump without (or with) its defect, and other sensors.

    Sensors: at each place where one sits, the directions that it does not measure.
    """
    twin = objective.twin
    measured = [comparison.twin.condition for comparison in objective.comparisons]
    candidates = [
        Candidate(f"also at {level / 1e6:g} MPa", twin.at(twin.condition.replaced(discharge_pressure=level)))
        for level in PRESSURES
        if all(abs(condition.discharge_pressure / level - 1) > 0.1 for condition in measured)
    ]
    candidates += [
        Candidate(f"also at {speed * 30 / math.pi:.0f} rev/min", twin.at(twin.condition.replaced(speed=speed)))
        for speed in SPEEDS
        if all(abs(condition.speed / speed - 1) > 0.1 for condition in measured)
    ]
    other: Fault | None = DEFECT if twin.fault is None else None
    name = "also with a swash plate defect" if twin.fault is None else "also healthy"
    candidates.append(Candidate(name, twin.with_fault(other)))
    return (*candidates, *(Candidate(f"also {sensor.name}", sensor=sensor) for sensor in _free_sensors(objective)))


def _free_sensors(objective: Objective) -> list[Sensor]:
    channels = objective.comparisons[0].measurement.channels
    sensors = objective.twin.pump.sensors
    idle = [sensor for sensor in sensors if sensor.name not in channels]
    used = [(sensor.position, tuple(map(abs, sensor.direction))) for sensor in sensors]
    for site in sensors:
        for axis, direction in DIRECTIONS.items():
            if (site.position, direction) not in used:
                used.append((site.position, direction))
                idle.append(Sensor(f"{axis} where {site.name} sits", site.position, direction))
    return idle


def _limited(objective: Objective, twin: Twin) -> Twin:
    """`twin` within the band of what was measured, as the measurement's twin is."""
    last = objective.comparisons[0].measurement.orders[-1]
    highest = float(last) * objective.twin.condition.shaft_frequency
    shaft = twin.condition.shaft_frequency
    return replace(twin, bandwidth=(math.floor(highest / shaft + 0.01) + 0.5) * shaft, path=None)


def _prepare(twins: list[Twin]) -> None:
    if twins:
        prepare(twins)


def _with_twin(objective: Objective, point: np.ndarray, twin: Twin) -> Objective:
    """With the piston-pass lines of `twin`, which shares everything but condition and fault, as one more comparison."""
    first = objective.comparisons[0]
    count = twin.pump.rotating_group.piston_count
    low = first.measurement.orders[0] * first.twin.condition.shaft_frequency
    orders = twin.orders[twin.orders % count == 0]
    orders = orders[orders * twin.condition.shaft_frequency >= 0.99 * min(low, count * twin.condition.shaft_frequency)]
    if not len(orders):
        raise InputError("a candidate has no piston-pass line within the band that was measured.")
    pump = first.twin.pump  # which may have one more sensor than the candidate's
    added = _expected(first, replace(twin, pump=pump), orders, objective.unknowns, point)
    return replace(objective, comparisons=(*objective.comparisons, added))


def _expected(
    comparison: Comparison, twin: Twin, orders: np.ndarray, unknowns: Unknowns, point: np.ndarray
) -> Comparison:
    """Comparison of `twin` with its own lines at `point`, without scatter."""
    blank = np.zeros((len(comparison.measurement.channels), len(orders)))
    empty = replace(comparison.measurement, orders=orders, amplitude=blank, deviation=blank, recordings=(), left_out=())
    with torch.no_grad():
        silent = Comparison(twin, empty, searched=comparison.searched)
        lines = silent.amplitude(unknowns, torch.as_tensor(point)).numpy()
    return replace(silent, measurement=replace(empty, amplitude=lines))


def _with_sensor(objective: Objective, point: np.ndarray, sensor: Sensor) -> tuple[Objective, np.ndarray]:
    """With one more channel in every comparison; its gain and residues are searched where those of the others are."""
    unknowns, moved = with_channel(objective.unknowns, point, sensor.name)
    searched = (*objective.channels, sensor.name)
    comparisons = []
    for comparison in objective.comparisons:
        pump = comparison.twin.pump
        is_known = sensor.name in pump.channels
        twin = (
            comparison.twin
            if is_known
            else _sharing(
                comparison.twin, replace(comparison.twin, pump=replace(pump, sensors=(*pump.sensors, sensor)))
            )
        )
        channels = (*comparison.measurement.channels, sensor.name)
        wider = replace(comparison.measurement, channels=channels)
        full = _expected(
            replace(comparison, measurement=wider, searched=searched),
            twin,
            comparison.measurement.orders,
            unknowns,
            moved,
        )
        amplitude = np.concatenate([comparison.measurement.amplitude, full.measurement.amplitude[-1:]])
        deviation = np.concatenate([comparison.measurement.deviation, np.zeros_like(amplitude[-1:])])
        measurement: Measurement = replace(wider, amplitude=amplitude, deviation=deviation)
        comparisons.append(Comparison(twin, measurement, searched=searched))
    return replace(objective, comparisons=tuple(comparisons), unknowns=unknowns), moved


def _sharing(twin: Twin, other: Twin) -> Twin:
    """`other`, whose chamber pressures are those of `twin`."""
    other.__dict__["pressure"] = twin.pressure  # where cached_property keeps it
    return other


def with_channel(unknowns: Unknowns, point: np.ndarray, channel: str) -> tuple[Unknowns, np.ndarray]:
    """Coordinates with the gain and residues of one more channel, where those of the others are searched."""
    names = list(unknowns.names)
    rows = {name: list(getattr(unknowns, name)) for name in ("start", "center", "deviation", "lower", "upper")}
    rows["point"] = list(point)

    def insert(index: int, name: str, like: int) -> None:
        names.insert(index, name)
        for label, row in rows.items():
            row.insert(index, 0.0 if label == "point" else row[like])

    if unknowns.has_gains:
        insert(unknowns.first_of_path + unknowns.n_channels, f"gain {channel}", unknowns.first_of_path)
    shares = 2 * unknowns.n_channels if unknowns.n_cross_talk else 0
    first = unknowns.first_of_modes + unknowns.has_gains
    for number in range(shares):
        insert(first + number, f"cross-talk {number + 1} of {channel}", first - 1)
    for mode in range(1, unknowns.modes + 1):
        insert(len(names), f"mode {mode} in {channel}", len(names) - 1)
    moved = np.array(rows.pop("point"))
    arrays: dict[str, Any] = {label: np.array(row) for label, row in rows.items()}
    wider = replace(unknowns, n_channels=unknowns.n_channels + 1, n_cross_talk=unknowns.n_cross_talk + shares)
    return replace(wider, names=tuple(names), **arrays), moved


def _posterior(objective: Objective, point: np.ndarray, discrepancy: Discrepancy) -> np.ndarray:
    """Covariance of the six values where every line is weighed as it deserves."""
    around = linearize(objective, point)
    prior = objective.unknowns.deviation
    root = np.linalg.cholesky(noise_covariance(around, discrepancy))
    scaled = np.linalg.solve(root, around.slope) * prior
    covariance = np.linalg.inv(scaled.T @ scaled + np.eye(len(prior))) * np.outer(prior, prior)
    return covariance[VALUES, VALUES]
