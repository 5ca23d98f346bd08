"""What differs between synthetic windows, and what measured windows lend them: noise and gains."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.signal
import torch
from jaxtyping import Bool, Float, Int

from swashtwin.calibration import DEFAULT_BAND
from swashtwin.foundation import InputError, celsius, random_stream
from swashtwin.learning import WindowSet
from swashtwin.physics import Twin
from swashtwin.pump import PRESSURE_TOLERANCE, is_healthy, values_match
from swashtwin.signals import inverse_transform, line_frequencies, power_density, transform


@dataclass(frozen=True)
class Variation:
    """Spreads of what is drawn for each synthetic window, besides the shaft's phase.

    Zero switches a spread off. Speed, pressure and temperature follow docs/explanation/physics.md,
    section 5. Severity, angle, interface values and sensor are our estimates. Severity and angle
    are those of an engineer who knows a fault's typical size and position, but not how they differ
    from pump to pump: 95 % of the severities are within a factor of two, 95 % of the angles within
    10 degrees. Those of version 1 of the virtual rig spread less (docs/bench/rig.md). All interface
    values have the same spread; the uncertainty of a calibration is added to it (`synthesize`).
    """

    speed: float = 0.005
    """Half-width of the uniform spread of the speed, relative."""
    pressure: float = 0.03
    """Half-width of the uniform spread of the discharge pressure, relative."""
    severity: float = 0.35
    """Standard deviation of the logarithm of the fault's severity."""
    angle: float = math.radians(5)
    """Standard deviation of the position of a swash plate or bore defect [rad]."""
    temperature: tuple[float, float] = (celsius(30), celsius(60))
    """Range of the oil temperature [K]; it acts on the leakage only, not on the films' damping."""
    interfaces: float = 0.1
    """Standard deviation of the logarithm of each interface value."""
    sensor: float = 0.04
    """Standard deviation of each channel's gain, relative."""


DEFAULT_VARIATION = Variation()
"""Spread around the twin if none is specified."""


def draw_twin(twin: Twin, variation: Variation, seed: int, index: int) -> Twin:
    """Return the twin with its condition, fault and interface values drawn around its own.

    Parameters
    ----------
    variation : spreads of the draws.
    seed, index : address of the draw: the same pair gives the same twin.
    """
    rng = random_stream(seed, "variation", twin.label, index)
    condition = twin.condition
    speed = condition.speed * (1 + variation.speed * rng.uniform(-1, 1))
    pressure = condition.discharge_pressure * (1 + variation.pressure * rng.uniform(-1, 1))
    condition = replace(
        condition,
        speed=speed,
        discharge_pressure=pressure,
        oil_temperature=rng.uniform(*variation.temperature),
    )

    fault = twin.fault
    if fault is not None:
        fault = fault.scaled(float(np.exp(rng.normal(0, variation.severity))))
        if hasattr(fault, "angle"):
            angle: dict[str, Any] = {"angle": abs(fault.angle + rng.normal(0, variation.angle))}
            fault = replace(fault, **angle)

    values = twin.values.numpy() * np.exp(rng.normal(0, variation.interfaces, 6))
    interfaces = type(twin.pump.interfaces).from_values(values)
    return replace(twin, condition=condition, fault=fault, interfaces=interfaces)


MIN_AUDIBLE_SHARE = 0.3
"""Share of the loudest channel's amplitude below which a line may be cross-talk, which is a tenth
[estimate].
"""
_MIN_POWER = 1e-30

# Windows this much farther from the twin's pressure than the nearest ones still lend noise.
_PRESSURE_MARGIN_PA = 1e4

# Spectral lines on each side of a piston-pass line that it may leak into: the main lobe of a Hann
# taper has a half-width of two.
_LINE_HALF_WIDTH = 2.5


@dataclass(frozen=True, eq=False)
class BackgroundNoise:
    """Noise of random phase with the spectrum of measured windows between piston-pass lines."""

    like: WindowSet
    windows: Int[np.ndarray, " window"]
    """Indices of the windows that one is drawn from."""
    is_clear: Bool[np.ndarray, " frequency"]
    """Whether each line of a window's spectrum is far from the multiples of the piston-pass
    frequency.
    """
    is_healthy: bool
    """Whether the windows are healthy ones at the requested pressure."""

    def gains(self, twin: Twin, sensors: Sequence[int]) -> Float[np.ndarray, " channel"]:
        """Return the factor on the lines of each channel that brings a healthy twin to the windows.

        It is 1 if no window is healthy, and else exp of half the median, over the piston-pass lines
        up to `DEFAULT_BAND` that stand above the noise, of ln (measured power / simulated power):
        no line counts more for being loud, and none is corrected by itself, for that would paint
        the healthy machine's errors over the fault. If the twin predicts that another channel is
        much louder (`MIN_AUDIBLE_SHARE`), the measured line is that channel's cross-talk and gives
        no gain.
        """
        if not self.is_healthy:
            return np.ones(len(sensors))

        healthy_twin = twin.with_fault(None)
        shaft_frequency = twin.condition.shaft_frequency
        piston_count = twin.pump.rotating_group.piston_count
        frequency, power, noise = self._mean_spectrum()
        with torch.no_grad():
            simulated = healthy_twin.acceleration().abs().numpy()[list(sensors)]

        orders = healthy_twin.orders
        is_pass_order = (orders % piston_count == 0) & (orders * shaft_frequency <= DEFAULT_BAND[1])
        nearest_harmonic = np.round(frequency / (piston_count * shaft_frequency)).astype(int)
        log_ratios = []
        for order in orders[is_pass_order]:
            is_line = ~self.is_clear & (nearest_harmonic == order // piston_count)
            line_noise = noise[:, is_line].sum(axis=1)
            line_power = power[:, is_line].sum(axis=1) - line_noise
            model_power = simulated[:, orders == order][:, 0] ** 2 / 2

            is_audible = model_power > MIN_AUDIBLE_SHARE**2 * model_power.max()
            is_usable = (line_power > line_noise) & is_audible
            ratio = np.maximum(line_power, _MIN_POWER) / np.maximum(model_power, _MIN_POWER)
            log_ratios.append(np.where(is_usable, np.log(ratio), np.nan))

        return np.array([_median_gain(channel) for channel in np.array(log_ratios).T])

    def _mean_spectrum(
        self,
    ) -> tuple[
        Float[np.ndarray, " frequency"],
        Float[np.ndarray, "channel frequency"],
        Float[np.ndarray, "channel frequency"],
    ]:
        """Return the frequencies, the windows' mean power, and the noise interpolated under it."""
        signal = self.like.signal[self.windows].astype(float)
        frequency, density = power_density(signal, self.like.sample_rate)
        power = density.mean(axis=0) * frequency[1]

        line = np.arange(self.is_clear.size)
        clear = self.is_clear
        noise = np.stack([np.interp(line, line[clear], channel[clear]) for channel in power])
        return frequency, power, noise

    def draw(self, rng: np.random.Generator) -> Float[np.ndarray, "channel time"]:
        """Return the noise of one window, in the unit of the measured ones."""
        window = self.like.signal[rng.choice(self.windows)].astype(float)
        # Untapered, strong lines leak over all others. `hann_taper` differs in the last bit, and
        # the noise with it.
        taper = scipy.signal.get_window("hann", self.like.length)
        tapered = (window - window.mean(axis=1, keepdims=True)) * taper / np.sqrt(np.mean(taper**2))

        spectrum = np.abs(transform(tapered))
        line = np.arange(self.is_clear.size)
        clear = self.is_clear
        for channel in spectrum:
            channel[~clear] = np.interp(line[~clear], line[clear], channel[clear])

        phase = np.exp(2j * np.pi * rng.random(spectrum.shape))
        return inverse_transform(spectrum * phase, self.like.length)


def _median_gain(log_power_ratios: Float[np.ndarray, " order"]) -> float:
    """Return the amplitude factor of a channel; 1 if no line gives one."""
    if not np.isfinite(log_power_ratios).any():
        return 1.0
    return float(np.exp(np.nanmedian(log_power_ratios) / 2))


def background_noise(like: WindowSet, twin: Twin, specimen: str = "") -> BackgroundNoise:
    """Return the noise of the measured windows nearest to the twin's pressure.

    Healthy windows are preferred. If some of these are of the twin's own machine at its operating
    point, no other machine lends anything: noise and gain differ from machine to machine, and an
    average of several is that of none.

    Parameters
    ----------
    specimen : machine in `like` that the twin describes; empty if `like` lacks it, as for a
        nominal twin.

    Raises
    ------
    InputError
        `like` has no measured window.
    """
    candidates = ~like.synthetic
    healthy_classes = [name for name in like.classes if is_healthy(name)]
    is_normal = np.isin(like.label, healthy_classes)
    if np.any(candidates & is_normal):
        candidates &= is_normal
    if not candidates.any():
        raise InputError(
            "There is no measured window to take noise from.",
            field="background",
            remedy="Add measured windows, or set {background='none'}.",
        )

    pressure = twin.condition.discharge_pressure
    distance = np.abs(like.discharge_pressure - pressure)
    is_at_pressure = np.asarray(values_match(like.discharge_pressure, pressure, PRESSURE_TOLERANCE))
    if specimen:
        of_machine = candidates & is_at_pressure & (like.specimen == specimen)
        if of_machine.any():
            candidates = of_machine
    if np.isfinite(distance[candidates]).any():
        candidates &= distance <= np.nanmin(distance[candidates]) + _PRESSURE_MARGIN_PA

    frequency = line_frequencies(like.length, like.sample_rate)
    pass_frequency = twin.pump.rotating_group.piston_count * twin.condition.shaft_frequency
    harmonic = frequency / pass_frequency
    distance_hz = np.abs(harmonic - np.round(harmonic)) * pass_frequency
    return BackgroundNoise(
        like,
        windows=np.flatnonzero(candidates),
        is_clear=distance_hz > _LINE_HALF_WIDTH * frequency[1],
        is_healthy=bool(np.all((is_normal & is_at_pressure)[candidates])),
    )
