"""Levels of a recording: power in bands of frequency and at shaft orders, of the signal and of its
envelope.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from jaxtyping import Float64

from swashtwin.foundation import InputError
from swashtwin.learning.features import between, running_sums
from swashtwin.learning.windows.window_set import WindowLayout
from swashtwin.recordings import Recording, specified_shaft_frequency
from swashtwin.signals import TURNS, recording_density, shaft_frequency, signal_envelope

MOST_ORDERS = 40
"""Shaft orders that have levels, at most."""
LEAST_LINES = 4
"""Spectral lines in each band at least: the level of a single line scatters by 5.6 dB."""
_RATIO = 2 ** (1 / 3)
"""Upper over lower edge of a wide band: a third octave."""
_ORDER_WIDTH = 0.5
"""Width of the band around a shaft order, in orders; a wandering speed smears the line within
it.
"""
_FAINTEST = 1e-12
"""Power of a level over that of its channel, at least: the converter's steps are far above it."""
_SEGMENT = 8192
"""Samples of each segment at most, where the speed is not known."""
_SHORTEST = 0.5
"""Length of a recording over that of the shortest one it is compared with, at least: levels of a
shorter one scatter more.
"""


@dataclass(frozen=True)
class BandPower:
    """What one level is the power of; or another `quantity`."""

    channel: str
    """Channel; empty where it is of each."""
    is_envelope: bool
    """Whether it is of the envelope rather than of the signal."""
    order: int | None
    low: float
    """Lower edge: in Hz, of short windows in periods per sample; in shaft orders for an order."""
    high: float
    """Upper edge, likewise."""
    quantity: str = "power"
    """``"power"`` of a band, ``"deviation"`` of the whole, or ``"shape"`` of the waveform."""

    @property
    def is_band(self) -> bool:
        """Whether it is a band of the signal."""
        return self.order is None and not self.is_envelope and self.quantity == "power"

    def edges(self, shaft: float | None) -> tuple[float, float]:
        """Its edges [Hz] at a shaft frequency [Hz]."""
        factor = 1.0 if self.order is None else math.nan if shaft is None else shaft
        return self.low * factor, self.high * factor

    def words(self, shaft: float | None = None) -> str:
        """Where it is, such as ``shaft order 9 (129 Hz)`` at a shaft frequency [Hz].

        Examples
        --------
        >>> BandPower("x", True, 9, 8.75, 9.25).words(14.333)
        'shaft order 9 of the envelope (129 Hz)'
        """
        of = " of the envelope" if self.is_envelope else ""
        if self.order is None:
            return f"{_hertz(self.low)} to {_hertz(self.high)} Hz{of}"
        return f"shaft order {self.order}{of}" + (
            "" if shaft is None else f" ({_hertz(self.order * shaft)} Hz)"
        )


@dataclass(frozen=True)
class BandPowerLayout(WindowLayout):
    """Which levels a recording is described by; `length` is that of the half-overlapping segments
    of its spectra.
    """

    n_orders: int
    """Shaft orders 1, 2, ... that have levels; 0 where the speed is not known or too few turns were
    recorded.
    """

    def __post_init__(self) -> None:
        if not (0 < self.sample_rate < math.inf and self.channels and self.length >= 2):
            raise InputError(
                "levels need a positive sample rate, a channel, and segments of two samples at least."
            )
        if not 0 <= self.n_orders <= MOST_ORDERS:
            raise InputError(f"n_orders ({self.n_orders}) must lie between 0 and {MOST_ORDERS}.")

    @cached_property
    def band_powers(self) -> tuple[BandPower, ...]:
        """What each level is: for each channel bands and orders of the signal, then those of its
        envelope.
        """
        edges = (band_edges(self.length // 2) * self.sample_rate / self.length).tolist()
        half = _ORDER_WIDTH / 2
        return tuple(
            level
            for channel in self.channels
            for is_envelope in (False, True)
            for level in (
                *(BandPower(channel, is_envelope, None, *pair) for pair in pairwise(edges)),
                *(
                    BandPower(channel, is_envelope, k, k - half, k + half)
                    for k in range(1, self.n_orders + 1)
                ),
            )
        )

    def measure(self, recording: Recording, shortest: int = 0) -> Float64[np.ndarray, " level"]:
        """The recording's `band_powers` [dB of the squared unit]; it is never whole in memory.

        10 log10 of the mean square in the band, from power densities (Welch, Hann taper). The
        envelope is the magnitude of the analytic signal of the whole band.

        Parameters
        ----------
        shortest : samples of the shortest recording that it is compared with.

        Raises
        ------
        DataError
            The recording is unfit, too short, or states no speed where orders have levels.
        """
        shaft = shaft_frequency(recording) if self.n_orders else None

        def with_envelope(signal: np.ndarray) -> np.ndarray:
            return np.stack(
                [signal, signal_envelope(signal - signal.mean(axis=1, keepdims=True))], axis=1
            )

        density = recording_density(
            recording, self.length, least=_SHORTEST * shortest, of=with_envelope
        )
        low, high = np.array([level.edges(shaft) for level in self.band_powers[: self._n_each]]).T
        sums, per_hertz = running_sums(density[..., 1:]), self.length / self.sample_rate
        power = between(sums, low * per_hertz, high * per_hertz)
        return np.asarray(
            10 * np.log10(np.maximum(power, _FAINTEST * sums[..., -1:] + 1e-300) / per_hertz)
        ).ravel()

    @property
    def _n_each(self) -> int:
        """Levels of one signal: of a channel, or of its envelope."""
        return len(self.band_powers) // (2 * len(self.channels))


@dataclass(frozen=True)
class Deviation:
    """How far a recording is from the healthy ones of its machine at its operating point."""

    score: float
    """Nonconformity score: squared Mahalanobis distance, up to a factor."""
    p_value: float
    """Conformal p-value: chance that a healthy recording is as far, 1 / (n + 1) at least."""
    change: Float64[np.ndarray, " level"]
    """Change [dB] of each level from the mean of the healthy ones."""
    spreads: Float64[np.ndarray, " level"]
    """The same over the standard deviation of such a difference between healthy recordings."""
    point: str
    """Machine and operating point whose healthy recordings it was compared with, in words; empty
    for the only one.
    """
    notes: tuple[str, ...]
    """What was assumed, since the recording does not state it."""


def _hertz(value: float) -> str:
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"


def band_edges(n_lines: int) -> Float64[np.ndarray, " edge"]:
    """Edges of bands over the lines 1 to `n_lines`, in lines: third octaves, but no fewer than
    `LEAST_LINES` wide.

    Examples
    --------
    >>> band_edges(40).round(1).tolist()
    [0.5, 4.5, 8.5, 12.5, 16.5, 20.8, 26.2, 33.0, 40.5]
    """
    edges = [0.5]
    while edges[-1] < n_lines + 0.5:
        edges.append(max(edges[-1] * _RATIO, edges[-1] + LEAST_LINES))
    if len(edges) > 2 and n_lines + 0.5 - edges[-2] < (edges[-1] - edges[-2]) / 2:
        del edges[-1]
    edges[-1] = n_lines + 0.5
    return np.array(edges)


def band_power_layout(recordings: Sequence[Recording]) -> tuple[BandPowerLayout, tuple[str, ...]]:
    """(levels that all of one or more recordings of one layout allow, why orders are not among
    them).
    """
    first, shortest = recordings[0], min(recording.n_samples for recording in recordings)
    shafts = [specified_shaft_frequency(recording) for recording in recordings]
    stated = [shaft for shaft in shafts if shaft]
    segment, n_orders, reason = min(_SEGMENT, shortest), 0, ""
    if len(stated) < len(shafts):
        reason = f"{recordings[shafts.index(None)].recording_id} states no speed"
    elif shortest / first.sample_rate * min(stated) < TURNS:
        reason = f"the shortest recording covers {shortest / first.sample_rate * min(stated):.3g} of {TURNS} turns"
    else:
        segment = min(round(TURNS * first.sample_rate / min(stated)), shortest)
        n_orders = min(MOST_ORDERS, int(0.45 * first.sample_rate / max(stated)))
    notes = (f"Levels at shaft orders are not compared: {reason}.",) if reason else ()
    return BandPowerLayout(
        float(first.sample_rate), first.channels, first.unit, segment, n_orders
    ), notes
