"""The shaft's angle from a line of the signal: a coarse ridge first, then the line's phase."""

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

RIDGE_TURNS = 8
"""Revolutions in each segment of the ridge."""
RIDGE_PENALTY = 0.03
"""Cost of a step between segments by one line's width, in spreads of the log power; grows with the
step's square.
"""
RIDGE_FINENESS = 4
"""Speeds tried per line's width."""
BANDWIDTH = 0.4
"""Half-width of the band about the line in which its phase is followed [orders]."""
MIN_PROMINENCE = 10.0
"""Power of the line over the noise in its band from which it stands clear."""
MIN_QUALITY = 0.5
"""Share of the time in which the line must stand clear."""
N_PASSES = 3
"""Corrections of the angle by the line's phase; the third one hardly changes it."""
VALUES_PER_TURN = 16
"""Minimum number of values of the line per revolution."""
NOISE_HALF_WIDTH = 0.1
"""Half-width of the bands, half an order from the line, in which the noise is read off [orders]."""
MAX_SEARCH_SHARE = 0.95
"""Share of the search beyond which a result lies at its edge, and is rejected."""


def track_shaft_angle(
    recording: Recording,
    *,
    order: int | Sequence[int],
    expected_speed: float | None = None,
    search: float = 0.03,
) -> ShaftAngle:
    """Return the angle of the shaft from the line at `order`, followed through the recording.

    All channels are used together. The first estimate is the strongest path of the line through
    short spectra (8 revolutions each), in which every step costs something. Three times over, the
    line is then turned to zero frequency with the angle so far, everything 0.4 orders away from it
    is cut off, the channels are added so that the line is strongest, and its phase corrects the
    angle. The first and the last revolution continue at their neighbors' speed.

    The angle's error comes from the noise half an order from the line, or from how far its power
    fluctuates within 8 revolutions if that is more. What the line's own path adds to its phase (a
    resonance that it crosses as the speed changes) cannot be separated from the shaft's turning.
    Angle 0 is a peak of the line, an arbitrary position of the shaft.

    Parameters
    ----------
    order : multiple of the shaft frequency to follow, such as the number of pistons, or several, of
        which the one with the smallest error of the angle is taken: the piston-pass line itself may
        be weaker than its harmonics. Of several, those that reach half the sample rate are skipped.
    expected_speed : angular speed of the shaft near which the line is searched [rad/s]; by default
        that of each sample of the recording, or the specified one.
    search : largest relative distance of the speed from it; below 1 / (2 `order`), or a neighboring
        line may be taken.

    Raises
    ------
    InputError
        No speed to search near, an order below 1, or no line that is below half the sample rate.
    DataError
        The recording is shorter than 16 revolutions, or the line stands clear for less than half of
        it.
    """
    start = _starting_angle(recording, expected_speed)
    orders = [order] if isinstance(order, int) else list(order)
    if not orders:
        raise InputError("Specify at least one order to follow, such as the number of pistons.")
    if min(orders) < 1:
        raise InputError(
            f"Order {min(orders)} is not a line of the shaft: the lowest is 1; seven pistons' line "
            "is 7."
        )
    if not 0 < search < 1:
        raise InputError(
            f"search ({search:g}) is relative to the speed and must lie in (0, 1); 3 % is 0.03."
        )

    # The highest shaft frequency that the search may reach [Hz].
    max_shaft = start.speed.max() / (2 * math.pi) * (1 + search)
    nyquist = recording.sample_rate / 2
    candidates = [order for order in orders if max_shaft * (order + BANDWIDTH) < nyquist]
    if not candidates:
        raise InputError(
            f"{recording.recording_id}: order {min(orders)} within {search:g} of "
            f"{start.mean_speed:.4g} rad/s reaches {max_shaft * (min(orders) + BANDWIDTH):.0f} Hz; "
            f"it must lie below half the sample rate ({recording.sample_rate / 2:g} Hz)."
        )

    angles = []
    errors = []
    for candidate in candidates:
        try:
            angles.append(_follow_line(recording, start, candidate, search))
        except DataError as error:
            # Another order may still stand clear; the first failure is reported if none does.
            errors.append(error)
    if not angles:
        raise errors[0]
    return min(angles, key=lambda angle: angle.deviation)


def _starting_angle(recording: Recording, expected_speed: float | None) -> ShaftAngle:
    """Return the angle that a given or specified speed adds up to."""
    if expected_speed is None:
        return specified_angle(recording)
    if not (math.isfinite(expected_speed) and expected_speed > 0):
        raise InputError(
            f"expected_speed ({expected_speed:g} rad/s) must be a positive speed: 860 rev/min is "
            "rpm(860)."
        )
    angle = expected_speed * recording.time
    return ShaftAngle(angle, recording.sample_rate, math.nan, math.nan, "the expected speed")


def _follow_line(recording: Recording, start: ShaftAngle, order: int, search: float) -> ShaftAngle:
    """Return the angle of the shaft from the line at one order."""
    name = recording.recording_id
    if start.turns < 2 * RIDGE_TURNS:
        raise DataError(
            f"{name}: {start.turns:.1f} revolutions; following a line needs {2 * RIDGE_TURNS}."
        )

    # The phase is ambiguous by whole turns of the line: the ridge brings it within half a turn.
    line = _Line.of(recording, start, order, search)
    change = _find_ridge(line, start, search)
    for _ in range(N_PASSES):
        change = change + np.unwrap(np.angle(line.strongest(change)[0])) / order
        change = _continue_ends(change, round(line.per_turn))
    deviation, quality = _judge_line(line, change, name)

    if np.median(np.abs(np.gradient(change) / np.gradient(line.turn))) > MAX_SEARCH_SHARE * search:
        raise DataError(
            f"{name}: the line detected for order {order} lies {search:.1%} off the speed, at the "
            "edge of the search; correct the speed."
        )
    sample = np.arange(len(start.angle), dtype=float)
    angle = start.angle + make_interp_spline(line.sample, change, k=3)(sample)
    if np.any(np.diff(angle) < 0):
        raise DataError(
            f"{name}: by its line at order {order} the shaft turns back; follow a stronger line."
        )
    source = f"the line at order {order}"
    return ShaftAngle(angle, recording.sample_rate, deviation, quality, source)


def _continue_ends(change: Float[np.ndarray, " value"], turn: int) -> Float[np.ndarray, " value"]:
    """Return a change of the angle whose first and last revolution continue their neighbors' pace.

    Filters see only half of the line there.
    """
    first_pace = (change[2 * turn] - change[turn]) / turn
    last_start = len(change) - 2 * turn - 1
    last_pace = (change[last_start + turn] - change[last_start]) / turn
    first_turn = change[turn] - first_pace * np.arange(turn, 0, -1)
    last_turn = change[-turn - 1] + last_pace * np.arange(1, turn + 1)
    return np.concatenate([first_turn, change[turn:-turn], last_turn])


@dataclass(frozen=True, eq=False)
class _Line:
    """The signal turned back by a first guess of the angle times the order, at a low rate."""

    order: int
    """Multiple of the shaft frequency."""
    sample: Float[np.ndarray, " value"]
    """Index of each value among the recording's samples."""
    values: Complex[np.ndarray, "channel value"]
    """Complex peak amplitude of what is near the line."""
    turn: Float[np.ndarray, " value"]
    """First guess of the angle [rad]."""
    per_turn: float
    """Values in one revolution, on average."""

    @staticmethod
    def of(recording: Recording, start: ShaftAngle, order: int, search: float) -> "_Line":
        """Return the line of a recording, at a rate that holds all speeds of the search."""
        shaft = start.mean_speed / (2 * math.pi)
        rate = max(VALUES_PER_TURN, 4 * (search * order + 1)) * shaft
        decimation = max(1, math.floor(recording.sample_rate / rate))

        signal = recording.signal - recording.signal.mean(axis=1, keepdims=True)
        turned = 2 * signal * np.exp(-1j * order * start.angle)
        values = scipy.signal.resample_poly(turned, 1, decimation, axis=-1)
        return _Line(
            order=order,
            sample=decimation * np.arange(values.shape[1], dtype=float),
            values=values,
            turn=start.angle[::decimation],
            per_turn=recording.sample_rate / decimation / shaft,
        )

    def isolate(
        self,
        change: Float[np.ndarray, " value"],
        half_width: float = BANDWIDTH,
        offset: float = 0.0,
    ) -> Complex[np.ndarray, "channel value"]:
        """Return the part of the signal within `half_width` orders of the line, or beside it.

        Parameters
        ----------
        change : change of the angle [rad].
        offset : distance of the band's center from the line [orders].
        """
        phase = self.order * change + offset * (self.turn + change)
        turned = self.values * np.exp(-1j * phase)
        sos = scipy.signal.butter(4, 2 * half_width / self.per_turn, output="sos")
        envelope: np.ndarray = scipy.signal.sosfiltfilt(sos, turned, axis=-1)
        return envelope

    def strongest(
        self, change: Float[np.ndarray, " value"]
    ) -> tuple[Complex[np.ndarray, " value"], Complex[np.ndarray, " channel"]]:
        """Return the sum of the channels that holds most of the line's power, and its weights."""
        lines = self.isolate(change)
        weights = np.linalg.eigh(lines @ lines.conj().T)[1][:, -1].conj()
        return weights @ lines, weights


def _find_ridge(line: _Line, start: ShaftAngle, search: float) -> Float[np.ndarray, " value"]:
    """Return a coarse change of the angle [rad]: the line's path through overlapping segments."""
    length = min(len(line.sample), round(RIDGE_TURNS * line.per_turn))
    remainder = len(line.sample) - length
    n_segments = math.ceil(4 * remainder / length) + 1
    first = np.unique(np.linspace(0, remainder, n_segments).astype(int))

    step = 1 / (RIDGE_FINENESS * RIDGE_TURNS * line.order)
    n_steps = math.ceil(search / step)
    speeds = step * np.arange(-n_steps, n_steps + 1)
    taper = hann_taper(length, symmetric=True)
    power = np.empty((len(first), len(speeds)))
    for row, begin in enumerate(first):
        part = slice(begin, begin + length)
        angle = line.turn[part] - line.turn[begin]
        turning = np.exp(-1j * line.order * np.outer(angle, speeds))
        channel_power = np.abs((line.values[:, part] * taper) @ turning) ** 2
        # Each channel over its mean, so that a loud channel does not outvote the others.
        mean = np.maximum(channel_power.mean(axis=1, keepdims=True), 1e-300)
        power[row] = (channel_power / mean).sum(axis=0)

    score = np.log(np.maximum(power, 1e-300))
    path = speeds[_strongest_path(score / max(score.std(), 1e-12))]
    factor = np.interp(np.arange(len(line.turn)), first + (length - 1) / 2, path)
    increments = np.diff(line.turn) * (factor[1:] + factor[:-1]) / 2
    return np.concatenate([[0.0], np.cumsum(increments)])


def _strongest_path(score: Float[np.ndarray, "segment speed"]) -> np.ndarray:
    """Return the column of each row on the path with the highest score (Viterbi).

    Steps between rows cost their square.
    """
    column = np.arange(score.shape[1])
    cost = RIDGE_PENALTY * ((column[:, None] - column) / RIDGE_FINENESS) ** 2
    best = score[0]
    origins = []
    for row in score[1:]:
        total = best[:, None] - cost
        origins.append(total.argmax(axis=0))
        best = total.max(axis=0) + row

    path = [int(best.argmax())]
    for origin in reversed(origins):
        path.append(int(origin[path[-1]]))
    return np.array(path[::-1])


def _fluctuating_noise(power: Float[np.ndarray, " value"], block: int) -> float:
    """Return the noise power that would make the line's power fluctuate as it does within blocks.

    A line in noise of K times less power has a variance of (2 K + 1) / (K + 1)² of its mean power
    squared, narrow noise without a line has 1. So a hump of broadband noise (flow about a blade
    frequency) is not taken for a line.
    """
    blocks = power[: len(power) // block * block].reshape(-1, block)
    relative_variance = blocks.var(axis=1) / np.maximum(blocks.mean(axis=1), 1e-300) ** 2
    unrest = float(np.median(relative_variance))
    return float(np.median(power)) * (1 - math.sqrt(max(1 - unrest, 0.0)))


def _judge_line(line: _Line, change: Float[np.ndarray, " value"], name: str) -> tuple[float, float]:
    """Return the deviation of the angle [rad], and the share of time in which the line is clear.

    The noise is read off half an order from the line.
    """
    strongest, weights = line.strongest(change)
    noise_medians = []
    for offset in (-0.5, 0.5):
        noise_power = np.abs(weights @ line.isolate(change, NOISE_HALF_WIDTH, offset)) ** 2
        noise_medians.append(np.median(noise_power))
    # The power of noise is distributed exponentially, whose median is ln 2 of its mean.
    noise_mean = float(np.mean(noise_medians)) / math.log(2)

    power = np.abs(strongest) ** 2
    noise = max(
        noise_mean * BANDWIDTH / NOISE_HALF_WIDTH,
        _fluctuating_noise(power, round(RIDGE_TURNS * line.per_turn)),
        1e-300,
    )
    quality = float(np.mean(power > MIN_PROMINENCE * noise))
    if quality < MIN_QUALITY:
        raise DataError(
            f"{name}: the line at order {line.order} stands clear of the noise for {quality:.0%} "
            "of the time only: follow a stronger one, correct the speed, or use a tachometer "
            "channel."
        )
    return math.sqrt(noise / (2 * float(np.median(power)))) / line.order, quality


N_SPEED_LINES = 3
"""Lowest piston-pass lines, from which the speed is estimated."""
N_ANGLE_LINES = 6
"""Lowest piston-pass lines, the clearest of which gives the angle."""
MAX_SPEED_ERROR = 0.02
"""Largest relative distance of the shaft's speed from the specified one."""
NEIGHBOR_SHARE = 0.45
"""Share of the distance to a line's neighbors, one order away, within which it is searched."""


def piston_pass_angle(recording: Recording, piston_count: int) -> ShaftAngle:
    """Return the angle of the shaft from the clearest of the lowest six piston-pass lines.

    The speed is searched within 2 % of the specified one. The lowest three lines, whose neighbors
    lie far away, give the speed; then any of the six is searched near that speed. If none of the
    three stands clear, the search is so narrow that no neighbor of the sixth is mistaken for it:
    about 1 % with seven pistons.

    Raises
    ------
    InputError
        No speed is specified.
    DataError
        No piston-pass line stands clear enough to be followed (`track_shaft_angle`).
    """
    lines = [piston_count * number for number in range(1, N_ANGLE_LINES + 1)]
    speed_lines = lines[:N_SPEED_LINES]
    wide_search = min(MAX_SPEED_ERROR, NEIGHBOR_SHARE / speed_lines[-1])
    fine_search = min(MAX_SPEED_ERROR, NEIGHBOR_SHARE / lines[-1])
    try:
        coarse = track_shaft_angle(recording, order=speed_lines, search=wide_search)
    except DataError:  # the lines above may still be followed
        return track_shaft_angle(recording, order=lines, search=fine_search)

    if recording.speed is None:
        return track_shaft_angle(
            recording, order=lines, expected_speed=coarse.mean_speed, search=fine_search
        )
    # A run-up has no single speed to search near, but one for each sample.
    with_speed = recording.replace(speed=np.maximum(coarse.speed, 0))
    return track_shaft_angle(with_speed, order=lines, search=fine_search)
