"""From time to turns: the angle of the shaft at each sample, and the recording along that angle.

A speed that wanders by half a percent smears the line at order 100 over half an order; along the
shaft's angle it is sharp. The angle comes from a tachometer channel (`tachometer_angle`), from
a line of the signal itself (`tracking.track_shaft_angle`), or from the specified speed
(`specified_angle`).
"""

import math
from dataclasses import dataclass

import numpy as np
import scipy
import scipy.signal
from jaxtyping import Float
from scipy.interpolate import PchipInterpolator, make_interp_spline

from swashtwin.foundation import DataError, InputError, plural
from swashtwin.recordings import Recording, specified_shaft_frequency


@dataclass(frozen=True, eq=False)
class ShaftAngle:
    """Angle of the shaft at each sample of a recording."""

    angle: Float[np.ndarray, " time"]
    """Angle since some zero [rad], never falling."""
    sample_rate: float
    """Readings per second of the recording [Hz]."""
    deviation: float
    """Standard deviation of the angle's error [rad] by noise; NaN if it is not known."""
    quality: float
    """Share of the time in which the pulses or the line stood clear, 0 to 1; NaN if the angle was
    not measured.
    """
    source: str
    """Description of its source."""

    @property
    def speed(self) -> Float[np.ndarray, " time"]:
        """Angular speed of the shaft at each sample [rad/s]."""
        speed: np.ndarray = np.gradient(self.angle) * self.sample_rate
        return speed

    @property
    def mean_speed(self) -> float:
        """Mean angular speed [rad/s]."""
        return float((self.angle[-1] - self.angle[0]) / (len(self.angle) - 1) * self.sample_rate)

    @property
    def turns(self) -> float:
        """Revolutions covered."""
        return float((self.angle[-1] - self.angle[0]) / (2 * math.pi))

    def require_fits(self, recording: Recording) -> None:
        """Raise an `InputError` if a recording has another length or rate than the angle."""
        n_samples = recording.signal.shape[1]
        if len(self.angle) != n_samples or self.sample_rate != recording.sample_rate:
            raise InputError(
                f"{recording.recording_id} has {n_samples} samples at "
                f"{recording.sample_rate:g} Hz, the angle {len(self.angle)} at "
                f"{self.sample_rate:g} Hz; take the angle from this recording."
            )


def specified_angle(recording: Recording) -> ShaftAngle:
    """Return the angle that the recording's speed, or else its specified speed, adds up to.

    Raises
    ------
    InputError
        No speed is specified, or the shaft stands still.
    """
    if recording.speed is not None:
        steps = (recording.speed[1:] + recording.speed[:-1]) / (2 * recording.sample_rate)
        angle = np.concatenate([[0.0], np.cumsum(steps)])
        source = "the recording's speed"
    else:
        shaft = specified_shaft_frequency(recording)
        if shaft is None:
            raise InputError(
                f'{recording.recording_id} specifies no speed: give one ("860 rpm"), or a '
                "tachometer channel."
            )
        angle = 2 * math.pi * shaft * recording.time
        source = "the specified speed"

    if angle[-1] <= 0:
        raise InputError(
            f"{recording.recording_id}: the shaft stands still, so that it has no angle."
        )
    return ShaftAngle(angle, recording.sample_rate, math.nan, math.nan, source)


RISE_SHARE = 0.6
"""Share of the signal's range above which a pulse has begun."""
FALL_SHARE = 0.4
"""Share of the range below which it has ended. Two thresholds, so that noise counts no pulse twice.
"""
MAX_INTERVAL_RATIO = 1.5
"""Ratio of an interval to its neighbors from which a pulse was missed or counted twice."""
MIN_PULSES = 3
"""Pulses that a speed needs: two intervals can be compared."""


def tachometer_angle(recording: Recording, channel: str, pulses_per_turn: int = 1) -> ShaftAngle:
    """Return the angle of the shaft from the rising edges of a tachometer channel.

    Each edge is placed between two samples by a straight line; between edges the angle follows a
    monotone cubic (Fritsch and Carlson), before the first and after the last it goes on at the
    nearest interval's speed. With one pulse per turn angle 0 is the first pulse, the same mark in
    every recording. An encoder's marks are taken as evenly spaced.

    Parameters
    ----------
    channel : name of the tachometer channel.
    pulses_per_turn : pulses in one revolution of the shaft.

    Raises
    ------
    InputError
        No such channel, or a count below 1.
    DataError
        Fewer than three pulses, missing samples, or a pulse that was missed or counted twice.

    Examples
    --------
    >>> time = np.arange(10000) / 1000
    >>> pulses = (np.mod(12.5 * time, 1) < 0.1) * 5.0
    >>> angle = tachometer_angle(Recording(pulses[None], 1000.0, "a", ("tacho",)), "tacho")
    >>> print(f"{angle.mean_speed * 60 / (2 * np.pi):.1f} rev/min")
    750.0 rev/min
    """
    if pulses_per_turn < 1:
        raise InputError(f"pulses_per_turn ({pulses_per_turn}) must be 1 or more.")
    name = f"{recording.recording_id}, {channel}"
    samples = recording.select_channels([channel]).signal[0]
    if not np.isfinite(samples).all():
        raise DataError(f"{name}: samples are missing, so that pulses cannot be counted.")
    pulses = _rising_edges(samples)
    if len(pulses) < MIN_PULSES:
        raise DataError(
            f"{name}: {len(pulses)} pulses; a speed needs at least {MIN_PULSES}. Is it a "
            "tachometer?"
        )
    _require_even_pulses(pulses / recording.sample_rate, name)

    marks = 2 * math.pi / pulses_per_turn * np.arange(len(pulses))
    angle = _interpolate_angle(pulses, marks, len(samples))
    # The second difference of evenly noisy edges has six times their variance; a real acceleration
    # only adds to it.
    scatter = float(np.std(np.diff(pulses, 2))) / math.sqrt(6)
    rate = float((marks[-1] - marks[0]) / (pulses[-1] - pulses[0]))
    covered = float((pulses[-1] - pulses[0]) / (len(samples) - 1))
    source = f"{channel}, {plural(pulses_per_turn, 'pulse')} per turn"
    return ShaftAngle(angle, recording.sample_rate, scatter * rate, covered, source)


def _require_even_pulses(time: Float[np.ndarray, " pulse"], name: str) -> None:
    """Raise a `DataError` if a pulse was missed or counted twice.

    Parameters
    ----------
    time : time of each pulse [s].
    name : recording and channel, for the message.
    """
    interval = np.diff(time)
    neighbors = scipy.ndimage.median_filter(interval, size=min(5, len(interval)), mode="nearest")
    ratio = interval / neighbors
    uneven = np.flatnonzero((ratio > MAX_INTERVAL_RATIO) | (ratio < 1 / MAX_INTERVAL_RATIO))
    if len(uneven):
        index = uneven[0]
        raise DataError(
            f"{name}: the pulses at {time[index]:.4f} s and {time[index + 1]:.4f} s lie "
            f"{ratio[index]:.2f} times their neighbors' distance apart; a pulse was missed or "
            "counted twice, or the marks are uneven."
        )


def _rising_edges(samples: Float[np.ndarray, " time"]) -> Float[np.ndarray, " pulse"]:
    """Return the sample, with its fraction, at which each pulse rises through half the range."""
    low = float(samples.min())
    high = float(samples.max())
    if high <= low:
        return np.empty(0)

    share = (samples - low) / (high - low)
    # Samples between the thresholds have no state: a pulse must cross both of them.
    state = np.zeros(len(share), dtype=int)
    state[share >= RISE_SHARE] = 1
    state[share <= FALL_SHARE] = -1
    certain = np.flatnonzero(state)
    rises = np.flatnonzero((state[certain[1:]] == 1) & (state[certain[:-1]] == -1))

    edges = []
    for low_sample, high_sample in zip(certain[rises], certain[rises + 1], strict=True):
        rise = share[low_sample : high_sample + 1]
        index = int(np.flatnonzero((rise[:-1] < 0.5) & (rise[1:] >= 0.5))[0])
        fraction = (0.5 - rise[index]) / (rise[index + 1] - rise[index])
        edges.append(low_sample + index + fraction)
    return np.array(edges)


def _interpolate_angle(
    pulses: Float[np.ndarray, " pulse"], marks: Float[np.ndarray, " pulse"], n_samples: int
) -> Float[np.ndarray, " time"]:
    """Return the angle at each sample, which continues at the nearest interval's speed."""
    sample = np.arange(n_samples, dtype=float)
    angle: np.ndarray = PchipInterpolator(pulses, marks)(np.clip(sample, pulses[0], pulses[-1]))
    first_rate = (marks[1] - marks[0]) / (pulses[1] - pulses[0])
    last_rate = (marks[-1] - marks[-2]) / (pulses[-1] - pulses[-2])
    lead_in = np.minimum(sample - pulses[0], 0) * first_rate
    lead_out = np.maximum(sample - pulses[-1], 0) * last_rate
    extended: np.ndarray = angle + lead_in + lead_out
    return extended


OVERSAMPLING = 4
"""Factor by which samples are first made denser: a cubic between them is then exact to 1e-3 below
0.4 of the sample rate.
"""
MAX_FINE_STEPS = 64
"""Fine steps of the angle per requested step: a shaft that all but stops is not followed further,
and aliases.
"""


def resample_by_angle(
    recording: Recording,
    angle: ShaftAngle,
    samples_per_turn: int | None = None,
    *,
    played_at: float | None = None,
) -> Recording:
    """Return the recording at even steps of the shaft's angle, as if the shaft turned steadily.

    Sample 0 lies at a whole multiple of 2 pi. Orders from half of `samples_per_turn` on are cut off
    along the angle, so that the cut lies at the same order however the speed changed. The new
    `sample_rate` is `samples_per_turn` times the shaft frequency at which the turns are played
    back: order k stands at k times that frequency, and every function on recordings works as
    before. The attributes state ``domain = angle``, the samples per turn, and the source of the
    angle. The operating point stays that of the measurement. What is fixed in time (a resonance,
    mains hum) is smeared as the speed changes.

    Parameters
    ----------
    samples_per_turn : even number of samples per revolution; orders below 0.4 of it are kept to 1
        %. None takes as many as the fastest turn has.
    played_at : angular speed of the steady turning [rad/s]; the mean speed by default. Recordings
        of several speeds that are to be cut into one set of windows need one in common.

    Raises
    ------
    InputError
        The angle belongs to another recording, there are too few samples per turn or less than one
        turn, or the recording lies along an angle already.
    """
    if recording.attributes.get("domain") == "angle":
        raise InputError(f"{recording.recording_id} lies along the shaft's angle already.")
    angle.require_fits(recording)

    if samples_per_turn is None:
        samples_per_turn = 2 * math.ceil(recording.sample_rate * math.pi / float(angle.speed.max()))
    if samples_per_turn < 4 or samples_per_turn % 2:
        raise InputError(f"samples_per_turn ({samples_per_turn}) must be an even number from 4 on.")
    speed = angle.mean_speed if played_at is None else played_at
    if not (math.isfinite(speed) and speed > 0):
        raise InputError(
            f"played_at ({speed:g} rad/s) must be a positive speed: 860 rev/min is rpm(860)."
        )

    sample, n_fine = _samples_at_steps(angle, samples_per_turn)
    rows = []
    for row in recording.signal:
        dense = scipy.signal.resample_poly(row, OVERSAMPLING, 1, padtype="line")
        spline = make_interp_spline(np.arange(len(dense)) / OVERSAMPLING, dense, k=3)
        rows.append(spline(sample))
    signal = np.stack(rows)
    if n_fine > 1:
        signal = scipy.signal.resample_poly(signal, 1, n_fine, axis=-1, padtype="line")
    sample = sample[::n_fine][: signal.shape[1]]

    return recording.replace(
        signal=np.ascontiguousarray(signal),
        sample_rate=samples_per_turn * speed / (2 * math.pi),
        speed=np.interp(sample, np.arange(len(angle.angle)), np.maximum(angle.speed, 0)),
        attributes={
            **recording.attributes,
            "domain": "angle",
            "samples_per_turn": str(samples_per_turn),
            "angle_from": angle.source,
        },
    )


def _samples_at_steps(
    angle: ShaftAngle, samples_per_turn: int
) -> tuple[Float[np.ndarray, " step"], int]:
    """Return the sample, with its fraction, at each fine step of the angle.

    The second value is the number of fine steps in a requested one. It suits the slowest part
    of the recording, so that nothing is aliased there.
    """
    # A percentile, because noise of the angle may make the speed of single samples very low.
    slowest_shaft = float(np.percentile(angle.speed, 1)) / (2 * math.pi)
    density = angle.sample_rate / (samples_per_turn * max(slowest_shaft, 1e-9))
    n_fine = math.ceil(min(max(density, 1.0), MAX_FINE_STEPS))

    step = 2 * math.pi / (samples_per_turn * n_fine)
    first = math.ceil(angle.angle[0] / (2 * math.pi) - 1e-9) * 2 * math.pi
    count = math.floor((angle.angle[-1] - first) / step + 1e-9) + 1
    if count < samples_per_turn * n_fine:
        raise InputError(
            f"{angle.turns:.2f} turns hold no whole one from a multiple of 2 pi on; record longer."
        )
    steps = first + step * np.arange(count)
    return np.interp(steps, angle.angle, np.arange(len(angle.angle), dtype=float)), n_fine
