"""Band powers of whole recordings, as many for a short recording as for a long one."""

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
import scipy
from jaxtyping import Complex, Float, Float32, Float64, Int64

from swashtwin.foundation import InputError
from swashtwin.learning.features import common_shift
from swashtwin.learning.windows.window_set import WindowSet
from swashtwin.signals import line_powers, power_between, running_sums, transform

MAX_SEGMENT = 1 << 18
"""Samples of a segment."""
N_THIRDS = 24
"""Third octaves: eight octaves up to half the sample rate."""
N_TWELFTHS = 4 * N_THIRDS
"""Bands of a twelfth octave that take the place of orders if the speed is not known."""
N_OCTAVES = 8
"""Octaves that third and twelfth octaves cover."""
MAX_ORDERS = 40
"""Shaft orders that have a band each."""
N_FLOORS = 8
"""Groups of orders, each with the mean power between its orders."""
N_ENVELOPES = 4
"""Octaves whose envelopes are described, the highest ones."""
N_ENVELOPE_BANDS = 20
"""Bands of each envelope: orders, or logarithmic bands."""
ORDER_HALF_WIDTH = 0.25
"""Half-width of the band around an order [orders]."""
FLOOR_EDGES = (0.3, 0.7)
"""Edges of the floor between two orders [orders from the lower one]."""
MAX_SPEED_ERROR = 0.025
"""Largest relative distance of the speed from the specified one, which is the set speed."""
N_SPEEDS = 101
"""Speeds that are tried within it."""
TOOTH_HALF_WIDTH = 0.06
"""Half-width of the bands by which a speed is judged [orders]."""
MIN_TURNS = 4
"""Turns of the shaft in a segment from which its orders are resolved."""
USABLE_BANDWIDTH = 0.45
"""Share of the sample rate up to which orders are used: converters filter what lies above."""
MIN_RELATIVE_POWER = 1e-12
"""Minimum power of a band over that of its channel; the steps of a converter are above it."""
LOWEST_ENVELOPE_SHARE = 2.0**-9
"""Lower edge of the logarithmic bands of an envelope, relative to their upper edge."""


@dataclass(frozen=True)
class RecordingBandLayout:
    """Band powers that describe recordings; their number does not depend on the length.

    Per channel 24 third octaves up to half the sample rate; the lines of shaft orders 1 to 40, the
    floor between them in eight groups, and lines 1 to 20 of the squared envelope of four octaves
    over its mean, which no gain changes. Without a speed, bands of a twelfth octave stand for the
    lines, and logarithmic bands of the envelopes for theirs. All are mean squares in dB.
    """

    sample_rate: float
    """Samples per second and channel [Hz]."""
    length: int
    """Samples of the segments, half-overlapping, whose powers are averaged; a shorter recording is
    one segment.
    """
    n_orders: int
    """Shaft orders that have a line; 0 if the speed is not known."""

    def __post_init__(self) -> None:
        has_valid_length = 2 <= self.length <= MAX_SEGMENT
        has_valid_orders = 0 <= self.n_orders <= MAX_ORDERS
        if not (0 < self.sample_rate < math.inf and has_valid_length and has_valid_orders):
            raise InputError(
                f"Band powers of recordings need a positive sample rate, segments of 2 to "
                f"{MAX_SEGMENT} samples, and at most {MAX_ORDERS} orders."
            )

    @classmethod
    def of(cls, windows: WindowSet, shortest: int) -> "RecordingBandLayout":
        """Return the layout that recordings with these windows allow.

        Parameters
        ----------
        shortest : samples of the shortest recording.
        """
        rate = windows.sample_rate
        shaft = windows.speed / (2 * np.pi)
        length = min(shortest, MAX_SEGMENT)
        n_orders = 0
        if np.isfinite(shaft).all() and shaft.min() * length / rate >= MIN_TURNS:
            n_orders = min(MAX_ORDERS, int(USABLE_BANDWIDTH * rate / shaft.max()))
        if n_orders < N_FLOORS:
            n_orders = 0
        return cls(rate, length, n_orders)

    @cached_property
    def n_scaled(self) -> int:
        """Band powers of a channel that rise with its gain; they come first."""
        if self.n_orders:
            return N_THIRDS + self.n_orders + len(self._floor_groups)
        return N_THIRDS + N_TWELFTHS

    @property
    def n_band_powers(self) -> int:
        """Band powers of a channel."""
        return self.n_scaled + N_ENVELOPES * N_ENVELOPE_BANDS

    @cached_property
    def _floor_groups(self) -> list[tuple[int, int]]:
        """First order of each group whose floors are averaged, and the first after it."""
        edges = np.geomspace(1, self.n_orders + 1, N_FLOORS + 1).round().astype(int)
        return list(pairwise(np.unique(edges).tolist()))

    def measure(
        self, signal: Float[np.ndarray, "channel time"], shaft: float
    ) -> Float32[np.ndarray, "channel band"]:
        """Return the band powers of a recording [dB of the squared unit; of envelopes dB].

        Parameters
        ----------
        shaft : shaft frequency [Hz], or NaN.
        """
        length = min(self.length, signal.shape[1])
        hop = max(1, length - length // 2)
        segment_powers = []
        for start in range(0, signal.shape[1] - length + 1, hop):
            segment_powers.append(self._measure_segment(signal[:, start : start + length], shaft))
        power = np.mean(segment_powers, axis=0)
        return np.asarray(10 * np.log10(power), dtype=np.float32)

    def _measure_segment(
        self, signal: Float[np.ndarray, "channel time"], shaft: float
    ) -> Float64[np.ndarray, "channel band"]:
        """Return the mean squares of the bands of one segment."""
        mean = signal.mean(axis=1, keepdims=True, dtype=np.float64).astype(np.float32)
        x = signal.astype(np.float32) - mean
        highest_line = x.shape[1] / 2
        lines_per_order = shaft * x.shape[1] / self.sample_rate
        sums = running_sums(line_powers(x))

        parts = [_octave_band_powers(sums, highest_line, 3)]
        if self.n_orders:
            order = np.arange(1, self.n_orders + 1)
            lines_per_order *= _speed_correction(sums, order, lines_per_order)
            parts += self._order_powers(sums, order, lines_per_order)
        else:
            parts.append(_octave_band_powers(sums, highest_line, 12))
        scaled = np.concatenate(parts, axis=1)
        scaled = np.maximum(scaled, MIN_RELATIVE_POWER * sums[:, -1:] + 1e-30)

        lines = transform(x)
        envelopes = []
        for octave in range(N_ENVELOPES, 0, -1):
            lowest_line = highest_line / 2**octave
            envelopes.append(self._envelope_powers(lines, lowest_line, lines_per_order))
        return np.concatenate([scaled, *envelopes], axis=1)

    def _order_powers(
        self,
        sums: Float64[np.ndarray, "channel edge"],
        order: Int64[np.ndarray, " order"],
        lines_per_order: float,
    ) -> list[Float64[np.ndarray, "channel band"]]:
        """Return the power of each order, and the mean floor of each group of orders."""
        lines = power_between(
            sums,
            (order - ORDER_HALF_WIDTH) * lines_per_order,
            (order + ORDER_HALF_WIDTH) * lines_per_order,
        )
        floor = power_between(
            sums,
            (order + FLOOR_EDGES[0]) * lines_per_order,
            (order + FLOOR_EDGES[1]) * lines_per_order,
        )
        group_floors = []
        for first, end in self._floor_groups:
            group_floors.append(floor[:, first - 1 : end - 1].mean(axis=1))
        return [lines, np.stack(group_floors, axis=1)]

    def _envelope_powers(
        self,
        lines: Complex[np.ndarray, "channel line"],
        lowest_line: float,
        lines_per_order: float,
    ) -> Float64[np.ndarray, "channel band"]:
        """Return band powers of an octave's squared envelope, over the square of its mean."""
        first = int(lowest_line)
        end = int(2 * lowest_line)
        # Twice the width of the octave, because the squared envelope has twice its bandwidth.
        count = scipy.fft.next_fast_len(2 * max(end - first, 8))
        analytic = scipy.fft.ifft(lines[:, first:end], count, axis=1)
        square = analytic.real**2 + analytic.imag**2
        square /= np.maximum(square.mean(axis=1, keepdims=True), 1e-30)

        if self.n_orders:
            number = np.arange(1, N_ENVELOPE_BANDS + 1)
            low = (number - ORDER_HALF_WIDTH) * lines_per_order
            high = (number + ORDER_HALF_WIDTH) * lines_per_order
        else:
            shares = np.geomspace(LOWEST_ENVELOPE_SHARE, 1, N_ENVELOPE_BANDS + 1)
            edges = shares * (lines.shape[1] - 1) / 2**N_ENVELOPES
            low = edges[:-1]
            high = edges[1:]
        sums = running_sums(line_powers(square - 1)[:, : int(high[-1]) + 2])
        return np.maximum(power_between(sums, low, high), 1e-12)

    def shapes(
        self, band_powers: Float[np.ndarray, "*row channel band"]
    ) -> Float[np.ndarray, "*row channel band"]:
        """Return band powers without the gain of each channel, the mean of its third octaves."""
        shaped = band_powers.copy()
        shaped[..., : self.n_scaled] -= band_powers[..., :N_THIRDS].mean(axis=-1, keepdims=True)
        return shaped

    def without_gain(
        self, change: Float[np.ndarray, "channel band"]
    ) -> Float[np.ndarray, "channel band"]:
        """Return changes without what a channel's gain explains (`common_shift`)."""
        corrected = change.copy()
        corrected[:, : self.n_scaled] -= common_shift(change[:, :N_THIRDS])[:, None]
        return corrected


def _octave_band_powers(
    sums: Float64[np.ndarray, "channel edge"], highest_line: float, per_octave: int
) -> Float64[np.ndarray, "channel band"]:
    """Return the power in each band of equal ratio of the eight octaves up to a line."""
    steps = np.arange(N_OCTAVES * per_octave, -1, -1)
    edges = highest_line * 2.0 ** (-steps / per_octave)
    return power_between(sums, edges[:-1], edges[1:])


def _speed_correction(
    sums: Float64[np.ndarray, "channel edge"],
    order: Int64[np.ndarray, " order"],
    lines_per_order: float,
) -> float:
    """Return the factor on the specified speed for which the orders stand out most."""
    factor = np.linspace(1 - MAX_SPEED_ERROR, 1 + MAX_SPEED_ERROR, N_SPEEDS)
    teeth = np.outer(factor, order)
    line = power_between(
        sums,
        (teeth - TOOTH_HALF_WIDTH).ravel() * lines_per_order,
        (teeth + TOOTH_HALF_WIDTH).ravel() * lines_per_order,
    )
    line = line.reshape(-1, *teeth.shape)
    around = power_between(sums, (order - 0.5) * lines_per_order, (order + 0.5) * lines_per_order)
    share = line / np.maximum(around[:, None], 1e-30)

    # The logarithm, so that many faint lines count for more than one loud one.
    prominence = np.log(share + 1e-3).sum(axis=(0, 2))
    return float(factor[prominence.argmax()])
