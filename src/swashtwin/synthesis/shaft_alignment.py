"""Windows of a machine, and the angle of the shaft at which each begins, as a twin of it counts the angle.

No tachometer is needed: the piston-pass lines of a window tell how far its shaft has turned and how fast it turns. The
windows are aligned with each other first, and their average with the twin's own lines, so that a twin whose phases are
off at some lines still finds the angle by the others.
"""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Complex, Float, Int

from swashtwin.foundation import InputError
from swashtwin.learning import WindowSet
from swashtwin.physics import Twin
from swashtwin.signals import hann_taper, transform

_RATES = 1 + np.linspace(-0.01, 0.01, 41)
"""Speeds over the stated one that are tried."""
_PADDING = 8
"""Length of a window with its zeros, over its own: a line is off by a sixteenth of a bin at most."""
_PASSES = 6
"""Number of times that the windows are aligned with their average."""
_ANGLES = 1024
"""Angles within a piston pitch that are tried."""


@dataclass(frozen=True, eq=False)
class AlignedWindows:
    """Windows of one machine at a twin's operating point."""

    windows: WindowSet
    """As measured."""
    angle: Float[np.ndarray, " window"]
    """Shaft angle at the first sample [rad]; which of the pistons it is remains open."""
    speed: Float[np.ndarray, " window"]
    """Angular speed of the shaft [rad/s]."""
    average: Complex[np.ndarray, "channel line"]
    """Mean lines at the multiples of the piston-pass frequency, from the first one, at angle zero."""


def align_windows(windows: WindowSet, twin: Twin) -> AlignedWindows:
    """The windows with their shaft angles and speeds, from their piston-pass lines and those of the twin as it is.

    Raises
    ------
    InputError
        The windows are shorter than a revolution: tapered, their piston-pass lines run into each other.
    """
    turns = windows.length / windows.sample_rate * twin.condition.shaft_frequency
    if turns < 1:
        raise InputError(
            f"windows of {windows.length} samples hold {turns:.2g} revolutions; the shaft's angle takes one at least. "
            'Cut longer windows, or take background="spectrum".'
        )
    rate, lines = _pass_lines(windows, twin)
    order = np.arange(1, lines.shape[-1] + 1)
    average = lines[np.argmax(np.sum(np.abs(lines) ** 2, axis=(1, 2)))]
    for _ in range(_PASSES):  # Woody 1967, DOI 10.1007/BF02474247
        pitch = _best_angle(lines * average.conj())
        average = (lines * np.exp(-1j * pitch[:, None, None] * order)).mean(axis=0)
    offset = _best_angle(average * pass_lines_of(twin, order).conj())
    pistons = twin.pump.rotating_group.piston_count
    return AlignedWindows(
        windows, (pitch + offset) / pistons, rate * twin.condition.speed, average * np.exp(-1j * offset * order)
    )


def pass_lines_of(twin: Twin, order: Int[np.ndarray, " line"]) -> Complex[np.ndarray, "channel line"]:
    """The twin's lines [m/s^2] at multiples `order` of the piston-pass frequency."""
    with torch.no_grad():
        computed = twin.acceleration().numpy()
    wanted = twin.pump.rotating_group.piston_count * order
    shared = np.isin(wanted, twin.orders)
    lines = np.zeros((computed.shape[0], order.size), dtype=complex)
    lines[:, shared] = computed[:, np.searchsorted(twin.orders, wanted[shared])]
    return lines


def _pass_lines(
    windows: WindowSet, twin: Twin
) -> tuple[Float[np.ndarray, " window"], Complex[np.ndarray, "window channel line"]]:
    """(speed over the twin's, lines at the multiples of the piston-pass frequency) of each window.

    The speed is that at which the lines hold most power.
    """
    passing = twin.pump.rotating_group.piston_count * twin.condition.shaft_frequency
    order = np.arange(1, int(twin.bandwidth / passing) + 1)
    frequency = passing * np.outer(_RATES, order)
    count = _PADDING * windows.length
    bins = np.rint(frequency * count / windows.sample_rate).astype(np.int64)
    middle = windows.length / 2 / windows.sample_rate  # about which a tapered window's phase is the same at any bin
    turn = np.exp(2j * np.pi * (bins * windows.sample_rate / count - frequency) * middle)
    taper = hann_taper(windows.length)
    rate = np.empty(len(windows))
    lines = np.empty((len(windows), windows.n_channels, order.size), dtype=complex)
    for index, window in enumerate(windows.signal.astype(float)):
        spectrum = transform((window - window.mean(axis=-1, keepdims=True)) * (2 / taper.sum()) * taper, count)
        candidates = spectrum[:, bins] * turn
        best = int(np.argmax(np.sum(np.abs(candidates) ** 2, axis=(0, 2))))
        rate[index], lines[index] = _RATES[best], candidates[:, best]
    return rate, lines


def _best_angle(cross: Complex[np.ndarray, "*window channel line"]) -> Float[np.ndarray, "*window"]:
    """Angle p at which Re sum of cross exp(-i m p) over channels and lines m is greatest [rad]."""
    padded = np.zeros((*cross.shape[:-2], _ANGLES), dtype=complex)
    padded[..., 1 : cross.shape[-1] + 1] = cross.sum(axis=-2)
    return np.asarray(np.fft.fft(padded, axis=-1).real.argmax(axis=-1) * (2 * np.pi / _ANGLES))
