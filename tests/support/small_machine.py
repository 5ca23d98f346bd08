"""A machine to watch, whose orders and noise scatter a little; a recording takes a millisecond."""

import math

import numpy as np

from swashtwin.foundation import MPa, random_stream
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import Recording

RATE = 4000.0
SHAFT = 20.0
CHANNELS = ("x", "y", "z")


class Machine:
    """A machine with three sensors."""

    def recording(self, number: int, *, rise: float = 0.0, seconds: float = 1.0) -> Recording:
        """Recording `number`; orders 5 to 9 of channel x stand `rise` [dB] above the healthy
        ones.
        """
        rng = random_stream(0, "machine", number)
        time = np.arange(round(seconds * RATE)) / RATE
        order = np.arange(1, 13)
        amplitude = np.array([1.0, 0.5, 0.25])[:, None] / np.array(
            [order, order[::-1], order**0.5 + order % 3]
        )
        amplitude = amplitude * 10 ** (rng.normal(0, 0.5, (3, 12)) / 20)
        amplitude[0, 4:9] *= 10 ** (rise / 20)
        phase = random_stream(0, "phase").uniform(0, 2 * math.pi, (3, 12, 1)) + rng.normal(
            0, 0.1, (3, 12, 1)
        )
        signal = (
            amplitude[..., None] * np.sin(2 * math.pi * SHAFT * order[:, None] * time + phase)
        ).sum(axis=1)
        signal = signal + 0.05 * 10 ** (rng.normal(0, 0.3) / 20) * rng.normal(size=signal.shape)
        condition = OperatingCondition(2 * math.pi * SHAFT, MPa(10))

        return Recording(
            signal,
            RATE,
            f"r{number}",
            channels=CHANNELS,
            condition=condition,
            specimen="A",
        )
