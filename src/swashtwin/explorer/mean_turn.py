"""The mean turn of a recording, at the shaft angle at which it is most like a twin's turn.

A recording states no shaft position. The angle between its samples comes from its own piston-pass
lines (`signals.piston_pass_angle`). The mean over its turns then keeps what repeats with the shaft.
One unknown angle is left, the same for all channels, and the twin's waveform determines it
(`calibration.find_shaft_position`).
"""

import math
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Complex, Float

from swashtwin.calibration import find_shaft_position
from swashtwin.foundation import DataError
from swashtwin.physics import Twin
from swashtwin.recordings import Recording
from swashtwin.signals import piston_pass_angle, resample_by_angle

# `resample_by_angle` keeps orders up to 0.4 of the samples of a turn.
_SAMPLES_PER_ORDER = 2.5

POINTS_PER_PERIOD = 4
"""Points of a waveform in a period of its highest order, so that a curve through them is seen."""


@dataclass(frozen=True, eq=False)
class MeanTurn:
    """Fourier lines of the mean turn of a recording; its angle 0 is an arbitrary position."""

    channels: tuple[str, ...]
    """Channels, each a sensor of the twin's pump."""
    lines: Complex[np.ndarray, "channel order"]
    """Complex peak amplitudes [m/s^2] at the orders from 0 on; the mean is left out."""
    n_turns: int
    """Number of turns that are averaged."""


@dataclass(frozen=True, eq=False)
class AlignedTurn:
    """A mean turn at the shaft angle of a twin."""

    waveform: Float[np.ndarray, "channel angle"]
    """Acceleration [m/s^2] on a uniform grid of the shaft angle from 0."""
    correlation: float
    """Correlation with the twin's waveform over all channels together, 1 at best."""


def average_turns(recording: Recording, piston_count: int, max_order: int) -> MeanTurn:
    """Return the mean turn of a recording.

    Parameters
    ----------
    max_order : highest shaft order that is kept.

    Raises
    ------
    DataError
        No piston-pass line stands clear enough to be followed, or no turn is complete.
    """
    samples_per_turn = 2 * math.ceil(_SAMPLES_PER_ORDER * max_order / 2)
    angle = piston_pass_angle(recording, piston_count)
    turned = resample_by_angle(recording, angle, samples_per_turn)

    n_turns = turned.n_samples // samples_per_turn
    if n_turns == 0:
        raise DataError(f"{recording.recording_id} is shorter than one turn of the shaft.")
    turns = turned.signal[:, : n_turns * samples_per_turn]
    mean = turns.reshape(turned.n_channels, n_turns, samples_per_turn).mean(axis=1)

    lines = 2 * np.fft.rfft(mean) / samples_per_turn
    lines[:, 0] = 0.0
    return MeanTurn(turned.channels, lines[:, : max_order + 1], n_turns)


def align_turn(
    mean_turn: MeanTurn,
    twin: Twin,
    twin_lines: Complex[np.ndarray, "sensor line"],
) -> AlignedTurn:
    """Return a mean turn at the shaft angle at which it correlates best with a twin's turn.

    Orders above the twin's highest one are left out. If the twin's pistons are alike, only its weak
    line of unbalance distinguishes one piston's turn from the next.

    Parameters
    ----------
    twin_lines : complex amplitudes [m/s^2] of the twin's sensors at its orders.
    """
    rows = [twin.pump.channels.index(name) for name in mean_turn.channels]
    is_measured = (twin.orders > 0) & (twin.orders < mean_turn.lines.shape[1])
    orders = twin.orders[is_measured]
    simulated = twin_lines[rows][:, is_measured]

    cross = (simulated * mean_turn.lines[:, orders].conj()).sum(axis=0)
    angle = float(find_shaft_position(torch.as_tensor(cross), torch.as_tensor(orders)))

    highest = min(int(twin.orders.max()), mean_turn.lines.shape[1] - 1)
    all_orders = np.arange(highest + 1)
    measured = mean_turn.lines[:, : highest + 1] * np.exp(-1j * all_orders * angle)
    points = POINTS_PER_PERIOD * highest
    waveform = np.fft.irfft(measured * (points / 2), points)

    # By Parseval's theorem, from the lines of both.
    product = float((simulated * measured[:, orders].conj()).real.sum())
    norm = float(np.linalg.norm(simulated) * np.linalg.norm(measured))
    return AlignedTurn(waveform, product / norm if norm else 0.0)
