"""The shaft's angle from a line of the signal itself: a coarse ridge first, then the line's
phase.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.signal
from jaxtyping import Complex, Float
from scipy.interpolate import make_interp_spline

from swashtwin.foundation import DataError, InputError
from swashtwin.recordings import Recording
from swashtwin.signals.shaft_angle import ShaftAngle, specified_angle
from swashtwin.signals.spectra import hann_taper

_RIDGE_TURNS = 8
"""Revolutions in each segment of the ridge."""
_RIDGE_PENALTY = 0.03
"""Cost of a step between segments by one line's width, in spreads of the log power; grows with the
step's square.
"""
_RIDGE_FINENESS = 4
"""Speeds tried per line's width."""
_BANDWIDTH = 0.4
"""Half-width of the band about the line in which its phase is followed, in orders."""
_CLEAR = 10.0
"""Power of the line over the noise in its band from which it stands clear."""
_LEAST_QUALITY = 0.5
"""Share of the time in which the line must stand clear."""
_PASSES = 3
_VALUES_PER_TURN = 16
"""Values of the line kept per revolution, at least."""
_ASIDE = 0.1
"""Half-width of the bands half an order beside the line in which the noise is read off, in
orders.
"""


def track_shaft_angle(
    recording: Recording,
    *,
    order: int | Sequence[int],
    near: float | None = None,
    search: float = 0.03,
) -> ShaftAngle:
    """Angle of the shaft from the line at `order`, followed through the recording in all its
    channels together.

    First the strongest path of the line through short spectra (8 revolutions each), steps between
    them being costly; then, three times over, the line is turned to zero frequency with the angle
    found so far, everything 0.4 orders away from it is cut off, the channels are added so that the
    line is strongest, and its phase corrects the angle; the first and the last revolution go on at
    their neighbors' speed. The angle's error comes from the noise half an order beside the line, or
    from how far its power fluctuates within 8 revolutions if that is more; what the line's own path
    adds to its phase (a resonance that it crosses as the speed changes) cannot be told from the
    shaft's turning. Angle 0 is where the line peaks, an arbitrary position of the shaft.

    Parameters
    ----------
    order : multiple of the shaft frequency to follow, such as the number of pistons, or several, of
        which the one with the least error of the angle is taken: the piston-pass line itself may be
        weaker than its harmonics. Of several, those that reach half the sample rate are left out.
    near : angular speed of the shaft to look near [rad/s]; by default the recording's own, or the
        stated one.
    search : how far from it the speed may lie, relative; below 1 / (2 `order`), or a neighboring
        line may be taken.

    Raises
    ------
    InputError
        No speed to look near, an order below 1, or no line that is below half the sample rate.
    DataError
        The recording is shorter than 16 revolutions, or the line stands clear for less than half of
        it.
    """
    if near is None:
        start = specified_angle(recording)
    elif math.isfinite(near) and near > 0:
        start = ShaftAngle(near * recording.time, recording.sample_rate, math.nan, math.nan, "near")
    else:
        raise InputError(
            f"near ({near:g} rad/s) must be a positive speed: 860 rev/min is rpm(860)."
        )
    orders = [order] if isinstance(order, int) else list(order)
    if not orders:
        raise InputError("give at least one order to follow, such as the number of pistons.")
    if min(orders) < 1:
        raise InputError(
            f"order {min(orders)} is no line of the shaft; the least is 1, seven pistons' line is 7."
        )
    if not 0 < search < 1:
        raise InputError(
            f"search ({search:g}) is relative to the speed and lies in (0, 1); 3 % is 0.03."
        )
    most = start.speed.max() / (2 * math.pi) * (1 + search)  # wherever the search goes [Hz]
    usable = [each for each in orders if most * (each + _BANDWIDTH) < recording.sample_rate / 2]
    if not usable:
        raise InputError(
            f"{recording.recording_id}: order {min(orders)} within {search:g} of {start.mean_speed:.4g} rad/s reaches "
            f"{most * (min(orders) + _BANDWIDTH):.0f} Hz; it takes less than half the sample rate "
            f"({recording.sample_rate / 2:g} Hz)."
        )
    angles, refusals = [], []
    for candidate in usable:
        try:
            angles.append(_followed(recording, start, candidate, search))
        except DataError as refusal:
            refusals.append(refusal)
    if not angles:
        raise refusals[0]
    return min(angles, key=lambda angle: angle.deviation)


def _followed(recording: Recording, start: ShaftAngle, order: int, search: float) -> ShaftAngle:
    if start.turns < 2 * _RIDGE_TURNS:
        raise DataError(
            f"{recording.recording_id}: {start.turns:.1f} revolutions; following a line needs 16."
        )
    line = _Line.of(recording, start, order, search)
    change, turn = _ridge(line, start, search), round(line.per_turn)
    for _ in range(_PASSES):
        change = change + np.unwrap(np.angle(line.strongest(change)[0])) / order
        # filters see half of the line in the first and last revolution, which go on at their
        # neighbors' pace
        first, last = (
            (change[at + turn] - change[at]) / turn for at in (turn, len(change) - 2 * turn - 1)
        )
        before, after = (
            change[turn] - first * np.arange(turn, 0, -1),
            change[-turn - 1] + last * np.arange(1, turn + 1),
        )
        change = np.concatenate([before, change[turn:-turn], after])
    deviation, quality = _judged(line, change, recording.recording_id)
    if np.median(np.abs(np.gradient(change) / np.gradient(line.turn))) > 0.95 * search:
        raise DataError(
            f"{recording.recording_id}: the line found for order {order} lies {search:.1%} off the speed to look "
            "near, as far as the search goes; correct the speed."
        )
    sample = np.arange(len(start.angle), dtype=float)
    angle = start.angle + make_interp_spline(line.sample, change, k=3)(sample)
    if np.any(np.diff(angle) < 0):
        raise DataError(
            f"{recording.recording_id}: by its line at order {order} the shaft turns back; follow a stronger line."
        )
    return ShaftAngle(
        angle, recording.sample_rate, deviation, quality, f"the line at order {order}"
    )


@dataclass(frozen=True, eq=False)
class _Line:
    """The signal turned back by a first guess of the angle times the order, at a rate that is just
    enough.
    """

    order: int
    """Multiple of the shaft frequency that it is about."""
    sample: Float[np.ndarray, " kept"]
    """Place of each kept value among the recording's samples."""
    values: Complex[np.ndarray, "channel kept"]
    """Complex peak amplitude of what is near the line."""
    turn: Float[np.ndarray, " kept"]
    """First guess of the angle [rad]."""
    per_turn: float
    """Kept values in one revolution, on average."""

    @staticmethod
    def of(recording: Recording, start: ShaftAngle, order: int, search: float) -> "_Line":
        """Line of a recording; `search` says how far from zero frequency it may lie then."""
        shaft = start.mean_speed / (2 * math.pi)
        wanted = max(_VALUES_PER_TURN, 4 * (search * order + 1)) * shaft
        thinner = max(1, math.floor(recording.sample_rate / wanted))
        signal = recording.signal - recording.signal.mean(axis=1, keepdims=True)
        turned = 2 * signal * np.exp(-1j * order * start.angle)
        values = scipy.signal.resample_poly(turned, 1, thinner, axis=-1)
        sample = thinner * np.arange(values.shape[1], dtype=float)
        turn = start.angle[::thinner]
        return _Line(order, sample, values, turn, recording.sample_rate / thinner / shaft)

    def near(
        self, change: Float[np.ndarray, " kept"], half_width: float = _BANDWIDTH, aside: float = 0.0
    ) -> Complex[np.ndarray, "channel kept"]:
        """What lies within `half_width` orders of the line, the angle changed by `change` [rad], or
        `aside` of it.
        """
        turned = self.values * np.exp(-1j * (self.order * change + aside * (self.turn + change)))
        sos = scipy.signal.butter(4, 2 * half_width / self.per_turn, output="sos")
        return scipy.signal.sosfiltfilt(sos, turned, axis=-1)

    def strongest(
        self, change: Float[np.ndarray, " kept"]
    ) -> tuple[Complex[np.ndarray, " kept"], Complex[np.ndarray, " channel"]]:
        """The line, of all channels together: the sum that holds most of its power, and the weights
        of that sum.
        """
        lines = self.near(change)
        weights = np.linalg.eigh(lines @ lines.conj().T)[1][:, -1].conj()
        return weights @ lines, weights


def _ridge(line: _Line, start: ShaftAngle, search: float) -> Float[np.ndarray, " kept"]:
    """Coarse change of the angle [rad]: the line's path through overlapping segments."""
    length = min(len(line.sample), round(_RIDGE_TURNS * line.per_turn))
    rest = len(line.sample) - length
    first = np.unique(np.linspace(0, rest, math.ceil(4 * rest / length) + 1).astype(int))
    step = 1 / (_RIDGE_FINENESS * _RIDGE_TURNS * line.order)
    tried = step * np.arange(-math.ceil(search / step), math.ceil(search / step) + 1)
    taper = hann_taper(length, symmetric=True)
    power = np.empty((len(first), len(tried)))
    for row, begin in enumerate(first):
        part = slice(begin, begin + length)
        turning = np.exp(-1j * line.order * np.outer(line.turn[part] - line.turn[begin], tried))
        strength = np.abs((line.values[:, part] * taper) @ turning) ** 2
        power[row] = (strength / np.maximum(strength.mean(axis=1, keepdims=True), 1e-300)).sum(
            axis=0
        )
    score = np.log(np.maximum(power, 1e-300))
    chosen = tried[_strongest_path(score / max(score.std(), 1e-12))]
    factor = np.interp(np.arange(len(line.turn)), first + (length - 1) / 2, chosen)
    return np.concatenate([[0.0], np.cumsum(np.diff(line.turn) * (factor[1:] + factor[:-1]) / 2)])


def _strongest_path(score: Float[np.ndarray, "segment tried"]) -> np.ndarray:
    """Column of each row on the path with the highest score, steps between rows costing their
    square (Viterbi).
    """
    column = np.arange(score.shape[1])
    cost = _RIDGE_PENALTY * ((column[:, None] - column) / _RIDGE_FINENESS) ** 2
    best, origin = score[0], []
    for row in score[1:]:
        total = best[:, None] - cost
        origin.append(total.argmax(axis=0))
        best = total.max(axis=0) + row
    path = [int(best.argmax())]
    for before in reversed(origin):
        path.append(int(before[path[-1]]))
    return np.array(path[::-1])


def _fluctuating(power: Float[np.ndarray, " kept"], block: int) -> float:
    """Power of the noise that would make the line's power fluctuate as it does within blocks.

    A line in noise of K times less power has a variance of (2 K + 1) / (K + 1)² of its mean power
    squared, narrow noise without a line has 1. So a hump of broadband noise (flow about a blade
    frequency) is not taken for a line.
    """
    blocks = power[: len(power) // block * block].reshape(-1, block)
    unrest = float(np.median(blocks.var(axis=1) / np.maximum(blocks.mean(axis=1), 1e-300) ** 2))
    return float(np.median(power)) * (1 - math.sqrt(max(1 - unrest, 0.0)))


def _judged(line: _Line, change: Float[np.ndarray, " kept"], name: str) -> tuple[float, float]:
    """Deviation of the angle [rad] by the noise half an order beside the line, and the share of
    time it is clear.
    """
    strongest, weights = line.strongest(change)
    beside = [np.abs(weights @ line.near(change, _ASIDE, aside)) ** 2 for aside in (-0.5, 0.5)]
    level = float(np.mean([np.median(power) for power in beside])) / math.log(2)
    power = np.abs(strongest) ** 2
    noise = max(
        level * _BANDWIDTH / _ASIDE,
        _fluctuating(power, round(_RIDGE_TURNS * line.per_turn)),
        1e-300,
    )
    quality = float(np.mean(power > _CLEAR * noise))
    if quality < _LEAST_QUALITY:
        raise DataError(
            f"{name}: the line at order {line.order} stands clear of the noise for {quality:.0%} of the time only; "
            "follow a stronger one, correct the speed to look near, or give a tachometer channel."
        )
    return math.sqrt(noise / (2 * float(np.median(power)))) / line.order, quality


_LOW, _FOLLOWED = 3, 6
"""So many of the lowest piston-pass lines tell the speed, and so many the angle; the clearest of
them.
"""
_SEARCH = 0.02
"""How far from the stated speed the shaft's may lie, relative."""
_SEARCH_SHARE = 0.45
"""Share of the distance to a line's neighbors, one order away, within which it is looked for."""


def piston_pass_angle(recording: Recording, piston_count: int) -> ShaftAngle:
    """Angle of the shaft from the clearest of the lowest six piston-pass lines, within 2 % of the
    stated speed.

    The lowest three, whose neighbors lie far away, say first how fast the shaft turned; then any of
    the six is looked for near that speed. Where none of the three stands clear, only as near the
    stated speed as no neighbor of the sixth is mistaken for it: about 1 % with seven pistons.

    Raises
    ------
    InputError
        Nobody stated a speed.
    DataError
        No piston-pass line stands clear enough to be followed (`track_shaft_angle`).
    """
    lines = [piston_count * number for number in range(1, _FOLLOWED + 1)]
    fine = min(_SEARCH, _SEARCH_SHARE / lines[-1])
    try:
        low = track_shaft_angle(
            recording, order=lines[:_LOW], search=min(_SEARCH, _SEARCH_SHARE / lines[_LOW - 1])
        )
    except DataError:  # those above may still be followed
        return track_shaft_angle(recording, order=lines, search=fine)
    if recording.speed is None:
        return track_shaft_angle(recording, order=lines, near=low.mean_speed, search=fine)
    along = recording.replace(
        speed=np.maximum(low.speed, 0)
    )  # a run-up has no one speed to look near
    return track_shaft_angle(along, order=lines, search=fine)
