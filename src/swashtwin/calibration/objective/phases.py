"""Phases of the lines: measured along the shaft's own angle, and the shaft position at which a twin meets them.

The paper drops the phase on purpose, for nobody knows the shaft's position at the first reading. But one unknown
position turns all lines of all channels together, order k by k times the angle; what is left of the phases says as much
as the amplitudes do. The shaft's angle comes from the lines themselves (`order_domain.piston_pass_angle`), and the
position that suits best is found anew for every point, so that it costs no coordinate (variable projection, Golub and
Pereyra 2003, doi:10.1088/0266-5611/19/2/201).
"""

import math
from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Complex, Float, Int
from torch import Tensor

from swashtwin.recordings import Recording
from swashtwin.signals import hann_taper, piston_pass_angle

SEGMENTS = 4
"""The scatter of a line between so many parts of a recording gives its deviation."""
_FINENESS = 16
_NEWTON_STEPS = 4


def phased_lines(
    recording: Recording, orders: Int[np.ndarray, " order"], piston_count: int
) -> tuple[Complex[np.ndarray, "channel order"], Float[np.ndarray, "channel order"]]:
    """Complex peak amplitudes at `orders` along the shaft's angle, and the standard deviation of each of their parts.

    Angle 0 is an arbitrary position of the shaft, the same for all channels and orders of the recording.

    Raises
    ------
    DataError
        No piston-pass line stands clear enough to be followed.
    """
    shaft = piston_pass_angle(recording, piston_count)
    length = recording.signal.shape[1] // SEGMENTS
    parts = []
    for number in range(SEGMENTS):
        part = slice(number * length, (number + 1) * length)
        angle = shaft.angle[part]
        taper = hann_taper(length, symmetric=True) * np.gradient(angle)
        basis = np.exp(-1j * np.outer(angle, orders)) * (2 * taper / taper.sum())[:, None]
        parts.append(recording.signal[:, part] @ basis)
    segments = np.stack(parts)
    return segments.mean(axis=0), _part_deviation(segments)


def combine_lines(
    pairs: Sequence[tuple[Complex[np.ndarray, "channel order"], Float[np.ndarray, "channel order"]]],
    orders: Int[np.ndarray, " order"],
) -> tuple[Complex[np.ndarray, "channel order"], Float[np.ndarray, "channel order"]]:
    """Mean of the `phased_lines` of several recordings, each turned to the first's shaft position; its deviation."""
    lines, deviations = zip(*pairs, strict=True)
    first, numbers = torch.as_tensor(lines[0]), torch.as_tensor(orders)
    rows = []
    for row in lines:
        angle = best_position((torch.as_tensor(row) * first.conj()).sum(dim=0), numbers)
        rows.append(row * np.exp(1j * orders * float(angle)))
    stack = np.stack(rows)
    within = np.sqrt(np.sum(np.square(deviations), axis=0)) / len(lines)
    return stack.mean(axis=0), np.maximum(within, _part_deviation(stack)) if len(lines) > 1 else within


def _part_deviation(lines: Complex[np.ndarray, "draw channel order"]) -> Float[np.ndarray, "channel order"]:
    """Standard deviation of the real and of the imaginary part of the lines' mean."""
    spread: np.ndarray = np.sqrt(np.mean([lines.real.var(axis=0, ddof=1), lines.imag.var(axis=0, ddof=1)], axis=0))
    return spread / math.sqrt(len(lines))


def best_position(cross: Complex[Tensor, "*batch order"], orders: Int[Tensor, " order"]) -> Float[Tensor, "*batch"]:
    """Angle a [rad] at which Re sum_k cross_k exp(i k a) is greatest, differentiable.

    With cross_k the sum over channels of simulated times conjugate measured lines, weighed, it is the shaft position
    to which the simulated lines must be turned to come nearest to the measured ones in the sense of least squares.
    A grid finds the highest peak, Newton's steps its top; the last step carries the exact derivative (that of an
    implicit function).
    """
    step = math.gcd(*orders.tolist())
    numbers = orders // step
    points = _FINENESS * (1 << int(numbers.max()).bit_length())
    with torch.no_grad():
        padded = torch.zeros(*cross.shape[:-1], points, dtype=cross.dtype, device=cross.device)
        padded[..., numbers] = cross
        score = torch.fft.ifft(padded, dim=-1).real  # on the device of the search
        angle = score.argmax(dim=-1) * (2 * math.pi / (points * step))
        for _ in range(_NEWTON_STEPS):
            slope, bend = _slopes(cross, orders, angle)
            angle = angle - slope / bend
        bend = _slopes(cross, orders, angle)[1]
    return angle - _slopes(cross, orders, angle)[0] / bend


def _slopes(cross: Tensor, orders: Tensor, angle: Tensor) -> tuple[Tensor, Tensor]:
    """First and second derivative of the score; the second is below zero around a peak, and never zero."""
    turned = cross * torch.exp(1j * orders * angle[..., None])
    bend = -(orders**2 * turned).real.sum(dim=-1)
    return -(orders * turned).imag.sum(dim=-1), torch.clamp(bend, max=-1e-30)


def turn_lines(
    simulated: Complex[Tensor, "*batch channel order"],
    measured: Complex[Tensor, "channel order"],
    weight: Float[Tensor, "channel order"],
    orders: Int[Tensor, " order"],
) -> Complex[Tensor, "*batch channel order"]:
    """Simulated lines at the shaft position at which they come nearest to the measured ones, by weighed squares."""
    angle = best_position((simulated * measured.conj() * weight).sum(dim=-2), orders)
    return simulated * torch.exp(1j * orders * angle[..., None])[..., None, :]
