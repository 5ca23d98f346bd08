"""A recording along the shaft's angle instead of along time."""

import math

import numpy as np
import scipy.signal
from jaxtyping import Float
from scipy.interpolate import make_interp_spline

from swashtwin.foundation import InputError
from swashtwin.recordings import Recording
from swashtwin.signals.orders.shaft_angle import ShaftAngle

_FINER = 4
"""The samples are first made that many times denser, so that a cubic between them is exact to 1e-3 below 0.4 of the
sample rate."""
_DENSEST = 64
"""Fine steps of the angle per step asked for, at most: a shaft that all but stops is not followed into aliasing."""


def resampled_by_angle(
    recording: Recording, angle: ShaftAngle, samples_per_turn: int, *, played_at: float | None = None
) -> Recording:
    """The recording at even steps of the shaft's angle, as if the shaft had turned steadily.

    Reading 0 lies at a whole multiple of 2 pi. Orders from half of `samples_per_turn` on are cut off in the angle
    domain, where the cut lies at the same order however the speed changed. The new `sample_rate` is `samples_per_turn`
    times the shaft frequency at which the turns are played back, so that order k stands at k times that frequency and
    every verb on recordings works as before; the attributes say ``domain = angle``, the samples per turn, and where
    the angle comes from. The condition stays that of the measurement; what lay in time (a resonance, mains hum) is
    smeared as the speed changes.

    Parameters
    ----------
    samples_per_turn : even number of samples per revolution; orders below 0.4 of it are kept to 1 %.
    played_at : angular speed of the steady turning [rad/s]; the mean speed by default. Recordings of several speeds
        that are to be cut into one set of windows need one in common.

    Raises
    ------
    InputError
        The angle belongs to another recording, there are too few samples per turn or less than one turn, or the
        recording lies along an angle already.
    """
    if recording.attributes.get("domain") == "angle":
        raise InputError(f"{recording.recording_id} lies along the shaft's angle already.")
    angle.require_fits(recording)
    if samples_per_turn < 4 or samples_per_turn % 2:
        raise InputError(f"samples_per_turn ({samples_per_turn}) must be an even number from 4 on.")
    speed = angle.mean_speed if played_at is None else played_at
    if not (math.isfinite(speed) and speed > 0):
        raise InputError(f"played_at ({speed:g} rad/s) must be a positive speed: 860 rev/min is rpm(860).")
    at, denser = _reading_at(angle, samples_per_turn)
    signal = _read_off(recording.signal, at)
    if denser > 1:
        signal = scipy.signal.resample_poly(signal, 1, denser, axis=-1, padtype="line")
    at = at[::denser][: signal.shape[1]]
    return recording.replace(
        signal=np.ascontiguousarray(signal),
        sample_rate=samples_per_turn * speed / (2 * math.pi),
        speed=np.interp(at, np.arange(len(angle.angle)), np.maximum(angle.speed, 0)),
        attributes={
            **recording.attributes,
            "domain": "angle",
            "samples_per_turn": str(samples_per_turn),
            "angle_from": angle.source,
        },
    )


def _reading_at(angle: ShaftAngle, samples_per_turn: int) -> tuple[Float[np.ndarray, " step"], int]:
    """Reading, with its fraction, at each fine step of the angle, and how many fine steps make one that was asked."""
    slowest = float(np.percentile(angle.speed, 1)) / (2 * math.pi)
    wanted_density = angle.sample_rate / (samples_per_turn * max(slowest, 1e-9))
    denser = math.ceil(min(max(wanted_density, 1.0), _DENSEST))
    step = 2 * math.pi / (samples_per_turn * denser)
    first = math.ceil(angle.angle[0] / (2 * math.pi) - 1e-9) * 2 * math.pi
    count = math.floor((angle.angle[-1] - first) / step + 1e-9) + 1
    if count < samples_per_turn * denser:
        raise InputError(f"{angle.turns:.2f} turns hold no whole one from a multiple of 2 pi on; record longer.")
    wanted = first + step * np.arange(count)
    return np.interp(wanted, angle.angle, np.arange(len(angle.angle), dtype=float)), denser


def _read_off(
    signal: Float[np.ndarray, "channel time"], at: Float[np.ndarray, " step"]
) -> Float[np.ndarray, "channel step"]:
    rows = []
    for row in signal:
        fine = scipy.signal.resample_poly(row, _FINER, 1, padtype="line")
        rows.append(make_interp_spline(np.arange(len(fine)) / _FINER, fine, k=3)(at))
    return np.stack(rows)
