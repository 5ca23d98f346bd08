"""How a recording differs from the healthy ones that a model holds: levels that moved, and its
spectrum over theirs.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64

from swashtwin.learning import (
    BandPowerLayout,
    Deviation,
    TrainingReference,
    WindowLayout,
    reference_spectrum,
)
from swashtwin.pump import PRESSURE_TOLERANCE, SPEED_TOLERANCE, is_healthy, values_match

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
