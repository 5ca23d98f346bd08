"""Magnitude and phase of lines at multiples of the shaft, along its angle."""

import math

import numpy as np
from jaxtyping import Complex, Float, Int

from swashtwin.foundation import InputError
from swashtwin.signals.shaft_angle import ShaftAngle

_PARTS = 4
"""The scatter between so many parts of the recording says how well a line is known."""
_LEAST_TURNS = 16
_CLEAR = 5.2
"""Amplitude over noise from which a line has a phase: noise reaches it once in 1000 lines (F of 2 and 6 degrees)."""


def synchronous_lines(
    signal: Float[np.ndarray, "channel time"], angle: ShaftAngle, orders: Int[np.ndarray, " order"]
) -> tuple[Float[np.ndarray, "channel order"], Float[np.ndarray, "channel order"]]:
    """Peak amplitude and phase [rad] of lines amplitude · cos(order · angle + phase) that turn with the shaft.

    They are averaged along the shaft's angle with a Hann taper over the whole of it. A phase is positive where the line
    peaks before the reference: the tachometer's pulse where the angle is absolute, else the first channel's line. It is
    NaN where the line, or the reference's, does not stand clear of noise: it would be random.
    Only what keeps its phase with the shaft counts: noise and lines of other machines average out, and a line whose
    angle is not known well enough reads low (`signals.order_spectrum` gathers the power beside it instead).

    Raises
    ------
    InputError
        The signal and the angle differ in length, an order below 1 or above half the samples per turn, or fewer than
        16 revolutions.
    """
    if signal.shape[1] != len(angle.angle):
        raise InputError(f"{signal.shape[1]} samples and {len(angle.angle)} angles; give the signal's own angle.")
    fastest = float(angle.speed.max()) / (2 * math.pi)
    if orders.min() < 1 or orders.max() * fastest >= angle.sample_rate / 2:
        raise InputError(
            f"orders {orders.min()} to {orders.max()} must lie from 1 to below half the sample rate "
            f"({angle.sample_rate / 2 / fastest:.1f} orders)."
        )
    if angle.turns < _LEAST_TURNS:
        raise InputError(f"{angle.turns:.1f} revolutions are too few for lines that turn with the shaft; record 16.")
    whole = _averaged(signal, angle.angle, orders)
    parts = np.array_split(np.arange(signal.shape[1]), _PARTS)
    scatter = np.stack([_averaged(signal[:, part], angle.angle[part], orders) for part in parts])
    noise = scatter.std(axis=0, ddof=1) / math.sqrt(_PARTS)
    clear = np.abs(whole) > _CLEAR * noise
    if not angle.absolute:
        whole, clear = whole * np.exp(-1j * np.angle(whole[0])), clear & clear[:1]
    return np.abs(whole), np.where(clear, np.angle(whole), math.nan)


def _averaged(
    signal: Float[np.ndarray, "channel time"], angle: Float[np.ndarray, " time"], orders: Int[np.ndarray, " order"]
) -> Complex[np.ndarray, "channel order"]:
    share = (angle - angle[0]) / (angle[-1] - angle[0])
    weight = (1 - np.cos(2 * np.pi * share)) * np.gradient(angle)
    weight = weight / weight.sum()
    centered = signal - (signal @ weight)[:, None]
    turning = np.exp(-1j * np.outer(angle, orders))
    result: np.ndarray = 2 * (centered * weight) @ turning
    return result
