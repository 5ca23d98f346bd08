"""What to record next: the interval widths that each candidate recording is expected to leave.

The twin is linearized around the calibrated values. A candidate adds the lines that the calibrated
twin has at its operating point, with the derivatives, the expected noise and the model error that a
calibration would give them; the covariance is that of `posterior_covariance` (Gauss-Newton, so
everything is normal and no candidate depends on what it will read; Lindley 1956,
doi:10.1214/aoms/1177728069). Candidates are ranked by the total width of the six 90 % intervals,
the sum of ln(greatest / least), because narrow intervals of single values are what a calibration is
for.

- Noise falls with the root of the length; the model error of a line does not. So a repetition at an
  operating point that was recorded is worth little, and so is a longer recording, where noise is
  not what limits the values.
- Errors at two operating points count as independent, as in a calibration. Candidates should lie
  well apart.
- The films are taken as the same at each operating point.
"""

import math
from collections.abc import Mapping, Sequence
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
from swashtwin.calibration.posterior import Estimate, interval_around, sandwich
from swashtwin.calibration.result import Calibration
from swashtwin.calibration.spectrum_objective import Comparison, Objective
from swashtwin.calibration.unknowns import VALUES
from swashtwin.foundation import InputError, one_thread
from swashtwin.physics import Twin
from swashtwin.pump import OperatingCondition

FACTORS = (2 / 3, 1.0, 3 / 2)
"""Candidates where nothing is named: these factors on the mean speed and pressure that were
calibrated on, as far as the pump's rating allows.
"""

LEAST_REVOLUTIONS = 16
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
    total_width: float
    """Expected sum over the six values of ln(greatest / least) of the 90 % interval."""
    narrowing_factors: Mapping[str, float]
    """By what factor each value's ln interval is expected to shrink, by letter."""


@dataclass(frozen=True)
class RecordingPlan:
    """What to record next."""

    total_width: float
    """Present sum over the six values of ln(greatest / least) of the 90 % interval."""
    candidates: tuple[CandidateRecording, ...]
    """Candidates, the one with the least expected width first."""


def total_width(estimates: Sequence[Estimate]) -> float:
    """Sum of ln(greatest / least) of the intervals of `estimates`."""
    return sum(math.log(estimate.interval[1] / estimate.interval[0]) for estimate in estimates)


def plan_recording(
    calibration: Calibration,
    *,
    speeds: Sequence[float] | None = None,
    pressures: Sequence[float] | None = None,
    sensors: Sequence[Sequence[str]] | None = None,
) -> RecordingPlan:
    """Every combination of the given speeds, pressures and sensor sets, the most useful recording
    first.

    The pump has the fault that it was calibrated with, mostly none; each recording is as long as
    those before are on average. Combinations of fewer than 16 revolutions are left out, since no
    calibration takes them.

    Parameters
    ----------
    speeds : shaft speeds [rad/s] that can be run; by default 2/3, 1 and 3/2 times the mean one
        calibrated on, those above the pump's rated speed being that or the greatest calibrated on.
    pressures : absolute discharge pressures [Pa]; by default the same factors on the mean one,
        within the rated one.
    sensors : sets of sensors of the pump, by name; by default those calibrated on. Sensors not used
        before have gains, cross-talk and residues of their own, with the priors of the others.

    Raises
    ------
    InputError
        A sensor that the pump does not have, no candidate or none of 16 revolutions, or a speed at
        which no line lies in the band.
    """
    available = calibration.nominal.pump.channels
    sets = (
        [calibration.posterior.channels] if sensors is None else [tuple(names) for names in sensors]
    )
    for names in sets:
        if not names or len(set(names)) < len(names) or not set(names) <= set(available):
            raise InputError(
                f"sensors ({', '.join(names)}) must be different sensors of the pump, which has "
                f"{', '.join(available)}; add others to the pump file and calibrate with it."
            )
    forecast = _Forecast(calibration, sets)
    speeds = forecast.around("speed") if speeds is None else speeds
    pressures = forecast.around("discharge_pressure") if pressures is None else pressures
    conditions = [
        forecast.present[0].condition.replace(speed=speed, discharge_pressure=pressure)
        for speed, pressure in product(speeds, pressures)
    ]
    if not (conditions and sets):
        raise InputError("name at least one speed, pressure and set of sensors, or leave it out.")
    conditions = [
        each for each in conditions if forecast.duration * each.shaft_frequency >= LEAST_REVOLUTIONS
    ]
    if not conditions:
        raise InputError(
            f"each of these recordings is shorter than {LEAST_REVOLUTIONS} revolutions: record longer."
        )
    with one_thread():
        before = forecast.covariance(forecast.present)
        rows = []
        for condition, channels in product(conditions, sets):
            after = forecast.covariance(forecast.with_recording(condition, channels))
            share = np.sqrt(np.diag(after) / np.diag(before))
            estimates = [
                replace(
                    each, interval=interval_around(each.value, each.log_std * factor, each.bounds)
                )
                for each, factor in zip(calibration.estimates, share.tolist(), strict=True)
            ]
            pairs = zip(calibration.estimates, estimates, strict=True)
            candidate = CandidateRecording(
                speed=condition.speed,
                discharge_pressure=condition.discharge_pressure,
                duration=forecast.duration,
                channels=channels,
                total_width=total_width(estimates),
                narrowing_factors={
                    old.symbol: total_width([old]) / total_width([new]) for old, new in pairs
                },
            )
            rows.append(candidate)
    return RecordingPlan(
        total_width(calibration.estimates), tuple(sorted(rows, key=lambda row: row.total_width))
    )


@dataclass(frozen=True, eq=False)
class _Part:
    """Recordings at one operating point with one set of sensors."""

    condition: OperatingCondition
    channels: tuple[str, ...]
    orders: Int[np.ndarray, " order"]
    deviation: Float[np.ndarray, "channel order"]
    """Standard deviation of the lines from noise alone [m/s^2]."""
    recordings: int

    @property
    def frequency(self) -> Float[np.ndarray, " order"]:
        """Frequencies of the lines [Hz]."""
        return self.orders * self.condition.shaft_frequency

    def with_one_more(self, noise: Float[np.ndarray, "channel order"]) -> "_Part":
        """With a further recording of that deviation in the mean."""
        count = self.recordings + 1
        deviation = np.sqrt((self.recordings * self.deviation) ** 2 + noise**2) / count
        return replace(self, deviation=deviation, recordings=count)


class _Forecast:
    """What a calibration knows, and what a further recording would add."""

    def __init__(self, calibration: Calibration, sets: Sequence[tuple[str, ...]]) -> None:
        posterior, fits = calibration.posterior, calibration.fits
        self.calibration = calibration
        self.unknowns, self.point, self.channels = (
            posterior.unknowns,
            posterior.point,
            posterior.channels,
        )
        self.present = [
            _Part(
                fit.condition,
                fit.spectra.channels,
                fit.spectra.orders,
                fit.spectra.deviation,
                len(fit.recording_ids),
            )
            for fit in fits
        ]
        self._twin = cache(self._twin_at)  # its chamber pressures take long
        self._linear: dict[tuple[OperatingCondition, tuple[str, ...]], Linearization] = {}
        seconds = [fit.duration for fit in fits]
        self.duration = sum(seconds) / len(calibration.recording_ids)
        self._density: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        """Frequencies [Hz] of all lines of a channel, and their variance times the time recorded
        [(m/s^2)^2 s].
        """
        for name in posterior.channels:
            pairs = [
                (part, time)
                for part, time in zip(self.present, seconds, strict=True)
                if name in part.channels
            ]
            frequency = np.concatenate([part.frequency for part, _ in pairs])
            variance = np.concatenate(
                [time * part.deviation[part.channels.index(name)] ** 2 for part, time in pairs]
            )
            order = np.argsort(frequency)
            self._density[name] = frequency[order], variance[order]
        measured = [
            self._comparison(part, fit.spectra.measured)
            for part, fit in zip(self.present, fits, strict=True)
        ]
        around = linearize(Objective(tuple(measured), self.unknowns), self.point)
        self._discrepancy = estimate_discrepancy(around)
        further = [name for names in sets for name in names if name not in self.channels]
        self.channels = (*self.channels, *dict.fromkeys(further))
        self.unknowns = posterior.unknowns.changed(self.channels)
        self.point = self.unknowns.center.copy()
        self.point[[self.unknowns.names.index(name) for name in posterior.unknowns.names]] = (
            posterior.point
        )

    def around(self, name: str) -> list[float]:
        """`FACTORS` on the mean speed or discharge pressure, none above the pump's rating and all
        that was run.
        """
        run, rated = (
            [getattr(part.condition, name) for part in self.present],
            self.calibration.nominal.pump.rated,
        )
        most = math.inf if rated is None else max(getattr(rated, name), *run)
        return sorted({min(factor * float(np.mean(run)), most) for factor in FACTORS})

    def with_recording(
        self, condition: OperatingCondition, channels: tuple[str, ...]
    ) -> list[_Part]:
        """The present parts and one more recording; at the operating point and with the sensors of
        one, in its mean.
        """
        points = (part.condition for part in self.present)
        same = next(
            (old for old in points if old.matches(condition, speed=LINE_SPEED_TOLERANCE)), condition
        )
        settings = self.calibration.settings
        orders = line_orders(self._twin(same), tuple(settings["band"]), settings["lines"])
        orders = orders[np.isin(orders, self._twin(same).orders)]
        part = _Part(same, channels, orders, np.empty((len(channels), len(orders))), 1)
        part = replace(
            part, deviation=self._noise(part.frequency, channels) / math.sqrt(self.duration)
        )
        kin = [old for old in self.present if (old.condition, old.channels) == (same, channels)]
        others = [old for old in self.present if old not in kin]
        return [*others, kin[0].with_one_more(part.deviation) if kin else part]

    def covariance(self, parts: Sequence[_Part]) -> Float[np.ndarray, "6 6"]:
        """Expected covariance of the logarithms of the six values."""
        linear = [self._linearized(part) for part in parts]
        around = Linearization(
            objective=replace(
                linear[0].objective,
                comparisons=tuple(part.objective.comparisons[0] for part in linear),
            ),
            point=self.point,
            residual=np.concatenate([part.residual for part in linear]),
            slope=np.concatenate([part.slope for part in linear]),
            sigma=np.concatenate([part.objective.sigma.numpy() for part in linear]),
        )
        return sandwich(around, noise_covariance(around, self._discrepancy))[VALUES, VALUES]

    def _linearized(self, part: _Part) -> Linearization:
        """The part around the calibrated point, where it reads just what the calibrated twin has.

        Lines and derivatives are computed once, since they do not depend on the noise.
        """
        key = (part.condition, part.channels)
        if key not in self._linear:
            silent = self._comparison(part, np.zeros(part.deviation.shape))
            with torch.no_grad():
                lines = silent.lines(self.unknowns, torch.as_tensor(self.point)).numpy()
            read = replace(silent.measurement, amplitude=np.abs(lines))
            if self.calibration.settings["phases"]:
                read = replace(read, phasor=lines, phasor_deviation=part.deviation)
            comparison = replace(silent, measurement=read)
            self._linear[key] = linearize(Objective((comparison,), self.unknowns), self.point)
        linear = self._linear[key]
        (comparison,) = linear.objective.comparisons
        phasor_deviation = part.deviation if comparison.has_phases else None
        read = replace(
            comparison.measurement, deviation=part.deviation, phasor_deviation=phasor_deviation
        )
        comparison = replace(comparison, measurement=read)
        return replace(linear, objective=replace(linear.objective, comparisons=(comparison,)))

    def _comparison(self, part: _Part, amplitude: Float[np.ndarray, "channel order"]) -> Comparison:
        settings = self.calibration.settings
        measurement = Measurement(
            channels=part.channels,
            orders=part.orders,
            amplitude=amplitude,
            deviation=part.deviation,
            recordings=(),
            excluded_recordings=(),
            band=tuple(settings["band"]),
            lines=settings["lines"],
        )
        return Comparison(self._twin(part.condition), measurement, searched=self.channels)

    def _twin_at(self, condition: OperatingCondition) -> Twin:
        """The nominal twin at a condition."""
        twin = self.calibration.nominal.at(condition)
        lowest = twin.pump.rotating_group.piston_count * condition.shaft_frequency
        highest = max(self.calibration.settings["band"][1], lowest) + condition.shaft_frequency
        return replace(twin, bandwidth=highest, path=None)

    def _noise(
        self, frequency: Float[np.ndarray, " order"], channels: tuple[str, ...]
    ) -> Float[np.ndarray, "channel order"]:
        """Standard deviation of the lines of a recording of 1 s [m/s^2]; of a new sensor that of
        the mean variance.
        """
        rows = {name: np.interp(frequency, *density) for name, density in self._density.items()}
        mean = np.mean(list(rows.values()), axis=0)
        variance = {**dict.fromkeys(channels, mean), **rows}
        return np.sqrt(np.stack([variance[name] for name in channels]))
