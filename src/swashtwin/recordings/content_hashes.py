"""Hashes of what was measured, by which copies of a measurement are detected."""

import hashlib
import math
from collections.abc import Iterable

import numpy as np
from jaxtyping import Float, Shaped

# Relative difference of the steps of a ramp: those of a time written with few digits differ.
_RAMP_TOLERANCE = 0.25

# Samples that are tested first, because vibration shows within a few that it is not a ramp.
_RAMP_PREVIEW_SAMPLES = 64

# Hexadecimal digits of a hash that are kept: 128 bits, too many for two to agree by chance.
_HASH_DIGITS = 32


def rises_evenly(samples: Shaped[np.ndarray, " time"], step: float) -> bool:
    """Return whether samples change by about `step` each time, as a counter or a time does.

    If `step` is 0, return whether they are constant.
    """
    tolerance = _RAMP_TOLERANCE * abs(step)
    with np.errstate(invalid="ignore", over="ignore"):
        for part in (samples[:_RAMP_PREVIEW_SAMPLES], samples):
            if not (abs(np.diff(part) - step) <= tolerance).all():
                return False
    return True


class _ChannelHash:
    """Hash of one channel whose samples come in parts.

    Parameters
    ----------
    samples : first part.
    rounded : the same in single precision.
    """

    def __init__(
        self, samples: Float[np.ndarray, " time"], rounded: Float[np.ndarray, " time"]
    ) -> None:
        self._digest = hashlib.sha256()
        self._first_value = rounded[0]
        self._step = float(samples[1] - samples[0]) if samples.size > 1 else math.nan
        self._is_constant = True
        self._is_ramp = samples.size > 1
        self._previous = samples[:0]

    def update(
        self, samples: Float[np.ndarray, " time"], rounded: Float[np.ndarray, " time"]
    ) -> None:
        """Add the next samples, given also in single precision."""
        self._digest.update(rounded.data)
        if self._is_constant:
            self._is_constant = bool((rounded == self._first_value).all())
        if self._is_ramp:
            # The last sample of the previous part shows the step across the border.
            consecutive = np.concatenate([self._previous, samples])
            self._is_ramp = rises_evenly(consecutive, self._step)
        self._previous = samples[-1:].copy()

    def hexdigest(self) -> str:
        """Return the hash, or an empty text if the samples do not identify a measurement."""
        if self._is_constant or self._is_ramp:
            return ""
        return self._digest.hexdigest()[:_HASH_DIGITS]


def hash_channels(parts: Iterable[Float[np.ndarray, "channel time"]]) -> tuple[str, ...]:
    """Return the hash of each channel (`Samples.content_hashes`) of samples that come in parts."""
    hashes: list[_ChannelHash] = []

    for part in parts:
        with np.errstate(over="ignore"):
            rounded = part.astype(np.float32, order="C")
        rounded += 0.0  # turns -0.0 into 0.0: formats differ in the sign of zero

        if not hashes:
            for samples, row in zip(part, rounded, strict=True):
                hashes.append(_ChannelHash(samples, row))

        for channel_hash, samples, row in zip(hashes, part, rounded, strict=True):
            channel_hash.update(samples, row)

    return tuple(channel_hash.hexdigest() for channel_hash in hashes)
