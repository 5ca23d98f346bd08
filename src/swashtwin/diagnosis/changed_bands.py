"""Band powers of a recording that differ from those of healthy recordings."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from swashtwin.learning import Deviation, common_shift
from swashtwin.signals import BandPower

MIN_SPREADS = 3.0
"""Change from which a band power is listed [standard deviations of the healthy recordings]: of
healthy recordings about 1 in 400 changes as much."""
_MAX_CHANGES = 8


@dataclass(frozen=True)
class BandPowerChange:
    """A band power that changed."""

    channel: str
    """Channel."""
    band: str
    """Which band, such as ``shaft order 9 (129 Hz)``."""
    change: float
    """Change from the mean of the healthy recordings [dB]."""
    spreads: float
    """The change over the standard deviation of such a difference between healthy recordings."""

    @property
    def sentence(self) -> str:
        """Description such as ``+6.2 dB at shaft order 9 (129 Hz), channel x``."""
        return f"{self.change:+.1f} dB at {self.band}, channel {self.channel}"


def band_power_changes(
    deviation: Deviation, band_powers: Sequence[BandPower], shaft: float | None
) -> tuple[tuple[str, ...], tuple[BandPowerChange, ...]]:
    """Return the channels that changed as a whole, and the band powers that changed besides.

    A band is left out if an order inside it changed more, and an order if its band did.

    Parameters
    ----------
    deviation : change of each band power.
    band_powers : description of each band power.
    shaft : shaft frequency [Hz], to locate orders; None if it is not known.

    Returns
    -------
    A sentence for each channel, and the changes of band powers, largest first.
    """
    spreads = deviation.spreads.copy()
    is_band = np.array([band_power.is_band for band_power in band_powers])
    channel_names = np.array([band_power.channel for band_power in band_powers])

    sentences = []
    for channel in dict.fromkeys(channel_names.tolist()):
        in_channel = channel_names == channel
        shift = float(common_shift(deviation.change[in_channel & is_band]))
        if shift:
            sentences.append(
                f"{shift:+.1f} dB in all bands of channel {channel} (changed gain, sensor or "
                "mounting?)"
            )
            # What changed besides the whole channel, in the same standard deviations.
            change = deviation.change[in_channel]
            scatter = change / deviation.spreads[in_channel]
            spreads[in_channel] = (change - shift) / scatter

    listed: list[int] = []
    for index in np.argsort(-np.abs(spreads)).tolist():
        if len(listed) == _MAX_CHANGES or abs(spreads[index]) < MIN_SPREADS:
            break
        is_covered = any(
            _overlap(band_powers[index], band_powers[larger], shaft) for larger in listed
        )
        if not is_covered:
            listed.append(index)

    changes = tuple(
        BandPowerChange(
            channel=band_powers[index].channel,
            band=band_powers[index].describe(shaft),
            change=float(deviation.change[index]),
            spreads=float(deviation.spreads[index]),
        )
        for index in listed
    )
    return tuple(sentences), changes


def _overlap(first: BandPower, second: BandPower, shaft: float | None) -> bool:
    """Whether an order and a band of one channel hold the same lines."""
    if (first.channel, first.is_envelope) != (second.channel, second.is_envelope):
        return False
    if (first.order is None) is (second.order is None):
        return False
    first_low, first_high = first.edges(shaft)
    second_low, second_high = second.edges(shaft)
    return bool(first_low < second_high and second_low < first_high)
