"""Steady recordings of any length, block by block, and when one repeats without a seam."""

import math
from collections.abc import Iterator

import numpy as np
import torch

from swashtwin.foundation import InputError
from swashtwin.physics.solvers.steady import SteadySolver
from swashtwin.physics.twin.model import Twin
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import Recording

BLOCK = 65536
"""Readings that are computed at a time."""
_SEAM = 1e-3
"""Share of the time between two samples by which the end of a recording may miss its beginning."""


def steady_blocks(
    twin: Twin,
    duration: float,
    sample_rate: float,
    *,
    solver: SteadySolver | None = None,
    phase: float = 0.0,
    recording_id: str = "simulated",
) -> Iterator[Recording]:
    """The recording of `Twin.simulate`, bit for bit, in blocks, so that memory does not grow with its length.

    Raises
    ------
    InputError
        The sample rate is below twice the bandwidth, or there is no sample.
    """
    twin.require_rate(sample_rate)
    n_samples = round(duration * sample_rate)
    if n_samples < 1:
        raise InputError(f"duration ({duration:g} s) must hold at least one sample at {sample_rate:g} Hz.")
    with torch.no_grad():
        lines = twin.acceleration(solver=solver).numpy()
    for first in range(0, n_samples, BLOCK):
        angle = phase + twin.condition.speed * np.arange(first, min(first + BLOCK, n_samples)) / sample_rate
        yield twin.read_off(lines, angle, sample_rate, recording_id)


def whole_revolutions(condition: OperatingCondition, duration: float, sample_rate: float) -> int:
    """Number of revolutions in `duration` [s], where both it and the samples are whole: the signal then repeats.

    Raises
    ------
    InputError
        They are not; the nearest duration, of half to twice the length, at which they are is offered, or the nearest
        speed.

    Examples
    --------
    >>> from swashtwin.foundation.units import MPa, rpm
    >>> at_15 = OperatingCondition(speed=rpm(860), discharge_pressure=MPa(15))
    >>> whole_revolutions(at_15, 3.0, 25600.0)
    43
    >>> whole_revolutions(at_15, 4.0, 25600.0)
    Traceback (most recent call last):
    ...
    swashtwin.foundation.errors.InputError: duration (4 s) holds 57.3333 revolutions and 102400 samples, which must
    both be whole for a signal that repeats; the nearest that does is 3 s (43 revolutions).
    """
    turns, per_turn = duration * condition.shaft_frequency, sample_rate / condition.shaft_frequency
    nearest = max(1, round(turns))
    if abs(nearest * per_turn - duration * sample_rate) < _SEAM and _is_whole(duration * sample_rate):
        return nearest
    offered = sorted(
        (count for count in range((nearest + 1) // 2, 2 * nearest + 1) if _is_whole(count * per_turn)),
        key=lambda count: abs(count - turns),
    )
    if offered:
        offer = (
            f"the nearest that does is {round(offered[0] * per_turn) / sample_rate:.15g} s ({offered[0]} revolutions)"
        )
    else:
        speed = 2 * math.pi * nearest * sample_rate / max(1, round(duration * sample_rate))
        offer = f"no duration near it does; at a speed of {speed * 30 / math.pi:.10g} rev/min it holds {nearest}"
    raise InputError(
        f"duration ({duration:g} s) holds {turns:.6g} revolutions and {duration * sample_rate:.10g} samples, which "
        f"must both be whole for a signal that repeats; {offer}."
    )


def _is_whole(n_samples: float) -> bool:
    return abs(n_samples - round(n_samples)) < _SEAM
