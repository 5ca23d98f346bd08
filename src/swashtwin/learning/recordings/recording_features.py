"""Levels of whole recordings, and what of one differs from the healthy ones of its machine."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import compress, pairwise

import numpy as np
import scipy
from jaxtyping import Bool, Float, Float32, Float64, Int64

from swashtwin.foundation import InputError
from swashtwin.learning.features import common_shift
from swashtwin.learning.windows.window_set import WindowSet, group_means, operating_points
from swashtwin.signals import line_powers, power_between, running_sums, transform

LONGEST = 1 << 18
"""Samples of a segment, at most."""
_THIRDS, _ORDERS, _ENVELOPE_ORDERS, _FLOORS, _OCTAVES = 24, 40, 20, 8, 4
_LINE, _BETWEEN = 0.25, (0.3, 0.7)
"""Half the width of the band around an order, and where the floor between two orders is read, in
orders.
"""
_SEARCH, _STEPS, _NARROW = 0.025, 101, 0.06
"""How far from the stated speed the comb of orders may lie, in so many steps, and half the width of
its teeth.
"""
_LEAST_TURNS = 4
"""Turns of the shaft in a segment from which orders are told apart."""
_FAINTEST = 1e-12
"""Least power of a band over that of its channel: steps of a converter are above it."""


@dataclass(frozen=True)
class RecordingBandLayout:
    """Which levels recordings are described by; their number does not depend on how long a
    recording is.

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
    """Shaft orders that have a line; 0 where no speed is stated."""

    def __post_init__(self) -> None:
        if not (
            0 < self.sample_rate < math.inf
            and 2 <= self.length <= LONGEST
            and 0 <= self.n_orders <= _ORDERS
        ):
            raise InputError(
                f"levels need a rate, segments of 2 to {LONGEST} samples and {_ORDERS} orders at most."
            )

    @classmethod
    def of(cls, windows: WindowSet, shortest: int) -> "RecordingBandLayout":
        """The levels that recordings with these windows allow, the shortest of so many samples."""
        rate, shaft = windows.sample_rate, windows.speed / (2 * np.pi)
        length = min(shortest, LONGEST)
        n_orders = 0
        if np.isfinite(shaft).all() and shaft.min() * length / rate >= _LEAST_TURNS:
            n_orders = min(_ORDERS, int(0.45 * rate / shaft.max()))
        return cls(rate, length, n_orders if n_orders >= _FLOORS else 0)

    @cached_property
    def n_scaled(self) -> int:
        """Levels of a channel that rise with its gain; they come first."""
        return _THIRDS + (self.n_orders + len(self._groups) if self.n_orders else 4 * _THIRDS)

    @property
    def n_band_powers(self) -> int:
        """Levels of a channel."""
        return self.n_scaled + _OCTAVES * _ENVELOPE_ORDERS

    @cached_property
    def _groups(self) -> list[tuple[int, int]]:
        """First order of each group whose floors are one level, and the first after it."""
        edges = np.unique(np.geomspace(1, self.n_orders + 1, _FLOORS + 1).round().astype(int))
        return list(pairwise(edges.tolist()))

    def measure(
        self, signal: Float[np.ndarray, "channel time"], shaft: float
    ) -> Float32[np.ndarray, "channel level"]:
        """Levels of a recording [dB of the squared unit; of envelopes dB] at a shaft frequency [Hz
        or NaN].
        """
        length = min(self.length, signal.shape[1])
        starts = range(0, signal.shape[1] - length + 1, max(1, length - length // 2))
        power = np.mean(
            [self._powers(signal[:, start : start + length], shaft) for start in starts], axis=0
        )
        return np.asarray(10 * np.log10(power), dtype=np.float32)

    def _powers(
        self, signal: Float[np.ndarray, "channel time"], shaft: float
    ) -> Float64[np.ndarray, "channel level"]:
        x = signal.astype(np.float32) - signal.mean(axis=1, keepdims=True, dtype=np.float64).astype(
            np.float32
        )
        highest = x.shape[1] / 2
        per_order = shaft * x.shape[1] / self.sample_rate
        sums = running_sums(line_powers(x))
        parts = [_bands(sums, highest, 3)]
        if self.n_orders:
            order = np.arange(1, self.n_orders + 1)
            per_order *= _aligned(sums, order, per_order)
            parts.append(
                power_between(sums, (order - _LINE) * per_order, (order + _LINE) * per_order)
            )
            floor = power_between(
                sums, (order + _BETWEEN[0]) * per_order, (order + _BETWEEN[1]) * per_order
            )
            parts.append(
                np.stack([floor[:, a - 1 : b - 1].mean(axis=1) for a, b in self._groups], axis=1)
            )
        else:
            parts.append(_bands(sums, highest, 12))
        parts[:] = [np.maximum(np.concatenate(parts, axis=1), _FAINTEST * sums[:, -1:] + 1e-30)]
        lines = transform(x)
        for octave in range(_OCTAVES, 0, -1):
            parts.append(self._envelope(lines, highest / 2**octave, per_order))
        return np.concatenate(parts, axis=1)

    def _envelope(
        self, lines: np.ndarray, low: float, per_order: float
    ) -> Float64[np.ndarray, "channel level"]:
        """Powers of lines of the squared envelope of the octave above line `low`, over its mean
        squared.
        """
        first, last = int(low), int(2 * low)
        count = scipy.fft.next_fast_len(2 * max(last - first, 8))
        analytic = scipy.fft.ifft(lines[:, first:last], count, axis=1)
        square = analytic.real**2 + analytic.imag**2
        square /= np.maximum(square.mean(axis=1, keepdims=True), 1e-30)
        number = np.arange(1, _ENVELOPE_ORDERS + 1)
        if self.n_orders:
            edges = (number - _LINE) * per_order, (number + _LINE) * per_order
        else:
            bands = (
                np.geomspace(2.0**-9, 1, _ENVELOPE_ORDERS + 1) * (lines.shape[1] - 1) / 2**_OCTAVES
            )
            edges = bands[:-1], bands[1:]
        sums = running_sums(line_powers(square - 1)[:, : int(edges[1][-1]) + 2])
        return np.maximum(power_between(sums, *edges), 1e-12)

    def shapes(
        self, band_powers: Float[np.ndarray, "*row channel level"]
    ) -> Float[np.ndarray, "*row channel level"]:
        """Levels less the mean of each channel's third octaves where they rise with its gain."""
        shaped = band_powers.copy()
        shaped[..., : self.n_scaled] -= band_powers[..., :_THIRDS].mean(axis=-1, keepdims=True)
        return shaped

    def without_gain(
        self, change: Float[np.ndarray, "channel level"]
    ) -> Float[np.ndarray, "channel level"]:
        """Changes of levels less what a channel's gain explains (`common_shift`)."""
        corrected = change.copy()
        corrected[:, : self.n_scaled] -= common_shift(change[:, :_THIRDS])[:, None]
        return corrected


def _bands(
    sums: Float64[np.ndarray, "channel edge"], highest: float, per_octave: int
) -> Float64[np.ndarray, "channel band"]:
    """Power in each band of equal ratio of eight octaves up to line `highest`."""
    edges = highest * 2.0 ** (-np.arange(8 * per_octave, -1, -1) / per_octave)
    return power_between(sums, edges[:-1], edges[1:])


def _aligned(
    sums: Float64[np.ndarray, "channel edge"], order: Int64[np.ndarray, " order"], per_order: float
) -> float:
    """Factor on the stated speed under which a comb of orders stands out most: what is stated is
    the set speed.
    """
    factor = np.linspace(1 - _SEARCH, 1 + _SEARCH, _STEPS)
    teeth = np.outer(factor, order)
    line = power_between(
        sums, (teeth - _NARROW).ravel() * per_order, (teeth + _NARROW).ravel() * per_order
    )
    line = line.reshape(-1, *teeth.shape)
    around = power_between(sums, (order - 0.5) * per_order, (order + 0.5) * per_order)[:, None]
    return float(factor[np.log(line / np.maximum(around, 1e-30) + 1e-3).sum(axis=(0, 2)).argmax()])


MIN_REFERENCES = 2
"""Healthy recordings of a machine from which changes from them are taken."""
_NEAR = 0.1
"""Distance of two operating points, in logarithms of speed and pressure, at which one counts half
for the other.
"""
_SAME = 0.06
"""Such a distance up to which two points are the same."""
_ROUNDS = 4


Rows = Int64[np.ndarray, " _window"]
Change = Callable[[Float32[np.ndarray, "channel time"]], Float32[np.ndarray, "channel time"]]


def recording_rows(windows: WindowSet) -> list[Rows]:
    """Rows of each recording's windows in order of time, in the order of the ids."""
    order = np.lexsort((windows.start, windows.recording_id))
    names = windows.recording_id[order]
    return [
        part for part in np.split(order, np.flatnonzero(names[1:] != names[:-1]) + 1) if part.size
    ]


def joined(windows: WindowSet, rows: Rows) -> Iterator[Float32[np.ndarray, "channel time"]]:
    """Stretches without a gap that a recording's windows, which may overlap, make up."""
    parts, end = list[np.ndarray](), 0
    for row in rows.tolist():
        start = int(windows.start[row])
        if parts and not 0 <= end - start <= windows.length:
            yield np.concatenate(parts, axis=1)
            parts = []
        parts.append(windows.signal[row][:, end - start if parts else 0 :])
        end = start + windows.length
    yield np.concatenate(parts, axis=1)


def shortest_stretch(windows: WindowSet) -> int:
    """Samples of the longest stretch of the recording whose longest stretch is the shortest."""
    return min(
        max(part.shape[1] for part in joined(windows, rows)) for rows in recording_rows(windows)
    )


def measure_recordings(
    layout: RecordingBandLayout,
    windows: WindowSet,
    rows: list[Rows],
    change: Change = lambda stretch: stretch,
) -> Float[np.ndarray, "recording channel level"]:
    """Levels of recordings by their windows' rows: of their stretches, each changed before, the
    mean by length.
    """
    band_powers = np.empty((len(rows), windows.n_channels, layout.n_band_powers), dtype=np.float32)
    for number, members in enumerate(rows):
        shaft = float(windows.speed[members[0]]) / (2 * np.pi)
        parts = list(joined(windows, members))
        weights = [part.shape[1] for part in parts]
        band_powers[number] = np.average(
            [layout.measure(change(part), shaft) for part in parts], axis=0, weights=weights
        )
    return band_powers


@dataclass(frozen=True, eq=False)
class RecordingTable:
    """Levels of whole recordings, with what is known of each; it holds no samples."""

    band_powers: Float32[np.ndarray, "reference channel level"]
    specimen: tuple[str, ...]
    condition: Float64[np.ndarray, "reference quantity"]
    """Speed [rad/s] and discharge pressure [Pa] of each, NaN where not stated."""
    recording_id: tuple[str, ...]

    def __post_init__(self) -> None:
        count = len(self.band_powers)
        if not count == len(self.specimen) == len(self.condition) == len(self.recording_id):
            raise InputError(
                "levels of recordings need a machine, an operating point and an id each."
            )

    @classmethod
    def measured(cls, layout: RecordingBandLayout, windows: WindowSet) -> "RecordingTable":
        """The table of the recordings that windows were cut from, in the order of their ids."""
        rows = recording_rows(windows)
        first = [int(members[0]) for members in rows]
        return cls(
            measure_recordings(layout, windows, rows),
            tuple(windows.specimen[first].tolist()),
            np.stack([windows.condition(index) for index in first]),
            tuple(windows.recording_id[first].tolist()),
        )

    def machines(self) -> tuple[str, ...]:
        """Machines with `MIN_REFERENCES` healthy recordings or more, in order."""
        names, count = np.unique(self.specimen, return_counts=True)
        return tuple(
            name
            for name, n in zip(names.tolist(), count.tolist(), strict=True)
            if name and n >= MIN_REFERENCES
        )

    def joined(self, other: "RecordingTable") -> "RecordingTable":
        """These and further recordings; of one id the new one."""
        old = self.only(~np.isin(self.recording_id, other.recording_id))
        return RecordingTable(
            np.concatenate([old.band_powers, other.band_powers]),
            old.specimen + other.specimen,
            np.concatenate([old.condition, other.condition]),
            old.recording_id + other.recording_id,
        )

    def only(self, used: Bool[np.ndarray, " reference"]) -> "RecordingTable":
        """Those that a mask keeps."""
        specimen, recording_id = (
            tuple(compress(part, used.tolist())) for part in (self.specimen, self.recording_id)
        )
        return RecordingTable(self.band_powers[used], specimen, self.condition[used], recording_id)

    def changes(
        self, layout: RecordingBandLayout, of: "RecordingTable"
    ) -> Float32[np.ndarray, "recording channel level"]:
        """Changes of recordings from the others of their machine in this table of healthy ones; NaN
        where it has none.

        What an operating point adds is the same for all machines (`_of_points`) and is taken off,
        as other machines have it: so each healthy recording of a machine counts, those near the
        recording's point most. A channel that moved as a whole is taken for a gain
        (`RecordingBandLayout.without_gain`).
        """
        own, ids = (
            np.array(self.specimen, dtype=np.str_),
            np.array(self.recording_id, dtype=np.str_),
        )
        changes = np.full(of.band_powers.shape, np.nan, dtype=np.float32)
        for row, (name, at, this) in enumerate(
            zip(of.specimen, of.condition, of.recording_id, strict=True)
        ):
            others = np.flatnonzero((own == name) & (ids != this))
            if name and others.size:
                weight = 1 / (1 + _distance(self.condition[others], at) / _NEAR)
                added = np.stack([self._added_at(name, at) for at in self.condition[others]])
                usual = np.average(self.band_powers[others] - added, axis=0, weights=weight)
                changes[row] = layout.without_gain(
                    of.band_powers[row] - self._added_at(name, at) - usual
                )
        return changes

    def _added_at(
        self, name: str, at: Float[np.ndarray, " quantity"]
    ) -> Float64[np.ndarray, "channel level"]:
        """What an operating point adds by other machines than the one named, so that a recording
        never has a part in what it is compared with: of a point that they lack, the mean of those
        around, the nearest most.
        """
        if name not in self._points:
            self._points[name] = _of_points(
                self.only(np.array(self.specimen, dtype=np.str_) != name)
            )
        points, added = self._points[name]
        if not len(points):
            return np.zeros(self.band_powers.shape[1:])
        distance = _distance(points, at)
        near = distance < _SAME
        return np.asarray(np.average(added, axis=0, weights=near if near.any() else distance**-2.0))

    @cached_property
    def _points(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Operating points of all machines but one, and what they add, by that one's name."""
        return {}


def _of_points(
    table: RecordingTable,
) -> tuple[Float64[np.ndarray, "point quantity"], Float64[np.ndarray, "point channel level"]]:
    """(operating points, what each adds to the levels of any machine): least squares of machine
    plus point.
    """
    if not table.specimen:
        return np.zeros((0, 2)), np.zeros((0, *table.band_powers.shape[1:]))
    points, point = operating_points(table.condition)
    machine = np.unique(table.specimen, return_inverse=True)[1]
    added = np.zeros((len(points), *table.band_powers.shape[1:]))
    for _ in range(_ROUNDS):
        own = group_means(table.band_powers - added[point], machine)
        added = group_means(table.band_powers - own[machine], point)
    return points, added


def _distance(
    points: Float[np.ndarray, "point quantity"], at: Float[np.ndarray, " quantity"]
) -> np.ndarray:
    """Sum of the magnitudes of the logarithms of ratios; what either does not state counts
    nothing.
    """
    return np.asarray(np.nansum(np.abs(np.log(points / at)), axis=1))
