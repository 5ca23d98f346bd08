"""Channels that contain the signal of another one: a sensor that was recorded twice."""

from itertools import combinations
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from swashtwin.foundation import plural
from swashtwin.recordings.recording import Recording

# Samples from the middle of a recording that are compared: enough that two sensors of one machine
# differ, and few against the reading of a recording.
_BLOCK_SAMPLES = 8192

# Samples by which one channel may be late: converters that take turns, and a buffer of a logger.
_MAX_DELAY = 8

# Share of the power of the steps that is not that of the other channel, up to which both are one
# signal. Rounding to 16 bits leaves less than 1e-6; two sensors on one machine have noise of their
# own, of which steps consist more than the samples do.
_MAX_OWN_SHARE = 1e-4

# Ratio of the own shares one sample later and at the delay, from which on the delay is a delay:
# equal tones agree nearly as well at neighboring delays.
_MIN_DELAY_CONTRAST = 100.0


class DoubledChannel(NamedTuple):
    """A channel that contains the signal of another one."""

    channel: str
    """Name of the later channel, or of the second one if none is late."""
    original: str
    """Name of the other channel."""
    delay: int
    """Samples by which the channel is late."""

    @property
    def description(self) -> str:
        """What the channel contains, as a verb and its object."""
        late = f", {plural(self.delay, 'sample')} later" if self.delay else ""
        return f"contains the signal of channel {self.original}{late}"


def find_doubled_channels(recording: Recording) -> tuple[DoubledChannel, ...]:
    """Return the channels that contain the signal of another one, scaled or late or not.

    A few samples decide: their steps from one sample to the next are correlated at each delay.
    """
    if len(recording.channels) < 2 or recording.n_samples < 4 * _MAX_DELAY:
        return ()
    start = max(0, (recording.n_samples - _BLOCK_SAMPLES) // 2)
    block = recording.samples.signal_part(start, start + _BLOCK_SAMPLES)
    steps = np.diff(block.astype(np.float64), axis=1)

    doubled = []
    for first, second in combinations(range(len(steps)), 2):
        delay = _find_delay(steps[first], steps[second])
        if delay is None:
            continue
        original, channel = (first, second) if delay >= 0 else (second, first)
        names = recording.channels
        doubled.append(DoubledChannel(names[channel], names[original], abs(delay)))
    return tuple(doubled)


def _find_delay(
    first: Float[np.ndarray, " step"], second: Float[np.ndarray, " step"]
) -> int | None:
    """Return the samples by which the second signal is late against the first; None if it is
    another signal.
    """
    center = first[_MAX_DELAY:-_MAX_DELAY]
    shifted = np.lib.stride_tricks.sliding_window_view(second, center.size)
    power = float(center @ center)
    shifted_power = np.einsum("ij,ij->i", shifted, shifted)
    products = power * shifted_power
    if not np.isfinite(products).all() or (products <= 0).any():
        return None

    own_share = 1 - (shifted @ center) ** 2 / products
    index = int(own_share.argmin())
    best = max(float(own_share[index]), np.finfo(np.float64).eps)
    if best > _MAX_OWN_SHARE:
        return None
    neighbors = own_share[
        [number for number in (index - 1, index + 1) if 0 <= number < own_share.size]
    ]
    delay = index - _MAX_DELAY
    is_delay = delay == 0 or float(neighbors.min()) >= _MIN_DELAY_CONTRAST * best
    return delay if is_delay else None
