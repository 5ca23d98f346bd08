"""Band powers of a recording that differ from those of healthy recordings."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from swashtwin.learning import Deviation, common_shift
from swashtwin.signals import BandPower

LEAST_SPREADS = 3.0
"""Standard deviations by which a level must have moved to be listed."""
_MOST = 8


@dataclass(frozen=True)
class BandPowerChange:
    """A band power that moved."""

    channel: str
    """Channel."""
    band: str
    """Which band, such as ``shaft order 9 (129 Hz)``."""
    change: float
    """Change from the mean of the healthy recordings [dB]."""
    spreads: float
    """The same over the standard deviation of such a difference between healthy recordings."""

    @property
    def sentence(self) -> str:
        """The same in words: ``+6.2 dB at shaft order 9 (129 Hz), channel x``."""
        return f"{self.change:+.1f} dB at {self.band}, channel {self.channel}"


def band_power_changes(
    deviation: Deviation, band_powers: Sequence[BandPower], shaft: float | None
) -> tuple[tuple[str, ...], tuple[BandPowerChange, ...]]:
    """(channels that moved as a whole, in words; the levels that moved most beside that, furthest
    first).

    A band is left out where an order within it moved further, and an order where its band did.

    Parameters
    ----------
    levels : what each level is.
    shaft : shaft frequency [Hz], to say where orders are.
    """
    change, spreads = deviation.change.copy(), deviation.spreads.copy()
    sentences = []
    for channel in dict.fromkeys(level.channel for level in band_powers):
        of_channel = np.array([level.channel == channel for level in band_powers])
        shift = float(
            common_shift(change[of_channel & np.array([level.is_band for level in band_powers])])
        )
        if shift:
            sentences.append(
                f"{shift:+.1f} dB in all bands of channel {channel}: a changed gain, sensor or mounting does that"
            )
            scatter = deviation.change[of_channel] / deviation.spreads[of_channel]
            change[of_channel] -= shift
            spreads[of_channel] = change[of_channel] / scatter
    listed: list[int] = []
    for index in np.argsort(-np.abs(spreads)).tolist():
        if len(listed) == _MOST or abs(spreads[index]) < LEAST_SPREADS:
            break
        if not any(_overlap(band_powers[index], band_powers[other], shaft) for other in listed):
            listed.append(index)
    return tuple(sentences), tuple(
        BandPowerChange(
            band_powers[index].channel, band_powers[index].words(shaft), float(deviation.change[index]),
            float(deviation.spreads[index]),
        )
        for index in listed
    )  # fmt: skip


def _overlap(first: BandPower, second: BandPower, shaft: float | None) -> bool:
    """Whether two levels of one channel, one an order and one a band, hold the same lines."""
    if (first.channel, first.is_envelope) != (second.channel, second.is_envelope):
        return False
    if (first.order is None) is (second.order is None):
        return False
    edges = first.edges(shaft), second.edges(shaft)
    return bool(edges[0][0] < edges[1][1] and edges[1][0] < edges[0][1])
