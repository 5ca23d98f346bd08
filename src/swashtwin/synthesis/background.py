"""What differs from one synthetic window to the next, and the noise and gains that a machine's own
windows lend.
"""

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
    """Spreads of what is drawn for each synthetic window, besides the shaft's phase. Zero switches
    one off.

    Speed, pressure and temperature follow docs/explanation/physics.md, section 5. Severity, angle,
    interface values and sensor are estimates of ours. Severity and angle are those of somebody who
    knows a fault's typical size and place, and not how they differ from pump to pump: 95 % of the
    severities are within a factor of two, of the places within 10 degrees. Those of version 1 of
    the virtual rig spread less (docs/bench/rig.md). The interface values spread alike; what a
    calibration leaves open of each comes on top of it (`synthesize`).
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
"""Spread around the twin where nobody states one."""


def draw_twin(twin: Twin, variation: Variation, seed: int, index: int) -> Twin:
    """`twin` with its condition, fault and interface values as `variation` spreads them, drawn by
    seed and index.
    """
    rng = random_stream(seed, "variation", twin.label, index)
    condition = replace(
        twin.condition,
        speed=twin.condition.speed * (1 + variation.speed * rng.uniform(-1, 1)),
        discharge_pressure=twin.condition.discharge_pressure
        * (1 + variation.pressure * rng.uniform(-1, 1)),
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


AUDIBLE = 0.3
"""Share of the loudest channel's amplitude below which a line may be cross-talk, which is a tenth
[estimate].
"""


@dataclass(frozen=True, eq=False)
class BackgroundNoise:
    """Noise with the spectrum of a measured window between its piston-pass lines, in random
    phase.
    """

    like: WindowSet
    windows: Int[np.ndarray, " window"]
    """Indices of the windows that one is drawn from."""
    clear: Bool[np.ndarray, " frequency"]
    """Which lines of a window's spectrum are far from the piston-pass frequency's multiples."""
    is_healthy: bool
    """Whether the windows are healthy ones at the pressure that was asked for."""

    def gains(self, twin: Twin, sensors: Sequence[int]) -> Float[np.ndarray, " channel"]:
        """Factor on the lines of each channel that brings a healthy twin to the windows; 1 where
        none is healthy.

        exp of half the median, over the piston-pass lines up to `DEFAULT_BAND` that stand above the
        noise, of ln (measured power over simulated): no line counts more for being loud, and none
        is mended by itself, for that would paint the healthy machine's errors over the fault. Where
        the twin says that another channel is so much louder (`AUDIBLE`), what is measured is that
        channel's cross-talk and tells no gain.
        """
        if not self.is_healthy:
            return np.ones(len(sensors))
        signal = self.like.signal[self.windows].astype(float)
        frequency, power = power_density(signal, self.like.sample_rate)
        power = power.mean(axis=0) * frequency[1]
        line, clear = np.arange(self.clear.size), self.clear
        noise = np.stack([np.interp(line, line[clear], row[clear]) for row in power])
        with torch.no_grad():
            simulated = twin.with_fault(None).acceleration().abs().numpy()[list(sensors)]
        count = twin.pump.rotating_group.piston_count
        number = np.round(frequency / (count * twin.condition.shaft_frequency)).astype(int)
        orders = twin.with_fault(None).orders
        logarithms = []
        for order in orders[
            (orders % count == 0) & (orders * twin.condition.shaft_frequency <= DEFAULT_BAND[1])
        ]:
            near = ~clear & (number == order // count)
            above = power[:, near].sum(axis=1) - noise[:, near].sum(axis=1)
            model = simulated[:, orders == order][:, 0] ** 2 / 2
            stands = (above > noise[:, near].sum(axis=1)) & (model > AUDIBLE**2 * model.max())
            logarithms.append(
                np.where(
                    stands, np.log(np.maximum(above, 1e-30) / np.maximum(model, 1e-30)), np.nan
                )
            )
        ratios = np.array(logarithms)
        return np.array(
            [np.exp(np.nanmedian(row) / 2) if np.isfinite(row).any() else 1.0 for row in ratios.T]
        )

    def draw(self, rng: np.random.Generator) -> Float[np.ndarray, "channel time"]:
        """Noise of one window, in the unit of the measured ones."""
        window = self.like.signal[rng.choice(self.windows)].astype(float)
        # Untapered, strong lines leak over all others. `hann_taper` differs in the last bit, and
        # the noise with it.
        taper = scipy.signal.get_window("hann", self.like.length)
        tapered = (window - window.mean(axis=1, keepdims=True)) * taper / np.sqrt(np.mean(taper**2))
        spectrum = np.abs(transform(tapered))
        line, clear = np.arange(self.clear.size), self.clear
        for row in spectrum:
            row[~clear] = np.interp(line[~clear], line[clear], row[clear])
        phase = np.exp(2j * np.pi * rng.random(spectrum.shape))
        return inverse_transform(spectrum * phase, self.like.length)


def background_noise(like: WindowSet, twin: Twin) -> BackgroundNoise:
    """The noise of the measured windows of `like` nearest to the twin's pressure, normal ones where
    there are any.

    An `InputError` where `like` has no measured window.
    """
    candidates = ~like.synthetic
    is_normal = np.isin(like.label, [name for name in like.classes if is_healthy(name)])
    if np.any(candidates & is_normal):
        candidates &= is_normal
    if not candidates.any():
        raise InputError(
            "no measured window to take noise from; the background can be 'none'.",
            field="background",
        )
    distance = np.abs(like.discharge_pressure - twin.condition.discharge_pressure)
    there = values_match(
        like.discharge_pressure, twin.condition.discharge_pressure, PRESSURE_TOLERANCE
    )
    if np.isfinite(distance[candidates]).any():
        candidates &= distance <= np.nanmin(distance[candidates]) + 1e4
    frequency = line_frequencies(like.length, like.sample_rate)
    pass_frequency = twin.pump.rotating_group.piston_count * twin.condition.shaft_frequency
    away = (
        np.abs(frequency / pass_frequency - np.round(frequency / pass_frequency)) * pass_frequency
    )
    healthy_there = bool(np.all((is_normal & np.asarray(there))[candidates]))
    return BackgroundNoise(
        like, np.flatnonzero(candidates), away > 2.5 * frequency[1], healthy_there
    )
