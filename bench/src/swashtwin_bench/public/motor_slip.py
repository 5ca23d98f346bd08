"""Load of an induction motor, from the vibration of the machine that it drives.

The motor's field turns at the synchronous speed and pulls at its frame twice in each period of the supply; the shaft
lags behind by the slip, which grows with the torque. Both rhythms are in a vibration signal: the supply's frequency and
its multiples, which are sharp and steady, and the multiples of the shaft's own. Their difference is the slip, without
any knowledge of the drive's settings.

A centrifugal pump asks for a torque that grows with the square of its speed (the affinity laws), so slip over speed
squared says at which share of its flow a pump runs, whatever the speed.
"""

import math
from dataclasses import dataclass

import numpy as np
import scipy.ndimage
from jaxtyping import Float

from swashtwin.foundation import InputError
from swashtwin.signals import hann_taper, transform

_SUPPLY_MULTIPLES = (1, 2, 3, 6, 12)
"""Of the supply's frequency; 6 and 12 are a three-phase inverter's."""
_SHAFT_MULTIPLES = (1, 2, 3, 4, 5, 6, 7, 9, 12)
_STEP = 1e-4
"""Spacing of the speeds tried, relative."""
_PADDING = 4
_NEIGHBORHOOD = 10.0
"""Width over which the spectrum's level is judged [Hz]."""
_LEAST_TURNS = 30
_RESOLVED = 0.7
"""Lines of field and shaft nearer than this over the duration are one line, and count once."""


@dataclass(frozen=True)
class MotorSlip:
    """Speeds of field and shaft."""

    synchronous_speed: float
    """Angular speed of the motor's field [rad/s]."""
    speed: float
    """Angular speed of the shaft [rad/s]."""
    clearness: float
    """Mean logarithm of the power at the lines of field and shaft over the level about them."""

    @property
    def slip(self) -> float:
        """How far the shaft lags behind, relative to the field."""
        return 1 - self.speed / self.synchronous_speed

    @property
    def load_coefficient(self) -> float:
        """Lag over the synchronous speed squared [s/rad]: proportional to a pump's torque coefficient.

        The torque is taken as proportional to the lag, which holds at a constant ratio of voltage to frequency.
        """
        return (self.synchronous_speed - self.speed) / self.synchronous_speed**2


def motor_slip(
    signal: Float[np.ndarray, "channel time"],
    sample_rate: float,
    near: float,
    *,
    pole_pairs: int = 2,
    search: tuple[float, float] = (-0.03, 0.06),
    slips: tuple[float, float] = (0.0025, 0.04),
) -> MotorSlip:
    """Slip of the induction motor that drives what was measured, its speed being steady over the recording.

    Of all pairs of a synchronous speed and a shaft speed below it, the one whose two combs of lines stand highest, by
    the mean logarithms of the spectrum there; a line of the shaft that coincides with one of the supply does not count.
    The spectrum is the mean over the channels, each divided by its own median level nearby. In 5 s the lag comes out to
    within a fifth at the lowest speeds, and better above.

    Parameters
    ----------
    near : angular speed that the drive was set to [rad/s].
    pole_pairs : of the motor; the supply has so many periods in a turn of the field.
    search : how far from `near` the synchronous speed may lie, relative.
    slips : least and greatest slip.

    Raises
    ------
    InputError
        Fewer than 30 turns, a rate too low for the lines, or ranges that hold no pair of speeds.
    """
    shaft = near / (2 * math.pi)
    turns = signal.shape[1] / sample_rate * shaft
    top = max(pole_pairs * max(_SUPPLY_MULTIPLES), max(_SHAFT_MULTIPLES)) * shaft * (1 + max(search))
    if not turns >= _LEAST_TURNS or top + _NEIGHBORHOOD >= sample_rate / 2:
        raise InputError(
            f"{turns:.0f} turns at {sample_rate:g} Hz do not tell a slip; it takes {_LEAST_TURNS} turns at a steady "
            f"speed and more than {2 * (top + _NEIGHBORHOOD):.0f} Hz."
        )
    if not (-1 < search[0] < search[1] and 0 < slips[0] < slips[1] < 1):
        raise InputError(f"search {search} and slips {slips} must be rising ranges, slips within 0 and 1.")
    frequency, level = _levels(signal, sample_rate, top + _NEIGHBORHOOD)
    candidates = shaft * np.arange(1 + search[0] - slips[1], 1 + search[1], _STEP)
    orders = [pole_pairs * multiple for multiple in _SUPPLY_MULTIPLES]
    field = np.sum([np.interp(order * candidates, frequency, level) for order in orders], axis=0)
    field[candidates < shaft * (1 + search[0])] = -np.inf
    lag = candidates[:, None] - candidates[None, :]
    possible = (lag >= slips[0] * candidates[:, None]) & (lag <= slips[1] * candidates[:, None])
    resolved = _RESOLVED * sample_rate / signal.shape[1]
    turning, counted = np.zeros_like(lag), np.zeros_like(lag)
    for order in _SHAFT_MULTIPLES:
        is_resolved = (lag * order > resolved) if order in orders else np.ones_like(possible)
        turning += np.where(is_resolved, np.interp(order * candidates, frequency, level)[None, :], 0.0)
        counted += is_resolved
    together = np.where(possible, field[:, None] / len(orders) + turning / np.maximum(counted, 1), -np.inf)
    first, second = np.unravel_index(int(together.argmax()), together.shape)
    clearness = float(together[first, second]) / 2
    return MotorSlip(2 * math.pi * float(candidates[first]), 2 * math.pi * float(candidates[second]), clearness)


def _levels(
    signal: Float[np.ndarray, "channel time"], sample_rate: float, top: float
) -> tuple[Float[np.ndarray, " line"], Float[np.ndarray, " line"]]:
    """Frequencies [Hz] up to `top`, and the logarithm of the power there over the level about it."""
    count = signal.shape[1]
    centered = (signal - signal.mean(axis=1, keepdims=True)) * hann_taper(count, symmetric=True)
    power = np.abs(transform(centered, _PADDING * count)) ** 2
    width = sample_rate / (_PADDING * count)
    power = power[:, : math.ceil(top / width) + 1]
    size = max(3, round(_NEIGHBORHOOD / width / _PADDING))
    nearby = scipy.ndimage.median_filter(power[:, ::_PADDING], (1, size), mode="nearest")
    bins = np.arange(power.shape[1])
    level = np.array([np.interp(bins, bins[::_PADDING], row) for row in nearby]) / math.log(2)
    mean = np.mean(power / np.maximum(level, 1e-300), axis=0)
    return bins * width, np.log(np.maximum(mean, 1e-300))
