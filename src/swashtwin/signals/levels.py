"""Statistics of time signals, and levels in a band of frequencies: of acceleration and, by
integration, of velocity.

Levels are root mean squares from the one-sided power density (Welch, Hann taper, half-overlapping
segments of 2 s, mean removed), the taper's noise bandwidth corrected: a sine of amplitude 1 reads
0.7071 in any band that holds it. A spectral line that a band's edge cuts is shared in proportion.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Float64

from swashtwin.foundation import DataError, InputError
from swashtwin.recordings import Recording, require_usable, specified_shaft_frequency
from swashtwin.signals.spectra import power_density

TIME_STATISTICS = (
    "mean",
    "deviation",
    "rms",
    "peak",
    "peak_to_peak",
    "mean_absolute",
    "skewness",
    "kurtosis",
    "crest_factor",
    "shape_factor",
    "impulse_factor",
    "clearance_factor",
)
"""Of x: mean, √(mean (x-m)²), √(mean x²), max|x|, max - min, mean|x|, third and fourth standardized
moment, peak / rms, rms / mean|x|, peak / mean|x|, peak / (mean √|x|)². The first six in the
signal's unit, the others without one.
"""


def time_statistics(
    signal: Float[np.ndarray, "window time"],
) -> Float64[np.ndarray, "window statistic"]:
    """The `TIME_STATISTICS` of each window; a ratio with a zero below it is 0."""
    mean = signal.mean(axis=1)
    deviation = signal.std(axis=1)
    magnitude = np.abs(signal)
    rms, peak, mean_absolute = (
        np.sqrt((signal**2).mean(axis=1)),
        magnitude.max(axis=1),
        magnitude.mean(axis=1),
    )
    standard = (signal - mean[:, None]) / np.where(deviation > 0, deviation, 1.0)[:, None]
    square = standard * standard  # a power of floats takes ten times as long as its products
    columns = (
        mean,
        deviation,
        rms,
        peak,
        np.ptp(signal, axis=1),
        mean_absolute,
        (square * standard).mean(axis=1),
        (square * square).mean(axis=1),
        _ratio(peak, rms),
        _ratio(rms, mean_absolute),
        _ratio(peak, mean_absolute),
        _ratio(peak, np.sqrt(magnitude).mean(axis=1) ** 2),
    )
    return np.stack(columns, axis=1)


def _ratio(
    above: Float64[np.ndarray, " window"], below: Float64[np.ndarray, " window"]
) -> Float64[np.ndarray, " window"]:
    return np.where(below > 0, above / np.where(below > 0, below, 1.0), 0.0)


def shape_statistics(recording: Recording) -> dict[str, Float64[np.ndarray, " channel"]]:
    """Level, peaks and shape of each channel without its mean, as of `TIME_STATISTICS`, by name;
    read in blocks.
    """
    mean = sum(block.signal.sum(axis=1) for block in recording.blocks()) / recording.n_samples
    sums, largest = np.zeros((3, recording.n_channels)), np.zeros(recording.n_channels)
    for block in recording.blocks():
        centered = block.signal - mean[:, None]
        square = centered * centered
        third, fourth = (
            np.einsum("ct,ct->c", square, centered),
            np.einsum("ct,ct->c", square, square),
        )
        sums += [square.sum(axis=1), third, fourth]
        largest = np.maximum(largest, square.max(axis=1))
    second, third, fourth = sums / recording.n_samples
    rms, peak = np.sqrt(second), np.sqrt(largest)
    return {
        "rms": rms, "peak": peak, "crest_factor": _ratio(peak, rms), "kurtosis": _ratio(fourth, second**2),
        "skewness": _ratio(third, rms**3),
    }  # fmt: skip


SEGMENT = 2.0
"""Length of the segments [s], so that lines lie 0.5 Hz apart; the whole signal where it is
shorter.
"""


Spectrum = tuple[Float[np.ndarray, " frequency"], Float[np.ndarray, "channel frequency"]]


def segment_length(n_samples: int, sample_rate: float) -> int:
    """Samples of the segments whose `power_density` the levels are read from."""
    return min(n_samples, round(SEGMENT * sample_rate))


def band_rms(
    signal: Float[np.ndarray, "channel time"],
    sample_rate: float,
    low: float,
    high: float,
    *,
    of_velocity: bool = False,
    spectrum: Spectrum | None = None,
) -> Float[np.ndarray, " channel"]:
    """Root mean square between `low` and `high` [Hz], in the signal's unit; its square is the
    band's energy.

    No zone of ISO 20816 applies to piston pumps; compare with the machine's own baseline
    (`signals.trend_of`).

    Parameters
    ----------
    of_velocity : of the velocity [m/s] where the signal is an acceleration [m/s^2]: the power
        density is divided by the angular frequency squared, which needs no start value and lets no
        offset drift. Vibration severity of machines is commonly stated from 10 to 1000 Hz.
    spectrum : `power_density` of the signal in segments of `segment_length`, where it is at hand.

    Examples
    --------
    >>> time = np.arange(4000) / 1000
    >>> print(band_rms(np.sin(2 * np.pi * 50 * time)[None], 1000.0, 10, 100).round(4))
    [0.7071]
    """
    n_samples = signal.shape[-1]
    if not 0 <= low < high <= sample_rate / 2:
        raise InputError(
            f"a band of {low:g} to {high:g} Hz is none at {sample_rate:g} Hz; it lies in 0 to {sample_rate / 2:g} Hz."
        )
    length = segment_length(n_samples, sample_rate)
    width = sample_rate / length
    if high - low < width or (of_velocity and low < 2 * width):
        raise InputError(
            f"{n_samples / sample_rate:.3g} s resolve {width:.3g} Hz, too little for {low:g} to {high:g} Hz; record "
            "longer."
        )
    frequency, density = (
        power_density(signal, sample_rate, length) if spectrum is None else spectrum
    )
    share = np.clip(
        np.minimum(frequency + width / 2, high) - np.maximum(frequency - width / 2, low), 0, None
    )
    if of_velocity:
        share[1:] /= (2 * np.pi * frequency[1:]) ** 2  # the first line is below the band
    return np.sqrt(density @ share)


TURNS = 8
"""Revolutions in each segment of a spectrum by orders, so that eight spectral lines lie from order
to order.
"""
_STRETCH = 1 << 18
"""Samples of a channel that are transformed together; a longer recording is read in such
stretches.
"""


def shaft_frequency(recording: Recording) -> float:
    """Shaft frequency [Hz] that a recording states; a `DataError` where it states none."""
    shaft = specified_shaft_frequency(recording)
    if not shaft:
        raise DataError(
            f"{recording.recording_id} states no speed, and shaft orders are compared; state it in the index, or with "
            "--speed."
        )
    return shaft


def recording_density(
    recording: Recording,
    length: int,
    *,
    least: float = 0,
    of: Callable[[np.ndarray], np.ndarray] = lambda signal: signal,
) -> Float64[np.ndarray, "*batch frequency"]:
    """Power density [unit^2/Hz] of a recording in segments of `length` samples; it is never whole
    in memory.

    Parameters
    ----------
    least : samples that it must have, beside those of a segment.
    of : what of the samples (channel, time) of each stretch, such as their envelope,
        `power_density` is taken.

    Raises
    ------
    DataError
        It is unfit or too short.
    """
    require_usable(recording)
    if recording.n_samples < (needed := max(length, least)):
        raise DataError(
            f"{recording.recording_id} lasts {recording.duration:.3g} s ({recording.n_samples} samples); to compare "
            f"its levels takes {needed / recording.sample_rate:.3g} s ({needed:.0f}): record longer."
        )
    counts, densities = [], []
    for start in range(0, recording.n_samples - length + 1, max(length, _STRETCH)):
        signal = recording.slice(
            start, min(start + max(length, _STRETCH), recording.n_samples)
        ).signal
        counts.append(signal.shape[1])
        densities.append(power_density(of(signal), recording.sample_rate, length)[1])
    return np.asarray(np.einsum("p,p...->...", np.array(counts) / sum(counts), np.stack(densities)))


_WANDERING = 0.004
"""Half-width of the speed's variation [relative] over which a piston pass is summed."""
_FLOOR_SHARE = 0.25
"""Share of a band's cells that lie below its floor: lines fill fewer than the rest."""


@dataclass(frozen=True)
class OrderBands:
    """Bands of one number of pistons, alike in number for all.

    Shaft orders 1 to 3 one by one; each of the first `passes` piston passes, as wide as a wandering
    speed smears it; all between order 3 and the first pass, and between each pass and the next; and
    `wide` logarithmic bands from there to `highest` passes. Bands that hold no pass have a floor
    besides.
    """

    piston_count: int
    """Pistons of the pump."""
    passes: int = 20
    """Multiples of the piston-pass frequency that have a band."""
    wide: int = 6
    """Bands above the last of them."""
    highest: float = 48.0
    """Upper edge of the last band, in piston passes."""

    def __post_init__(self) -> None:
        if (
            self.piston_count < 5
            or self.passes < 1
            or self.wide < 1
            or self.highest <= self.passes + 1
        ):
            raise InputError(
                f"bands of {self.piston_count} pistons and {self.passes} passes need five pistons, a pass and a wide "
                f"band at least, and end above pass {self.passes + 1}, not at {self.highest:g}."
            )

    @cached_property
    def edges(self) -> Float64[np.ndarray, "band 2"]:
        """Lower and upper edge of each band, in shaft orders; the last `n_floors` ones have a
        floor.
        """
        count = self.piston_count
        single = [(order - 0.5, order + 0.5) for order in (1, 2, 3)]
        passes, between = [], [(3.5, count - 0.5)]
        for here in range(count, (self.passes + 1) * count, count):
            reach = min(0.5 + _WANDERING * here, count / 4)
            passes.append((here - reach, here + reach))
            between.append((here + reach, here + count - reach))
        wide = np.geomspace((self.passes + 1) * count, self.highest * count, self.wide + 1)
        return np.array([*single, *passes, *between, *pairwise(wide.tolist())])

    @property
    def n_floors(self) -> int:
        """Number of floors."""
        return self.passes + 1 + self.wide

    @property
    def names(self) -> tuple[str, ...]:
        """What each level is, such as ``pass 3`` or ``floor between 3``."""
        between = ("below pass 1", *(f"between {number}" for number in range(1, self.passes + 1)))
        broad = (*between, *(f"above {number}" for number in range(1, self.wide + 1)))
        lines = (
            *("order 1", "order 2", "order 3"),
            *(f"pass {number}" for number in range(1, self.passes + 1)),
        )
        return (*lines, *broad, *(f"floor {name}" for name in broad))

    def log_powers(
        self, power: Float[np.ndarray, "*batch cell"], width: float
    ) -> Float64[np.ndarray, "*batch band"]:
        """log10 of the power in each band, then of the floors' power in each cell; NaN where cells
        end before.

        Parameters
        ----------
        power : of cells of the order axis; the middle of cell i is at i times `width`.
        width : of a cell, in shaft orders. A cell that an edge cuts counts by its share.
        """
        order = np.arange(power.shape[-1]) * width
        low, high = self.edges[:, :1], self.edges[:, 1:]
        overlap = np.minimum(order + width / 2, high) - np.maximum(order - width / 2, low)
        sums = power @ (np.clip(overlap, 0, None) / width).T
        floors = []
        for lower, upper in self.edges[-self.n_floors :]:
            cells = power[..., (order > lower) & (order < upper)]
            floors.append(
                np.quantile(cells, _FLOOR_SHARE, axis=-1)
                if cells.shape[-1]
                else sums[..., 0] * np.nan
            )
        levels = np.log10(
            np.maximum(np.concatenate([sums, np.stack(floors, axis=-1)], axis=-1), 1e-30)
        )
        ends = np.concatenate([high[:, 0], high[-self.n_floors :, 0]])
        return np.where(ends <= order[-1] + width, levels, np.nan)
