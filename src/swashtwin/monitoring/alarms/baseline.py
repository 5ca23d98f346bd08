"""Operating points of a machine, and the healthy baseline of each: median and scatter of every
level, learned from its first recordings.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.fft
from jaxtyping import Float64

from swashtwin.diagnosis import order_band_powers
from swashtwin.foundation import DataError, from_table
from swashtwin.learning import BandPowerLayout, Deviation, band_power_layout
from swashtwin.pump import PRESSURE_TOLERANCE, SPEED_TOLERANCE, values_match
from swashtwin.recordings import Recording, specified_pressure, specified_shaft_frequency
from swashtwin.signals import OrderBands

if TYPE_CHECKING:
    from swashtwin.monitoring.history.schema import OperatingPointRow


@dataclass(frozen=True)
class OperatingPoint:
    """Speed and discharge pressure that recordings are compared at."""

    speed: float | None
    """Angular speed of the shaft [rad/s], or None where it is not stated."""
    pressure: float | None
    """Discharge pressure [Pa], or None where it is not stated."""

    @classmethod
    def of(cls, recording: Recording) -> "OperatingPoint":
        """What a recording states."""
        shaft, pressure = specified_shaft_frequency(recording), specified_pressure(recording)
        return cls(
            2 * math.pi * shaft if shaft else None, None if math.isnan(pressure) else pressure
        )

    @property
    def name(self) -> str:
        """Name for people and for the history.

        Examples
        --------
        >>> from swashtwin.foundation import MPa, rpm
        >>> OperatingPoint(rpm(860), MPa(10)).name
        '860 rpm, 10 MPa'
        >>> OperatingPoint(None, None).name
        'any'
        """
        parts = []
        if self.speed is not None:
            parts.append(f"{self.speed * 30 / math.pi:.4g} rpm")
        if self.pressure is not None:
            parts.append(f"{self.pressure / 1e6:.3g} MPa")
        return ", ".join(parts) or "any"

    def distance(self, other: "OperatingPoint | OperatingPointRow") -> float:
        """Relative difference to another point in units of the tolerances, infinite where they are
        not the same.

        The tolerances are those of `OperatingCondition.matches`.
        """
        pairs = (
            (self.speed, other.speed, SPEED_TOLERANCE),
            (self.pressure, other.pressure, PRESSURE_TOLERANCE),
        )
        distance = 0.0
        for first, second, tolerance in pairs:
            if first is None and second is None:
                continue
            if first is None or second is None or not values_match(first, second, tolerance):
                return math.inf
            distance = max(distance, abs(first - second) / (tolerance * max(first, second)))
        return distance


def match_operating_point(
    recording: Recording, points: Iterable["OperatingPoint | OperatingPointRow"]
) -> OperatingPoint:
    """The nearest of a machine's points that a recording belongs to, or a new one at what the
    recording states.
    """
    stated = OperatingPoint.of(recording)
    nearest = min(points, key=stated.distance, default=None)
    if nearest is None or math.isinf(stated.distance(nearest)):
        return stated
    return OperatingPoint(nearest.speed, nearest.pressure)


def choose_layout(recording: Recording) -> BandPowerLayout:
    """Levels of the recordings of a point, by its first one; segments are of a length that
    transforms fast.
    """
    layout, _ = band_power_layout([recording])
    length = int(scipy.fft.next_fast_len(layout.length, real=True))
    return replace(layout, length=length) if length <= recording.n_samples else layout


TOLERANCE = 3.0
"""Change of a level [dB] that does not count."""
COUNTED = 5
"""Levels that changed most, whose mean is the score."""
CHANGE = 6.0
"""Mean change [dB] of the `COUNTED` levels that makes a recording large: twice the amplitude."""
SPREADS = 5.0
"""Mean of the same over their scatter that makes a recording large."""
UNUSUAL = 12.0
"""Mean change [dB] of the `COUNTED` levels furthest from the median of the others that keeps a
recording from being learned from. Of a single level it would not do: one that is faint falls as far
by chance.
"""
_LEAST_SPREAD = 1.0
"""Standard deviation [dB] that every level has at least; added as a variance."""
_LEAST_COMPARED = 5
"""Recordings from which on they are compared with each other while the baseline is learned."""
_LEAST_CHANNEL_SPREAD = 3.0
"""Standard deviation [dB] of a level at least where channels are compared with each other."""


@dataclass(frozen=True, eq=False)
class OperatingPointBaseline:
    """Levels of the healthy recordings of one operating point, while they are learned and after."""

    layout: BandPowerLayout
    """Which levels."""
    shortest: int
    """Samples of the shortest recording that it learned from."""
    rows: Float64[np.ndarray, "recording level"] = field(repr=False)
    """Levels [dB, to a thousandth] of the recordings that it learned from."""
    is_complete: bool = False
    """Whether it has learned."""
    dropped: int = 0
    """Recordings that it did not learn from, since they stood far from the others."""
    orders: Float64[np.ndarray, "recording order_level"] = field(
        default_factory=lambda: np.empty((0, 0)), repr=False
    )
    """Levels of the same recordings that a pump prior compares (`measure_orders`)."""
    pistons: int | None = None
    """Pistons of the machine as `orders` were measured; None where they were not."""

    @classmethod
    def empty(cls, layout: BandPowerLayout) -> "OperatingPointBaseline":
        """A baseline that has learned nothing."""
        return cls(layout, 0, np.empty((0, len(layout.band_powers))))

    @cached_property
    def median(self) -> Float64[np.ndarray, " level"]:
        """Median of each level [dB]."""
        return np.asarray(np.median(self.rows, axis=0))

    @cached_property
    def spread(self) -> Float64[np.ndarray, " level"]:
        """Standard deviation of each level [dB], from the median of magnitudes, with 1 dB added as
        a variance.
        """
        return _spread(self.rows, self.median)

    @cached_property
    def furthest(self) -> Float64[np.ndarray, " channel"]:
        """Greatest `channel_distances` of each channel to its own levels, of the recordings that it
        learned from.
        """
        return np.max([np.diag(self.channel_distances(row)) for row in self.rows], axis=0)

    def measure(self, recording: Recording) -> Float64[np.ndarray, " level"]:
        """Levels of a recording [dB].

        Raises
        ------
        DataError
            Its sample rate, channels or unit are others than the baseline's, or it is unfit or much
            shorter.
        """
        length = self.layout.length
        actual = BandPowerLayout(
            float(recording.sample_rate),
            recording.channels,
            recording.unit,
            length,
            self.layout.n_orders,
        )
        if difference := self.layout.difference(actual):
            raise DataError(
                f"{recording.recording_id} does not fit the baseline of its operating point ({difference}); restart "
                "the baseline after a change of sensors."
            )
        band_powers = self.layout.measure(recording, self.shortest)
        if not np.isfinite(band_powers).all():
            raise DataError(
                f"{recording.recording_id}: a sample is far too large; repair the file."
            )
        return band_powers

    def learn(
        self,
        band_powers: Float64[np.ndarray, " level"],
        recording: Recording,
        learning: int,
        pistons: int | None = None,
    ) -> tuple["OperatingPointBaseline", tuple[str, ...]]:
        """(the baseline with one more recording, what was not learned from and why).

        Once there are five, a recording is dropped whose furthest levels are `UNUSUAL` from the
        median of the others.

        Parameters
        ----------
        levels : of the recording [dB].
        learning : recordings that a complete baseline has.
        pistons : of the machine, where they are known; `orders` are then learned too.
        """
        rows, notes = np.vstack([self.rows, band_powers.round(3)]), []
        new = np.empty(0) if pistons is None else measure_orders(recording, pistons)
        is_alike = pistons == self.pistons and self.orders.shape == (len(self.rows), new.size)
        orders = np.vstack(
            [self.orders if is_alike else np.full((len(self.rows), new.size), np.nan), new]
        )
        is_new = np.arange(len(rows)) == len(rows) - 1
        while len(rows) >= _LEAST_COMPARED:
            change = np.array(
                [row - np.median(np.delete(rows, n, axis=0), axis=0) for n, row in enumerate(rows)]
            )
            far = np.sort(np.abs(change), axis=1)[:, -COUNTED:].mean(axis=1)
            furthest = int(np.argmax(far))
            level = int(np.argmax(np.abs(change[furthest])))
            if far[furthest] < UNUSUAL:
                break
            which = self.layout.band_powers[level]
            notes.append(
                f"not learned from {'this' if is_new[furthest] else 'an earlier'} recording: "
                f"{change[furthest, level]:+.1f} dB at {which.words()}, channel {which.channel}, against the others."
            )
            rows, orders = np.delete(rows, furthest, axis=0), np.delete(orders, furthest, axis=0)
            is_new = np.delete(is_new, furthest)
        shortest = (
            min(self.shortest, recording.n_samples) if len(self.rows) else recording.n_samples
        )
        dropped, is_complete = self.dropped + len(notes), len(rows) >= learning
        return OperatingPointBaseline(
            self.layout, shortest, rows, is_complete, dropped, orders, pistons
        ), tuple(notes)

    def held_out_scores(self) -> list[tuple[float, bool]]:
        """(score, whether it is large) of each recording that it learned from, against the others.

        Those that it dropped count as the largest of all: without them, a machine that is loud now
        and then would have a baseline that never was.
        """
        scores = [(math.inf, True)] * self.dropped
        for number, row in enumerate(self.rows):
            others = np.delete(self.rows, number, axis=0)
            median = np.median(others, axis=0)
            spread = _spread(others, median)
            scores.append((_score(row - median, spread), _is_large(row - median, spread)))
        return scores

    def score(self, band_powers: Float64[np.ndarray, " level"]) -> float:
        """Mean of the `COUNTED` largest (|change| - `TOLERANCE`) / scatter, 0 at least."""
        return _score(band_powers - self.median, self.spread)

    def is_large(self, band_powers: Float64[np.ndarray, " level"]) -> bool:
        """Whether levels changed far: those that changed most by `CHANGE` and `SPREADS` in the
        mean.

        Those that rose most must have risen by `TOLERANCE` in the mean: a fault moves power from
        some levels to others, but levels that only fall, as when a machine runs in, are no damage.
        """
        return _is_large(band_powers - self.median, self.spread)

    def has_fallen(self, band_powers: Float64[np.ndarray, " level"]) -> bool:
        """Whether levels changed as far as those of a large recording, and none rose: a sensor, or
        a pump at rest.
        """
        change = band_powers - self.median
        return _is_far(change, self.spread) and not _is_large(change, self.spread)

    def deviation(self, band_powers: Float64[np.ndarray, " level"], p_value: float) -> Deviation:
        """How far a recording is from the baseline, for `diagnosis.band_power_changes`."""
        change = band_powers - self.median
        return Deviation(self.score(band_powers), p_value, change, change / self.spread, "", ())

    def channel_distances(
        self, band_powers: Float64[np.ndarray, " level"]
    ) -> Float64[np.ndarray, "channel channel"]:
        """Distance of the levels of each channel (row) from the baseline of each channel (column).

        The root mean square of the differences over the scatter.
        """
        count = len(self.layout.channels)
        spread = np.maximum(self.spread, _LEAST_CHANNEL_SPREAD).reshape(count, -1)
        difference = band_powers.reshape(count, 1, -1) - self.median.reshape(count, -1)
        return np.asarray(np.sqrt(np.mean((difference / spread) ** 2, axis=-1)))


def baseline_band_powers(table: Mapping[str, Any]) -> dict[tuple[str, str], tuple[float, float]]:
    """(median, scatter) [dB] of each level by its channel and name; empty while the baseline is
    learned.

    Parameters
    ----------
    table : a baseline as the history has it.
    """
    baseline = read_baseline(table)
    if not baseline.is_complete:
        return {}
    pairs = zip(baseline.median.tolist(), baseline.spread.tolist(), strict=True)
    return dict(zip(band_names(baseline.layout), pairs, strict=True))


def read_baseline(table: Mapping[str, Any]) -> OperatingPointBaseline:
    """The baseline that the history has as a table."""

    def rows(_: type, values: Any) -> Float64[np.ndarray, "recording level"]:
        return np.array(values, np.float64) if values else np.empty((0, 0))

    return from_table(table, OperatingPointBaseline, to_array=rows)


@lru_cache(maxsize=256)
def band_names(layout: BandPowerLayout) -> Sequence[tuple[str, str]]:
    """Channel and name of each level."""
    return [(level.channel, level.words()) for level in layout.band_powers]


def measure_orders(recording: Recording, pistons: int) -> Float64[np.ndarray, " order_level"]:
    """Levels of all channels that a prior compares [log10 of the squared unit], NaN where they
    cannot be measured.
    """
    bands = OrderBands(pistons)
    try:
        return order_band_powers(recording, bands).round(4).ravel()
    except DataError:
        return np.full(len(recording.channels) * len(bands.names), np.nan)


def _spread(
    rows: Float64[np.ndarray, "recording level"], median: Float64[np.ndarray, " level"]
) -> Float64[np.ndarray, " level"]:
    magnitude = np.median(np.abs(rows - median), axis=0)
    return np.asarray(np.sqrt((1.4826 * magnitude) ** 2 + _LEAST_SPREAD**2))


def _score(change: Float64[np.ndarray, " level"], spread: Float64[np.ndarray, " level"]) -> float:
    excess = (np.abs(change) - TOLERANCE) / spread
    return max(float(np.sort(excess)[-COUNTED:].mean()), 0.0)


def _is_far(change: Float64[np.ndarray, " level"], spread: Float64[np.ndarray, " level"]) -> bool:
    magnitude = np.abs(change)
    furthest = np.argsort(magnitude / spread)[-COUNTED:]
    return bool(
        magnitude[furthest].mean() >= CHANGE and (magnitude / spread)[furthest].mean() >= SPREADS
    )


def _is_large(change: Float64[np.ndarray, " level"], spread: Float64[np.ndarray, " level"]) -> bool:
    risen = np.argsort(change / spread)[-COUNTED:]
    return _is_far(change, spread) and bool(change[risen].mean() >= TOLERANCE)
