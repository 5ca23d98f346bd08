"""Plain facts of each channel, such as its noise floor, and which of them are outside what the training had."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from swashtwin.learning.features import band_levels, window_powers
from swashtwin.learning.windows.window_set import WindowSet

FACTS = ("level", "noise_floor", "line_share", "offset", "likeness")
"""Variance, level of the quietest tenth of the spectrum, and share of the power in the strongest fiftieth; the square
of the mean over the variance, and the share that another channel explains, as -log(1 - r^2); in dB."""
N_BANDS = 16
"""Logarithmic bands by which swapped channels are told, in dB; they follow the `FACTS`."""
N_FACTS = len(FACTS) + N_BANDS
"""Columns of `signal_facts`."""
ERROR_RATE = 0.05
"""Share of the recordings like the training's of which a fact may be called outside."""

_QUIETEST, _STRONGEST = 0.1, 0.02
_LEAST_SPREAD, _LEAST_BAND_SPREAD = 1.0, 3.0
"""Least spread that a difference is judged by [dB]."""
_LEAST_EXCESS = 0.5
"""Difference below which a fact is not told: it would be rounded to 0 dB."""
_LEAST_POWER = 1e-30
_LEAST_OFFSET, _ALONE = 1e-2, (1e-4, 0.1)
"""Offset below which it counts as such, and the range of the share that no other channel explains: up to a correlation
of 0.95 channels are their own."""
_LEAST_RECORDINGS = 5
"""Training recordings from which a range can be told."""
_FAR = 10.0
"""Distance [dB] from fewer than these that is told."""


@dataclass(frozen=True)
class OutsideFact:
    """A fact of one channel outside the range of the training."""

    channel: int
    """Index of the channel."""
    fact: str
    """One of `FACTS`."""
    value: float
    """What the recording has [dB]."""
    low: float
    """Least of the training [dB]."""
    high: float
    """Greatest of the training [dB]."""
    deviation: float
    """How far outside, in standard deviations between the training recordings."""

    @property
    def excess(self) -> float:
        """How far above the range, or below where negative [dB]."""
        return self.value - self.high if self.value > self.high else self.value - self.low


def signal_facts(
    windows: WindowSet, powers: Sequence[Float64[np.ndarray, "window line"]] | None = None
) -> Float64[np.ndarray, "window channel fact"]:
    """`FACTS` and the levels of `N_BANDS` bands, of each channel of each window [dB re the unit squared].

    The noise floor is of the density (per Hz). Both spectra are with a Hann taper and the mean removed.

    Parameters
    ----------
    powers : `window_powers`, where they are at hand.
    """
    samples = windows.signal.astype(np.float64)
    mean = samples.mean(axis=2)
    samples -= mean[:, :, None]
    products = samples @ samples.swapaxes(1, 2) / windows.length
    variance = np.maximum(np.diagonal(products, axis1=1, axis2=2), _LEAST_POWER)
    alike = products**2 / (variance[:, :, None] * variance[:, None]) * (1 - np.eye(windows.n_channels))
    share_alone = np.clip(1 - alike.max(axis=2), *_ALONE)
    facts = []
    for channel, power in enumerate(window_powers(windows) if powers is None else powers):
        n_lines = power.shape[1]
        quietest, first_strong = int(_QUIETEST * n_lines), n_lines - max(1, round(_STRONGEST * n_lines))
        density = np.partition(power, (quietest, first_strong), axis=1) * (windows.length / windows.sample_rate)
        strongest = density[:, first_strong:].sum(axis=1)
        ratios = (
            variance[:, channel],
            density[:, quietest],
            strongest / np.maximum(density.sum(axis=1), _LEAST_POWER),
            np.maximum(mean[:, channel] ** 2 / variance[:, channel], _LEAST_OFFSET),
            1 / share_alone[:, channel],
        )
        decibels = 10 * np.log10(np.maximum(np.stack(ratios, axis=1), _LEAST_POWER))
        facts.append(np.concatenate([decibels, 10 * band_levels(power, N_BANDS)], axis=1))
    return np.stack(facts, axis=1)


def outside_facts(
    training: Float64[np.ndarray, "recording channel fact"],
    machines: Sequence[str],
    facts: Float64[np.ndarray, "channel fact"],
) -> tuple[OutsideFact, ...]:
    """Facts outside the training's range by more than is usual between its recordings, most unusual first.

    A recording's deviation is how far the furthest of its facts is outside the range of others, in standard deviations
    between the training recordings (1 dB at least). A fact is told where its deviation exceeds that of all but
    `ERROR_RATE` of the training recordings, each against the others; against those of other machines, where there
    are several. So at most about this share of recordings that are like the training's get any such remark; with
    fewer than 19 training recordings, n of them, about one in n + 1. The same conformal rule as that of being unknown.
    Fewer than five give no such rate: what is 10 dB outside their range is told.

    Parameters
    ----------
    training : mean facts of each training recording.
    machines : machine of each; "" where not stated.
    facts : mean facts of the recording in question.
    """
    values, recorded = training[:, :, : len(FACTS)], facts[:, : len(FACTS)]
    spread = np.maximum(values.std(axis=0), _LEAST_SPREAD)
    limit, least = 0.0, _FAR
    if len(training) >= _LEAST_RECORDINGS:
        deviation = np.sort(_left_out_deviations(values, machines, spread))
        limit, least = deviation[len(deviation) - max(1, int(ERROR_RATE * (len(deviation) + 1)))], _LEAST_EXCESS
    low, high = values.min(axis=0), values.max(axis=0)
    excess = np.maximum(recorded - high, low - recorded)
    beyond = excess / spread
    outside = [
        OutsideFact(int(c), FACTS[f], *(float(part[c, f]) for part in (recorded, low, high, beyond)))
        for c, f in np.argwhere((beyond > max(float(limit), 0.0)) & (excess >= least))
    ]
    return tuple(sorted(outside, key=lambda fact: -fact.deviation))


def _left_out_deviations(values: np.ndarray, machines: Sequence[str], spread: np.ndarray) -> np.ndarray:
    """Deviation of each training recording by the range of the others, or of other machines."""
    group = np.unique(machines, return_inverse=True)[1]
    if group.max() == 0:
        group = np.arange(len(values))
    lows = _extremes_without_own(values, group)
    highs = -_extremes_without_own(-values, group)
    return np.asarray((np.maximum(values - highs, lows - values) / spread).max(axis=(1, 2)))


def _extremes_without_own(values: np.ndarray, group: np.ndarray) -> np.ndarray:
    """Least value of each fact among the recordings of other groups, of each recording."""
    least = np.stack([values[group == number].min(axis=0) for number in range(group.max() + 1)])
    two = np.sort(least, axis=0)[:2]
    return np.where(least[group] == two[0], two[1], two[0])


def swapped_channels(
    training: Float64[np.ndarray, "recording channel fact"], facts: Float64[np.ndarray, "channel fact"]
) -> tuple[int, int] | None:
    """Two channels of a recording that resemble each other's in the training and not their own, or None.

    Channels are compared by the levels of their bands, in standard deviations between the training recordings (3 dB at
    least). Two are called swapped where exchanging them halves the root mean square of the differences of both, and
    neither of them was as far from its own in any training recording.
    """
    profiles, profile = training[:, :, len(FACTS) :], facts[:, len(FACTS) :]
    if len(training) < 2 or len(profile) < 2:
        return None
    mean, spread = profiles.mean(axis=0), np.maximum(profiles.std(axis=0), _LEAST_BAND_SPREAD)

    def distances(rows: np.ndarray) -> np.ndarray:
        return np.asarray(np.sqrt(np.mean(((rows - mean) / spread) ** 2, axis=-1)))

    furthest = distances(profiles).max(axis=0)
    distance = distances(profile[:, None])
    straight = np.diag(distance)
    ratio = (distance + distance.T) / np.maximum(straight[:, None] + straight, 1e-12)
    ratio[np.diag_indices(len(ratio))] = np.inf
    ratio[straight <= furthest] = ratio[:, straight <= furthest] = np.inf
    first, second = np.unravel_index(ratio.argmin(), ratio.shape)
    return (int(first), int(second)) if ratio[first, second] < 0.5 else None
