"""Band powers of a recording: third octaves and shaft orders, of the signal and of its envelope."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from jaxtyping import Float64

from swashtwin.foundation import InputError
from swashtwin.learning.windows.window_set import WindowLayout
from swashtwin.recordings import Recording, specified_shaft_frequency
from swashtwin.signals import (
    TURNS,
    BandPower,
    power_between,
    recording_density,
    require_shaft_frequency,
    running_sums,
    signal_envelope,
)

MAX_ORDERS = 40
"""Shaft orders that have a band power each."""
MIN_BAND_LINES = 4
"""Spectral lines in each band: the power of a single line scatters by 5.6 dB."""
BAND_RATIO = 2 ** (1 / 3)
"""Upper over lower edge of a wide band: a third octave."""
ORDER_WIDTH = 0.5
"""Width of the band around a shaft order [orders], within which a wandering speed smears the line.
"""
MIN_RELATIVE_POWER = 1e-12
"""Minimum power of a band over that of its channel; the steps of the converter are far above it."""
MAX_SEGMENT = 8192
"""Samples of each segment of the spectra if the speed is not known."""
MIN_RELATIVE_LENGTH = 0.5
"""Minimum length of a recording over the shortest one that it is compared with: band powers of a
shorter one scatter more.
"""
USABLE_BANDWIDTH = 0.45
"""Share of the sample rate up to which orders are used: converters filter what lies above."""


@dataclass(frozen=True)
class BandPowerLayout(WindowLayout):
    """Band powers that describe a recording.

    `length` is that of the half-overlapping segments of its spectra.
    """

    n_orders: int
    """Shaft orders 1, 2, ... that have a band power; 0 if the speed is not known or too few turns
    were recorded.
    """

    def __post_init__(self) -> None:
        if not (0 < self.sample_rate < math.inf and self.channels and self.length >= 2):
            raise InputError(
                "Band powers need a positive sample rate, a channel, and segments of 2 samples or "
                "more."
            )
        if not 0 <= self.n_orders <= MAX_ORDERS:
            raise InputError(f"n_orders ({self.n_orders}) must lie between 0 and {MAX_ORDERS}.")

    @cached_property
    def band_powers(self) -> tuple[BandPower, ...]:
        """What each band power is of: for each channel bands and orders of the signal, then those
        of its envelope.
        """
        edges = (band_edges(self.length // 2) * self.sample_rate / self.length).tolist()
        half = ORDER_WIDTH / 2

        table = []
        for channel in self.channels:
            for is_envelope in (False, True):
                for low, high in pairwise(edges):
                    table.append(BandPower(channel, is_envelope, None, low, high))
                for order in range(1, self.n_orders + 1):
                    table.append(BandPower(channel, is_envelope, order, order - half, order + half))
        return tuple(table)

    def measure(self, recording: Recording, shortest: int = 0) -> Float64[np.ndarray, " band"]:
        """Return the `band_powers` of a recording [dB of the squared unit].

        10 log10 of the mean square in the band, from power densities (Welch, Hann taper). The
        envelope is the magnitude of the analytic signal of the whole band. The recording is never
        whole in memory.

        Parameters
        ----------
        shortest : samples of the shortest recording that it is compared with.

        Raises
        ------
        DataError
            The recording is unfit or too short, or specifies no speed although orders are used.
        """
        shaft = require_shaft_frequency(recording) if self.n_orders else None
        density = recording_density(
            recording,
            self.length,
            min_samples=MIN_RELATIVE_LENGTH * shortest,
            transform_samples=_with_envelope,
        )

        # Channel and envelope have the same bands, so that the first share of the table is enough.
        n_bands = len(self.band_powers) // (2 * len(self.channels))
        low, high = np.array([band.edges(shaft) for band in self.band_powers[:n_bands]]).T
        lines_per_hertz = self.length / self.sample_rate
        sums = running_sums(density[..., 1:])
        power = power_between(sums, low * lines_per_hertz, high * lines_per_hertz)
        power = np.maximum(power, MIN_RELATIVE_POWER * sums[..., -1:] + 1e-300)
        return np.asarray(10 * np.log10(power / lines_per_hertz)).ravel()


def _with_envelope(signal: np.ndarray) -> np.ndarray:
    """Return each channel and its envelope."""
    envelope = signal_envelope(signal - signal.mean(axis=1, keepdims=True))
    return np.stack([signal, envelope], axis=1)


@dataclass(frozen=True)
class Deviation:
    """Distance of a recording from the healthy ones of its machine at its operating point."""

    score: float
    """Nonconformity score: squared Mahalanobis distance, up to a factor."""
    p_value: float
    """Conformal p-value: chance that a healthy recording is as far, at least 1 / (n + 1)."""
    change: Float64[np.ndarray, " band"]
    """Change [dB] of each band power from the mean of the healthy ones."""
    spreads: Float64[np.ndarray, " band"]
    """The same over the standard deviation of such a difference between healthy recordings."""
    point: str
    """Machine and operating point whose healthy recordings it was compared with; empty if there is
    only one.
    """
    notes: tuple[str, ...]
    """What was assumed because the recording does not specify it."""


def band_edges(n_lines: int) -> Float64[np.ndarray, " edge"]:
    """Return the edges of bands over the lines 1 to `n_lines`, in lines.

    Third octaves, but at least `MIN_BAND_LINES` wide.

    Examples
    --------
    >>> band_edges(40).round(1).tolist()
    [0.5, 4.5, 8.5, 12.5, 16.5, 20.8, 26.2, 33.0, 40.5]
    """
    end = n_lines + 0.5
    edges = [0.5]
    while edges[-1] < end:
        edges.append(max(edges[-1] * BAND_RATIO, edges[-1] + MIN_BAND_LINES))

    # A last band of less than half its width joins the one below it.
    if len(edges) > 2 and end - edges[-2] < (edges[-1] - edges[-2]) / 2:
        del edges[-1]
    edges[-1] = end
    return np.array(edges)


def band_power_layout(
    recordings: Sequence[Recording],
) -> tuple[BandPowerLayout, tuple[str, ...]]:
    """Return the band powers that all recordings allow, and a note if orders are missing.

    The recordings have one layout: sample rate, channels and unit.
    """
    first = recordings[0]
    n_samples = min(recording.n_samples for recording in recordings)
    duration = n_samples / first.sample_rate
    shafts = [specified_shaft_frequency(recording) for recording in recordings]
    specified_shafts = [shaft for shaft in shafts if shaft]

    reason = ""
    notes: tuple[str, ...] = ()
    if len(specified_shafts) < len(shafts):
        reason = f"{recordings[shafts.index(None)].recording_id} specifies no speed"
    elif duration * min(specified_shafts) < TURNS:
        n_turns = duration * min(specified_shafts)
        reason = f"the shortest recording covers {n_turns:.3g} of {TURNS} turns"
    if reason:
        segment = min(MAX_SEGMENT, n_samples)
        n_orders = 0
        notes = (f"Band powers at shaft orders are not compared: {reason}.",)
    else:
        segment = min(round(TURNS * first.sample_rate / min(specified_shafts)), n_samples)
        n_orders = min(
            MAX_ORDERS, int(USABLE_BANDWIDTH * first.sample_rate / max(specified_shafts))
        )

    layout = BandPowerLayout(
        float(first.sample_rate), first.channels, first.unit, segment, n_orders
    )
    return layout, notes
