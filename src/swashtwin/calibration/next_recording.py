"""What to record next: the interval widths that each candidate recording is expected to leave.

The twin is linearized around the calibrated values. A candidate adds the lines that the calibrated
twin has at its operating point, with the derivatives, the expected noise and the model error that a
calibration would give them; the covariance is that of `posterior_covariance` (Gauss-Newton, so
everything is normal and no candidate depends on what it will read; Lindley 1956,
doi:10.1214/aoms/1177728069). Candidates are ranked by the total width of the six 90 % intervals,
the sum of ln(upper / lower), because narrow intervals of single values are what a calibration is
for.

- Noise falls with the root of the length; the model error of a line does not. So a repetition at an
  operating point that was recorded is worth little, and so is a longer recording if noise is not
  what limits the values.
- Errors at two operating points count as independent, as in a calibration. Candidates should lie
  well apart.
- The films are taken as the same at each operating point.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import product

import numpy as np
import torch
from jaxtyping import Float, Int

from swashtwin.calibration.discrepancy import (
    Linearization,
    estimate_discrepancy,
    linearize,
    noise_covariance,
)
from swashtwin.calibration.measurement import LINE_SPEED_TOLERANCE, Measurement, line_orders
from swashtwin.calibration.posterior import Estimate, compute_interval, sandwich_covariance
from swashtwin.calibration.result import Calibration
from swashtwin.calibration.spectrum_objective import Comparison, Objective
from swashtwin.calibration.unknowns import VALUE_SLICE
from swashtwin.foundation import InputError, one_thread
from swashtwin.physics import Twin
from swashtwin.pump import OperatingCondition

CANDIDATE_FACTORS = (2 / 3, 1.0, 3 / 2)
"""Default candidates: these factors on the mean speed and pressure of the calibration, limited by
the pump's rating.
"""

MIN_WIDTH_FALL = 0.05
"""Fall of the total width of the intervals below which a further recording adds nothing: less than
1 % of each of the six intervals.
"""
MAX_SEQUENCE = 3
"""Number of further recordings that are planned one after another."""

MIN_REVOLUTIONS = 16
"""A calibration takes no shorter recording, since the scatter of its lines is that of four parts of
it.
"""


@dataclass(frozen=True)
class CandidateRecording:
    """A recording that could be taken, and what it is expected to leave of the interval widths."""

    speed: float
    """Shaft speed [rad/s]."""
    discharge_pressure: float
    """Absolute discharge pressure [Pa]."""
    duration: float
    """Length [s]."""
    channels: tuple[str, ...]
    """Sensors."""
    total_interval_width: float
    """Expected sum over the six values of ln(upper / lower) of the 90 % interval."""
    narrowing_factors: Mapping[str, float]
    """Factor by which each value's ln interval is expected to shrink, by symbol."""
    expected_factors: Mapping[str, float]
    """Factor within which each value is then expected to be known, by symbol: the root of upper /
    lower of its 90 % interval.
    """


@dataclass(frozen=True)
class RecordingPlan:
    """What to record next."""

    total_interval_width: float
    """Present sum over the six values of ln(upper / lower) of the 90 % interval."""
    candidates: tuple[CandidateRecording, ...]
    """Candidates, the one with the smallest expected width first."""
    sequence: tuple[CandidateRecording, ...]
    """The best candidates to record one after another, at most `MAX_SEQUENCE`: each with what it is
    expected to leave together with those before it. It ends at the first one that narrows nothing.
    """
    excluded_speeds: tuple[float, ...]
    """Speeds [rad/s] without candidates, since a recording of their length has fewer than 16
    revolutions there (`MIN_REVOLUTIONS`).
    """
    required_duration: float
    """Length [s] of which a recording at each of the speeds has 16 revolutions."""


def sum_interval_widths(estimates: Sequence[Estimate]) -> float:
    """Return the sum of ln(upper / lower) of the intervals of `estimates`."""
    return sum(math.log(estimate.interval[1] / estimate.interval[0]) for estimate in estimates)


def plan_recording(
    calibration: Calibration,
    *,
    speeds: Sequence[float] | None = None,
    pressures: Sequence[float] | None = None,
    sensors: Sequence[Sequence[str]] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> RecordingPlan:
    """Return every combination of the given speeds, pressures and sensor sets, the most useful
    recording first.

    The pump has the fault that it was calibrated with, mostly none; each recording is as long as
    the calibration's recordings are on average. Combinations of fewer than 16 revolutions are
    excluded, since no calibration takes them (`RecordingPlan.excluded_speeds`).

    Parameters
    ----------
    speeds : shaft speeds [rad/s] that can be run; by default 2/3, 1 and 3/2 times the mean one of
        the calibration, limited to the pump's rated speed or the greatest one of the calibration.
    pressures : absolute discharge pressures [Pa]; by default the same factors on the mean one,
        within the rated one.
    sensors : sets of sensors of the pump, by name; by default those of the calibration. Further
        sensors get gains, cross-talk and residues with the priors of the others.
    progress : called with the number of computed candidates, and the most that are computed.

    Raises
    ------
    InputError
        The pump does not have a sensor, there is no candidate or none of 16 revolutions, or no line
        lies in the band at a speed.
    """
    sensor_sets = _check_sensors(calibration, sensors)
    forecast = _Forecast(calibration, sensor_sets)

    if speeds is None:
        speeds = forecast.candidate_values("speed")
    if pressures is None:
        pressures = forecast.candidate_values("discharge_pressure")
    conditions = [
        forecast.present[0].condition.replace(speed=speed, discharge_pressure=pressure)
        for speed, pressure in product(speeds, pressures)
    ]
    if not (conditions and sensor_sets):
        raise InputError("Specify at least one speed, pressure and set of sensors, or omit it.")
    long_enough = [
        condition
        for condition in conditions
        if forecast.duration * condition.shaft_frequency >= MIN_REVOLUTIONS
    ]
    excluded_speeds = {condition.speed for condition in conditions if condition not in long_enough}
    if not long_enough:
        raise InputError(
            f"Each of these recordings is shorter than {MIN_REVOLUTIONS} revolutions: record "
            "longer."
        )

    with one_thread():
        options = list(product(long_enough, sensor_sets))
        candidates, sequence = _rank_candidates(forecast, options, progress)
    return RecordingPlan(
        total_interval_width=sum_interval_widths(calibration.estimates),
        candidates=candidates,
        sequence=sequence,
        excluded_speeds=tuple(sorted(excluded_speeds)),
        required_duration=max(
            MIN_REVOLUTIONS / condition.shaft_frequency for condition in conditions
        ),
    )


def _rank_candidates(
    forecast: "_Forecast",
    options: Sequence[tuple[OperatingCondition, tuple[str, ...]]],
    progress: Callable[[int, int], None] | None,
) -> tuple[tuple[CandidateRecording, ...], tuple[CandidateRecording, ...]]:
    """Return the candidates, the best first, and the best ones to record one after another."""
    present_covariance = forecast.covariance(forecast.present)
    groups = forecast.present
    width = sum_interval_widths(forecast.calibration.estimates)
    candidates: tuple[CandidateRecording, ...] = ()
    sequence: list[CandidateRecording] = []
    for round_number in range(MAX_SEQUENCE):
        evaluated = []
        for condition, channels in options:
            extended = forecast.with_recording(groups, condition, channels)
            candidate = _evaluate_candidate(
                forecast, extended, condition, channels, present_covariance
            )
            evaluated.append((candidate, extended))
            if progress is not None:
                n_computed = round_number * len(options) + len(evaluated)
                progress(n_computed, MAX_SEQUENCE * len(options))
        evaluated.sort(key=lambda pair: pair[0].total_interval_width)
        if not candidates:
            candidates = tuple(candidate for candidate, _ in evaluated)

        best, extended = evaluated[0]
        if best.total_interval_width > width - MIN_WIDTH_FALL:
            break
        sequence.append(best)
        groups = extended
        width = best.total_interval_width
    return candidates, tuple(sequence)


def _check_sensors(
    calibration: Calibration, sensors: Sequence[Sequence[str]] | None
) -> list[tuple[str, ...]]:
    """Return the sets of sensors; refuse those that the pump does not have."""
    if sensors is None:
        return [calibration.posterior.channels]

    available = calibration.nominal.pump.channels
    sensor_sets = [tuple(names) for names in sensors]
    for names in sensor_sets:
        if not names or len(set(names)) < len(names) or not set(names) <= set(available):
            raise InputError(
                f"sensors ({', '.join(names)}) must be different sensors of the pump, which has "
                f"{', '.join(available)}. Add others to the pump file and calibrate with it."
            )
    return sensor_sets


def _evaluate_candidate(
    forecast: "_Forecast",
    extended: Sequence["_RecordingGroup"],
    condition: OperatingCondition,
    channels: tuple[str, ...],
    present_covariance: Float[np.ndarray, "6 6"],
) -> CandidateRecording:
    """Return the candidate with the interval widths that it is expected to leave.

    Parameters
    ----------
    extended : groups of recordings that contain the candidate.
    """
    covariance = forecast.covariance(extended)
    std_ratio = np.sqrt(np.diag(covariance) / np.diag(present_covariance)).tolist()

    expected = []
    narrowing_factors = {}
    expected_factors = {}
    for estimate, ratio in zip(forecast.calibration.estimates, std_ratio, strict=True):
        interval = compute_interval(estimate.value, estimate.log_std * ratio, estimate.bounds)
        narrowed = replace(estimate, interval=interval)
        expected.append(narrowed)
        expected_factors[estimate.symbol] = math.sqrt(interval[1] / interval[0])
        narrowing_factors[estimate.symbol] = sum_interval_widths([estimate]) / sum_interval_widths(
            [narrowed]
        )

    return CandidateRecording(
        speed=condition.speed,
        discharge_pressure=condition.discharge_pressure,
        duration=forecast.duration,
        channels=channels,
        total_interval_width=sum_interval_widths(expected),
        narrowing_factors=narrowing_factors,
        expected_factors=expected_factors,
    )


@dataclass(frozen=True, eq=False)
class _RecordingGroup:
    """Recordings at one operating point with one set of sensors."""

    condition: OperatingCondition
    channels: tuple[str, ...]
    orders: Int[np.ndarray, " order"]
    deviation: Float[np.ndarray, "channel order"]
    """Standard deviation of the lines from noise alone [m/s^2]."""
    n_recordings: int

    @property
    def frequency(self) -> Float[np.ndarray, " order"]:
        """Frequencies of the lines [Hz]."""
        return self.orders * self.condition.shaft_frequency

    def add_recording(self, noise: Float[np.ndarray, "channel order"]) -> "_RecordingGroup":
        """Return the group with a further recording of that deviation in the mean."""
        count = self.n_recordings + 1
        deviation = np.sqrt((self.n_recordings * self.deviation) ** 2 + noise**2) / count
        return replace(self, deviation=deviation, n_recordings=count)


class _Forecast:
    """What a calibration knows, and what a further recording would add."""

    def __init__(self, calibration: Calibration, sensor_sets: Sequence[tuple[str, ...]]) -> None:
        posterior = calibration.posterior
        durations = [fit.duration for fit in calibration.fits]
        self.calibration = calibration
        self.present = [
            _RecordingGroup(
                condition=fit.condition,
                channels=fit.spectra.channels,
                orders=fit.spectra.orders,
                deviation=fit.spectra.deviation,
                n_recordings=len(fit.recording_ids),
            )
            for fit in calibration.fits
        ]
        self.duration = sum(durations) / len(calibration.recording_ids)
        self._noise_density = self._estimate_noise_density(posterior.channels, durations)
        # a twin computes its chamber pressures once, which takes long
        self._twin = cache(self._nominal_twin_at)
        self._linearizations: dict[tuple[OperatingCondition, tuple[str, ...]], Linearization] = {}

        self.channels = posterior.channels
        comparisons = tuple(
            self._compare(group, fit.spectra.measured)
            for group, fit in zip(self.present, calibration.fits, strict=True)
        )
        objective = Objective(comparisons, posterior.unknowns)
        self._discrepancy = estimate_discrepancy(linearize(objective, posterior.point))

        # further sensors have coordinates of their own, which start at their priors' means
        further = [name for names in sensor_sets for name in names if name not in self.channels]
        self.channels = (*self.channels, *dict.fromkeys(further))
        self.unknowns = posterior.unknowns.with_changes(self.channels)
        calibrated = [self.unknowns.names.index(name) for name in posterior.unknowns.names]
        self.point = self.unknowns.center.copy()
        self.point[calibrated] = posterior.point

    def _estimate_noise_density(
        self, channels: tuple[str, ...], durations: Sequence[float]
    ) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Return the frequencies [Hz] of all lines of each channel, and their variance times the
        time recorded [(m/s^2)^2 s].
        """
        densities = {}
        for name in channels:
            frequencies = []
            variances = []
            for group, duration in zip(self.present, durations, strict=True):
                if name in group.channels:
                    deviation = group.deviation[group.channels.index(name)]
                    frequencies.append(group.frequency)
                    variances.append(duration * deviation**2)
            frequency = np.concatenate(frequencies)
            variance = np.concatenate(variances)
            order = np.argsort(frequency)
            densities[name] = (frequency[order], variance[order])
        return densities

    def candidate_values(self, name: str) -> list[float]:
        """Return `CANDIDATE_FACTORS` times the mean speed or discharge pressure, none above both
        the pump's rating and what was run.
        """
        recorded = [getattr(group.condition, name) for group in self.present]
        rated = self.calibration.nominal.pump.rated
        limit = math.inf
        if rated is not None:
            limit = max(getattr(rated, name), *recorded)
        mean = float(np.mean(recorded))
        return sorted({min(factor * mean, limit) for factor in CANDIDATE_FACTORS})

    def with_recording(
        self,
        present: Sequence[_RecordingGroup],
        condition: OperatingCondition,
        channels: tuple[str, ...],
    ) -> list[_RecordingGroup]:
        """Return the `present` groups and one more recording.

        If a group has its operating point and sensors, it joins the mean of that group.
        """
        matching = [
            group.condition
            for group in present
            if group.condition.matches(condition, speed=LINE_SPEED_TOLERANCE)
        ]
        if matching:
            condition = matching[0]

        twin = self._twin(condition)
        settings = self.calibration.settings
        orders = line_orders(twin, tuple(settings["band"]), settings["lines"])
        orders = orders[np.isin(orders, twin.orders)]
        noise = self._line_noise(orders * condition.shaft_frequency, channels)
        deviation = noise / math.sqrt(self.duration)

        groups = []
        extended_group = None
        for group in present:
            if (group.condition, group.channels) == (condition, channels):
                extended_group = group.add_recording(deviation)
            else:
                groups.append(group)
        if extended_group is None:
            extended_group = _RecordingGroup(condition, channels, orders, deviation, 1)
        return [*groups, extended_group]

    def covariance(self, groups: Sequence[_RecordingGroup]) -> Float[np.ndarray, "6 6"]:
        """Return the expected covariance of the logarithms of the six values."""
        parts = [self._linearize(group) for group in groups]
        comparisons = tuple(part.objective.comparisons[0] for part in parts)
        linearization = Linearization(
            objective=replace(parts[0].objective, comparisons=comparisons),
            point=self.point,
            residual=np.concatenate([part.residual for part in parts]),
            slope=np.concatenate([part.slope for part in parts]),
            sigma=np.concatenate([part.objective.sigma.numpy() for part in parts]),
        )
        noise = noise_covariance(linearization, self._discrepancy)
        return sandwich_covariance(linearization, noise)[VALUE_SLICE, VALUE_SLICE]

    def _linearize(self, group: _RecordingGroup) -> Linearization:
        """Return the group linearized about the calibrated values.

        Its measured lines are those of the calibrated twin. Lines and derivatives are computed
        once, since they do not depend on the noise.
        """
        key = (group.condition, group.channels)
        if key not in self._linearizations:
            silent = self._compare(group, np.zeros(group.deviation.shape))
            with torch.no_grad():
                lines = silent.lines(self.unknowns, torch.as_tensor(self.point)).numpy()
            measurement = replace(silent.measurement, amplitude=np.abs(lines))
            if self.calibration.settings["phases"]:
                measurement = replace(measurement, phasor=lines, phasor_deviation=group.deviation)
            comparison = replace(silent, measurement=measurement)
            self._linearizations[key] = linearize(
                Objective((comparison,), self.unknowns), self.point
            )

        linearization = self._linearizations[key]
        (comparison,) = linearization.objective.comparisons
        measurement = replace(comparison.measurement, deviation=group.deviation)
        if comparison.has_phases:
            measurement = replace(measurement, phasor_deviation=group.deviation)
        comparison = replace(comparison, measurement=measurement)
        objective = replace(linearization.objective, comparisons=(comparison,))
        return replace(linearization, objective=objective)

    def _compare(
        self, group: _RecordingGroup, amplitude: Float[np.ndarray, "channel order"]
    ) -> Comparison:
        """Return the comparison of the nominal twin with these amplitudes [m/s^2]."""
        settings = self.calibration.settings
        measurement = Measurement(
            channels=group.channels,
            orders=group.orders,
            amplitude=amplitude,
            deviation=group.deviation,
            recordings=(),
            excluded_recordings=(),
            band=tuple(settings["band"]),
            lines=settings["lines"],
        )
        twin = self._twin(group.condition)
        return Comparison(twin, measurement, searched_channels=self.channels)

    def _nominal_twin_at(self, condition: OperatingCondition) -> Twin:
        """Return the nominal twin at an operating point."""
        twin = self.calibration.nominal.at(condition)
        lowest = twin.pump.rotating_group.piston_count * condition.shaft_frequency
        highest = max(self.calibration.settings["band"][1], lowest) + condition.shaft_frequency
        return replace(twin, bandwidth=highest, path=None)

    def _line_noise(
        self, frequency: Float[np.ndarray, " order"], channels: tuple[str, ...]
    ) -> Float[np.ndarray, "channel order"]:
        """Return the standard deviation of the lines of a recording of 1 s [m/s^2].

        A new sensor gets the mean variance of the others.
        """
        variances: dict[str, np.ndarray] = {
            name: np.interp(frequency, *density) for name, density in self._noise_density.items()
        }
        mean: np.ndarray = np.mean(list(variances.values()), axis=0)
        rows = [variances.get(name, mean) for name in channels]
        return np.sqrt(np.stack(rows))
