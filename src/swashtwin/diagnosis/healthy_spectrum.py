"""How a recording differs from the healthy ones that a model holds: levels that moved, and its
spectrum over theirs.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64

from swashtwin.learning import (
    BandPower,
    BandPowerLayout,
    Deviation,
    TrainingReference,
    WindowLayout,
    common_shift,
    reference_spectrum,
)
from swashtwin.pump import PRESSURE_TOLERANCE, SPEED_TOLERANCE, is_healthy, values_match

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


_LEAST = 5
"""Healthy recordings that a range takes at least, where there are so many."""


@dataclass(frozen=True, eq=False)
class HealthySpectrum:
    """Levels of a recording, band by band, and the range of those of healthy recordings."""

    channels: tuple[str, ...]
    """Channels."""
    unit: str
    """Unit of the samples."""
    low: Float64[np.ndarray, " band"]
    """Lower edge of each band [Hz]."""
    high: Float64[np.ndarray, " band"]
    """Upper edge of each band [Hz]."""
    level: Float64[np.ndarray, "channel band"]
    """Mean power density of the recording in each band [dB re 1 unit^2/Hz]."""
    healthy: Float64[np.ndarray, "recording channel band"]
    """The same of each healthy recording."""
    basis: str
    """Which healthy recordings these are, in words."""

    @property
    def excess(self) -> Float64[np.ndarray, "channel band"]:
        """How far the recording is above the greatest of the healthy ones, or below the least where
        negative [dB].
        """
        above, below = self.level - self.healthy.max(axis=0), self.level - self.healthy.min(axis=0)
        return np.where(above > 0, above, np.minimum(below, 0.0))

    def sentence(self) -> str:
        """How much of the spectrum lies outside the healthy range, and where it is furthest off."""
        excess = self.excess
        share = 100 * float(np.mean(excess != 0))
        if share == 0:
            return f"Every band lies within the range of {self.basis}."
        channel, band = np.unravel_index(np.abs(excess).argmax(), excess.shape)
        value = float(excess[channel, band])
        where = "above the greatest" if value > 0 else "below the least"
        edges = f"{self.low[band]:.0f} to {self.high[band]:.0f} Hz"
        return (
            f"{share:.0f} % of the bands lie outside the range of {self.basis}. Furthest off: {abs(value):.1f} dB "
            f"{where} of them, {edges}, channel {self.channels[channel]}."
        )


def classifier_spectrum(
    reference: TrainingReference | None,
    layout: WindowLayout,
    features: Float[np.ndarray, " feature"],
    specimen: str,
    condition: Float64[np.ndarray, " quantity"],
) -> HealthySpectrum | None:
    """Levels of a recording over the healthy recordings of the training; None where there are none.

    Those of the same machine and operating point are taken, or else of the same point, or else all.

    Parameters
    ----------
    features : means over the windows of the recording (`FittedClassifier.answer`).
    specimen : its machine; empty where not stated.
    condition : its speed [rad/s] and discharge pressure [Pa]; NaN where not stated.
    """
    healthy = np.array(
        [] if reference is None else [is_healthy(label) for label in reference.label], dtype=bool
    )
    if reference is None or not healthy.any():
        return None
    at_point = np.ones(len(healthy), dtype=bool)
    for column, tolerance in enumerate((SPEED_TOLERANCE, PRESSURE_TOLERANCE)):
        if np.isfinite(condition[column]):
            at_point &= values_match(reference.condition[:, column], condition[column], tolerance)
    of_machine = np.array([bool(name) and name == specimen for name in reference.specimen])
    choices = (
        (healthy & at_point & of_machine, "of this machine at this operating point"),
        (healthy & at_point, "at this operating point, of all machines"),
        (healthy, "of all machines and operating points"),
    )
    chosen, basis = next((choice for choice in choices if choice[0].sum() >= _LEAST), choices[-1])
    rows = np.vstack([features, reference.features[chosen].astype(np.float64)])
    low, high, density = reference_spectrum(
        rows, len(layout.channels), layout.length, layout.sample_rate
    )
    basis = f"the {chosen.sum()} healthy training recordings {basis}"
    return HealthySpectrum(layout.channels, layout.unit, low, high, density[0], density[1:], basis)


def detector_spectrum(
    layout: BandPowerLayout, deviation: Deviation, healthy: Float[np.ndarray, "recording level"]
) -> HealthySpectrum:
    """Levels of a recording in the detector's bands, over `healthy`, those of the recordings it was
    compared with.
    """
    bands = [index for index, level in enumerate(layout.band_powers) if level.is_band]
    each = len(bands) // len(layout.channels)
    edges = np.array(
        [(layout.band_powers[index].low, layout.band_powers[index].high) for index in bands[:each]]
    )
    rows = np.vstack([healthy.mean(axis=0) + deviation.change, healthy])[:, bands]
    density = rows.reshape(len(rows), len(layout.channels), each) - 10 * np.log10(
        edges[:, 1] - edges[:, 0]
    )
    basis = f"the {len(healthy)} healthy recordings of its operating point"
    return HealthySpectrum(
        layout.channels, layout.unit, edges[:, 0], edges[:, 1], density[0], density[1:], basis
    )
