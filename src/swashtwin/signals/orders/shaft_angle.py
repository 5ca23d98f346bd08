"""Where the shaft stood at each sample, and how well that is known."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from swashtwin.foundation import InputError
from swashtwin.recordings import Recording, stated_speed


@dataclass(frozen=True, eq=False)
class ShaftAngle:
    """Angle of the shaft at each sample of a recording."""

    angle: Float[np.ndarray, " time"]
    """Angle since some zero [rad], never falling."""
    sample_rate: float
    """Readings per second of the recording [Hz]."""
    deviation: float
    """Standard deviation of the angle's error [rad], as far as noise makes it; NaN where nothing tells."""
    quality: float
    """Share of the time in which the pulses or the line stood clear, 0 to 1; NaN where nothing was measured."""
    absolute: bool
    """Whether angle 0 is a mark on the shaft (one pulse per turn), so that phases mean something between recordings."""
    source: str
    """Where it comes from, in words."""

    @property
    def speed(self) -> Float[np.ndarray, " time"]:
        """Angular speed of the shaft at each sample [rad/s]."""
        return np.gradient(self.angle) * self.sample_rate

    @property
    def mean_speed(self) -> float:
        """Mean angular speed [rad/s]."""
        return float((self.angle[-1] - self.angle[0]) / (len(self.angle) - 1) * self.sample_rate)

    @property
    def turns(self) -> float:
        """Revolutions covered."""
        return float((self.angle[-1] - self.angle[0]) / (2 * math.pi))

    def require_fits(self, recording: Recording) -> None:
        """Refuse a recording of another length or rate than the angle's."""
        n_samples = recording.signal.shape[1]
        if len(self.angle) != n_samples or self.sample_rate != recording.sample_rate:
            raise InputError(
                f"{recording.recording_id} has {n_samples} samples at {recording.sample_rate:g} Hz, the angle "
                f"{len(self.angle)} at {self.sample_rate:g} Hz; take the angle from this recording."
            )


def stated_angle(recording: Recording) -> ShaftAngle:
    """Angle that the recording's own speed, or else the speed stated for it, adds up to.

    Raises
    ------
    InputError
        Nobody stated a speed, or the shaft stands still.
    """
    if recording.speed is not None:
        steps = (recording.speed[1:] + recording.speed[:-1]) / (2 * recording.sample_rate)
        angle = np.concatenate([[0.0], np.cumsum(steps)])
        source = "the recording's speed"
    else:
        shaft = stated_speed(recording)
        if shaft is None:
            raise InputError(
                f'{recording.recording_id}: nobody stated its speed; give one ("860 rpm"), or a tachometer channel.'
            )
        angle = 2 * math.pi * shaft * recording.time
        source = "the stated speed"
    if angle[-1] <= 0:
        raise InputError(f"{recording.recording_id}: the shaft stands still; there is no angle to go by.")
    return ShaftAngle(angle, recording.sample_rate, math.nan, math.nan, absolute=False, source=source)
