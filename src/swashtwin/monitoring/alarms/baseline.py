"""The healthy baseline of an operating point: median and scatter of each band power.

It is learned from the first recordings of the machine at the operating point.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
import scipy.fft
from jaxtyping import Float64

from swashtwin.diagnosis import order_band_powers
from swashtwin.foundation import DataError, from_table
from swashtwin.learning import BandPowerLayout, Deviation, band_power_layout
from swashtwin.recordings import Recording
from swashtwin.signals import MAD_TO_STANDARD_DEVIATION, OrderBands

IGNORED_CHANGE_DB = 3.0
"""Change of a band power that does not count, as protection from drift by load and temperature."""
N_CHANGES = 5
"""Largest changes of which the mean is taken: a single faint band changes far by chance."""
LARGE_CHANGE_DB = 6.0
"""Mean change of the `N_CHANGES` bands that makes a recording large: twice the amplitude."""
LARGE_CHANGE_SPREADS = 5.0
"""Mean change of the `N_CHANGES` bands, over their scatter, that makes a recording large."""
MAX_LEARNED_CHANGE_DB = 12.0
"""A recording does not enter the baseline if the `N_CHANGES` bands that differ most from the median
of the other recordings differ by this much on average.
"""
MIN_SPREAD_DB = 1.0
"""Standard deviation that is added to that of each band power (as a variance): twenty recordings of
one day show less scatter than the machine has.
"""
MIN_COMPARED_RECORDINGS = 5
"""Recordings from which on they are compared with each other while the baseline is learned: of
fewer, the median does not show which one deviates.
"""
MIN_CHANNEL_SPREAD_DB = 3.0
"""Minimum standard deviation of a band power when channels are compared with each other."""
N_CACHED_LAYOUTS = 256
"""Layouts whose band names are remembered, one for each operating point in use."""


@dataclass(frozen=True, eq=False)
class OperatingPointBaseline:
    """Band powers of the healthy recordings of one operating point, complete or being learned."""

    layout: BandPowerLayout
    """Which band powers."""
    shortest: int
    """Samples of the shortest recording that was learned from."""
    rows: Float64[np.ndarray, "recording band"] = field(repr=False)
    """Band powers [dB, to a thousandth] of the recordings that were learned from."""
    is_complete: bool = False
    """Whether enough recordings were learned from."""
    dropped: int = 0
    """Recordings that were not learned from because they deviated from the others."""
    orders: Float64[np.ndarray, "order_recording order_band"] = field(
        default_factory=lambda: np.empty((0, 0)), repr=False
    )
    """Band powers of the same recordings that a pump prior compares (`measure_orders`); empty if
    they were not measured.
    """
    pistons: int | None = None
    """Piston count for which `orders` were measured; None if they were not measured."""

    @classmethod
    def empty(cls, layout: BandPowerLayout) -> "OperatingPointBaseline":
        """Return a baseline that has learned nothing."""
        return cls(layout, 0, np.empty((0, len(layout.band_powers))))

    @cached_property
    def median(self) -> Float64[np.ndarray, " band"]:
        """Median of each band power [dB]."""
        return np.asarray(np.median(self.rows, axis=0))

    @cached_property
    def spread(self) -> Float64[np.ndarray, " band"]:
        """Standard deviation of each band power [dB], from the median absolute deviation."""
        return _spread(self.rows, self.median)

    @cached_property
    def max_channel_distances(self) -> Float64[np.ndarray, " channel"]:
        """Greatest distance of each channel from its own baseline, among the recordings that were
        learned from.
        """
        distances = [np.diag(self.channel_distances(row)) for row in self.rows]
        return np.max(distances, axis=0)

    def measure(self, recording: Recording) -> Float64[np.ndarray, " band"]:
        """Return the band powers of a recording [dB].

        Raises
        ------
        DataError
            Sample rate, channels or unit differ from those of the baseline, or the recording is
            unfit or much shorter than the shortest one.
        """
        recording_layout = BandPowerLayout(
            float(recording.sample_rate),
            recording.channels,
            recording.unit,
            self.layout.length,
            self.layout.n_orders,
        )
        difference = self.layout.difference(recording_layout)
        if difference:
            raise DataError(
                f"{recording.recording_id} does not fit the baseline of its operating point "
                f"({difference}). After a change of sensors, restart the baseline."
            )

        band_powers = self.layout.measure(recording, self.shortest)
        if not np.isfinite(band_powers).all():
            raise DataError(
                f"{recording.recording_id} has a sample that is too large for a power; "
                "repair the file."
            )
        return band_powers

    def learn(
        self,
        band_powers: Float64[np.ndarray, " band"],
        recording: Recording,
        n_recordings: int,
        pistons: int | None = None,
    ) -> tuple["OperatingPointBaseline", tuple[str, ...]]:
        """Return the baseline with one more recording, and what it did not learn from, and why.

        Once there are five, a recording is dropped if it deviates from the median of the others by
        `MAX_LEARNED_CHANGE_DB`.

        Parameters
        ----------
        band_powers : of the recording [dB].
        n_recordings : recordings of a complete baseline.
        pistons : piston count of the machine, if it is known; `orders` are then learned too.
        """
        # A thousandth of a decibel suffices, and keeps the stored text short.
        rows = np.vstack([self.rows, band_powers.round(3)])
        orders = self._append_orders(recording, pistons)
        is_new = np.zeros(len(rows), dtype=bool)
        is_new[-1] = True

        notes = []
        while len(rows) >= MIN_COMPARED_RECORDINGS:
            index, change = _most_deviating_row(rows)
            if _mean_of_largest(np.abs(change)) < MAX_LEARNED_CHANGE_DB:
                break
            notes.append(self._describe_drop(change, is_new=bool(is_new[index])))
            rows = np.delete(rows, index, axis=0)
            orders = np.delete(orders, index, axis=0)
            is_new = np.delete(is_new, index)

        shortest = recording.n_samples
        if len(self.rows):
            shortest = min(self.shortest, shortest)
        baseline = OperatingPointBaseline(
            self.layout,
            shortest,
            rows,
            is_complete=len(rows) >= n_recordings,
            dropped=self.dropped + len(notes),
            orders=orders,
            pistons=pistons,
        )
        return baseline, tuple(notes)

    def _append_orders(
        self, recording: Recording, pistons: int | None
    ) -> Float64[np.ndarray, "recording order_band"]:
        new_row = np.empty(0)
        if pistons is not None:
            new_row = measure_orders(recording, pistons)

        previous_rows = self.orders
        # Rows that were measured for another piston count cannot be compared with the new one.
        if pistons != self.pistons or previous_rows.shape != (len(self.rows), new_row.size):
            previous_rows = np.full((len(self.rows), new_row.size), np.nan)
        return np.vstack([previous_rows, new_row])

    def _describe_drop(self, change: Float64[np.ndarray, " band"], *, is_new: bool) -> str:
        index = int(np.argmax(np.abs(change)))
        band = self.layout.band_powers[index]
        which = "an earlier"
        if is_new:
            which = "this"
        return (
            f"not learned from {which} recording: {change[index]:+.1f} dB at {band.describe()}, "
            f"channel {band.channel}, against the others."
        )

    def held_out_scores(self) -> list[tuple[float, bool]]:
        """Return (score, whether it is large) of each recording against all others.

        Dropped recordings count as the largest of all: without them, the baseline of a machine that
        is loud now and then would not contain its loud recordings.
        """
        scores = [(math.inf, True)] * self.dropped
        for index, row in enumerate(self.rows):
            other_rows = np.delete(self.rows, index, axis=0)
            median = np.median(other_rows, axis=0)
            change = row - median
            spread = _spread(other_rows, median)
            scores.append((_score(change, spread), _is_large(change, spread)))
        return scores

    def score(self, band_powers: Float64[np.ndarray, " band"]) -> float:
        """Return the nonconformity score of a recording, at least 0.

        It is the mean of the `N_CHANGES` largest (|change| - `IGNORED_CHANGE_DB`) / scatter.
        """
        return _score(band_powers - self.median, self.spread)

    def is_large(self, band_powers: Float64[np.ndarray, " band"]) -> bool:
        """Return whether a recording deviates far from the baseline.

        The bands that changed most must have changed by `LARGE_CHANGE_DB` and
        `LARGE_CHANGE_SPREADS` in the mean, and those that rose most must have risen by
        `IGNORED_CHANGE_DB` in the mean. A fault moves power from some bands to others; if bands
        only fall, as when a machine runs in, nothing is damaged.
        """
        return _is_large(band_powers - self.median, self.spread)

    def has_fallen(self, band_powers: Float64[np.ndarray, " band"]) -> bool:
        """Return whether a recording deviates far from the baseline although no band rose.

        The cause is a sensor, or a pump at rest.
        """
        change = band_powers - self.median
        return _deviates(change, self.spread) and not _is_large(change, self.spread)

    def deviation(self, band_powers: Float64[np.ndarray, " band"], p_value: float) -> Deviation:
        """Return how far a recording is from the baseline, for `diagnosis.band_power_changes`."""
        change = band_powers - self.median
        return Deviation(self.score(band_powers), p_value, change, change / self.spread, "", ())

    def channel_distances(
        self, band_powers: Float64[np.ndarray, " band"]
    ) -> Float64[np.ndarray, "channel channel"]:
        """Return the distance of each channel (row) from the baseline of each channel (column).

        It is the root mean square of the differences over the scatter.
        """
        n_channels = len(self.layout.channels)

        # A minimum, since channels differ by much more than one channel scatters.
        spread = np.maximum(self.spread, MIN_CHANNEL_SPREAD_DB).reshape(n_channels, -1)
        measured = band_powers.reshape(n_channels, 1, -1)
        expected = self.median.reshape(n_channels, -1)
        return np.asarray(np.sqrt(np.mean(((measured - expected) / spread) ** 2, axis=-1)))


def choose_layout(recording: Recording) -> BandPowerLayout:
    """Return the band powers of an operating point, for its first recording.

    The segments of the spectra get a length for which the Fourier transform is fast.
    """
    layout, _ = band_power_layout([recording])

    # A longer segment than the recording could not be measured.
    length = int(scipy.fft.next_fast_len(layout.length, real=True))
    if length > recording.n_samples:
        return layout
    return replace(layout, length=length)


def baseline_band_powers(table: Mapping[str, Any]) -> dict[tuple[str, str], tuple[float, float]]:
    """Return (median, scatter) [dB] of each band power by its channel and name.

    Parameters
    ----------
    table : baseline as the history has it; the result is empty while it is being learned.
    """
    baseline = load_baseline(table)
    if not baseline.is_complete:
        return {}
    statistics = zip(baseline.median.tolist(), baseline.spread.tolist(), strict=True)
    return dict(zip(band_names(baseline.layout), statistics, strict=True))


def load_baseline(table: Mapping[str, Any]) -> OperatingPointBaseline:
    """Return the baseline that the history has as a table."""

    def to_rows(_: type, values: Any) -> Float64[np.ndarray, "recording band"]:
        if not values:
            return np.empty((0, 0))
        return np.array(values, np.float64)

    return from_table(table, OperatingPointBaseline, to_array=to_rows, complete=True)


@lru_cache(maxsize=N_CACHED_LAYOUTS)
def band_names(layout: BandPowerLayout) -> Sequence[tuple[str, str]]:
    """Return channel and name of each band power."""
    return [(band.channel, band.describe()) for band in layout.band_powers]


def measure_orders(recording: Recording, pistons: int) -> Float64[np.ndarray, " order_band"]:
    """Return the band powers that a pump prior compares [log10 of the squared unit].

    They are NaN if they cannot be measured, for example because the recording is too short.
    """
    bands = OrderBands(pistons)
    try:
        return order_band_powers(recording, bands).round(4).ravel()
    except DataError:
        return np.full(len(recording.channels) * len(bands.names), np.nan)


def _most_deviating_row(
    rows: Float64[np.ndarray, "recording band"],
) -> tuple[int, Float64[np.ndarray, " band"]]:
    """Return the index of the row furthest from the median of the others, and its change."""
    changes = np.array(
        [row - np.median(np.delete(rows, index, axis=0), axis=0) for index, row in enumerate(rows)]
    )

    # Of several bands: a single faint band falls as far by chance.
    distances = np.sort(np.abs(changes), axis=1)[:, -N_CHANGES:].mean(axis=1)
    index = int(np.argmax(distances))
    return index, changes[index]


def _spread(
    rows: Float64[np.ndarray, "recording band"], median: Float64[np.ndarray, " band"]
) -> Float64[np.ndarray, " band"]:
    absolute_deviation = np.median(np.abs(rows - median), axis=0)
    standard_deviation = MAD_TO_STANDARD_DEVIATION * absolute_deviation
    return np.asarray(np.sqrt(standard_deviation**2 + MIN_SPREAD_DB**2))


def _mean_of_largest(values: Float64[np.ndarray, " band"]) -> float:
    return float(np.sort(values)[-N_CHANGES:].mean())


def _score(change: Float64[np.ndarray, " band"], spread: Float64[np.ndarray, " band"]) -> float:
    return max(_mean_of_largest((np.abs(change) - IGNORED_CHANGE_DB) / spread), 0.0)


def _deviates(change: Float64[np.ndarray, " band"], spread: Float64[np.ndarray, " band"]) -> bool:
    """Return whether the bands that changed most did so by the limits of a large recording."""
    magnitude = np.abs(change)
    n_spreads = magnitude / spread
    most_changed = np.argsort(n_spreads)[-N_CHANGES:]
    return bool(
        magnitude[most_changed].mean() >= LARGE_CHANGE_DB
        and n_spreads[most_changed].mean() >= LARGE_CHANGE_SPREADS
    )


def _is_large(change: Float64[np.ndarray, " band"], spread: Float64[np.ndarray, " band"]) -> bool:
    # Those that rose most need not be those that changed most.
    most_risen = np.argsort(change / spread)[-N_CHANGES:]
    has_risen = bool(change[most_risen].mean() >= IGNORED_CHANGE_DB)
    return _deviates(change, spread) and has_risen
