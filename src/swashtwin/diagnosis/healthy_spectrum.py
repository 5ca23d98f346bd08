"""The spectrum of a recording over those of the healthy recordings that a model holds."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float64

from swashtwin.learning import (
    BandPowerLayout,
    Deviation,
    TrainingReference,
    WindowLayout,
    reference_spectrum,
)
from swashtwin.pump import PRESSURE_TOLERANCE, SPEED_TOLERANCE, is_healthy, values_match

# Healthy recordings from which their range is meaningful; with fewer of the machine or operating
# point, others are taken too.
_MIN_RECORDINGS = 5


@dataclass(frozen=True, eq=False)
class HealthySpectrum:
    """Spectrum of a recording in bands, and the spectra of healthy recordings."""

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
    """Description of the healthy recordings."""

    @property
    def excess(self) -> Float64[np.ndarray, "channel band"]:
        """Distance from the healthy range, positive above and negative below it [dB]."""
        above = self.level - self.healthy.max(axis=0)
        below = self.level - self.healthy.min(axis=0)
        return np.where(above > 0, above, np.minimum(below, 0.0))

    def sentence(self) -> str:
        """Describe how many bands lie outside the healthy range, and the largest excess."""
        excess = self.excess
        share = 100 * float(np.mean(excess != 0))
        if share == 0:
            return f"Every band lies within the range of {self.basis}."

        channel, band = np.unravel_index(np.abs(excess).argmax(), excess.shape)
        value = float(excess[channel, band])
        side = "above" if value > 0 else "below"
        return (
            f"{share:.0f} % of the bands lie outside the range of {self.basis}. Largest excess: "
            f"{abs(value):.1f} dB {side} the range, {self.low[band]:.0f} to {self.high[band]:.0f} "
            f"Hz, channel {self.channels[channel]}."
        )


def classifier_spectrum(
    reference: TrainingReference | None,
    layout: WindowLayout,
    features: Float[np.ndarray, " feature"],
    specimen: str,
    condition: Float64[np.ndarray, " quantity"],
) -> HealthySpectrum | None:
    """Return a recording's spectrum over the healthy training recordings; None if there are none.

    Those of the same machine and operating point are taken, or else those of the same operating
    point, or else all.

    Parameters
    ----------
    features : means over the windows of the recording (`FittedClassifier.answer`).
    specimen : its machine; empty if not specified.
    condition : its speed [rad/s] and discharge pressure [Pa]; NaN if not specified.
    """
    if reference is None:
        return None
    healthy = np.array([is_healthy(label) for label in reference.label], dtype=bool)
    if not healthy.any():
        return None

    selected, description = _similar_recordings(reference, healthy, specimen, condition)
    rows = np.vstack([features, reference.features[selected].astype(np.float64)])
    low, high, density = reference_spectrum(
        rows, len(layout.channels), layout.length, layout.sample_rate
    )
    return HealthySpectrum(
        channels=layout.channels,
        unit=layout.unit,
        low=low,
        high=high,
        level=density[0],
        healthy=density[1:],
        basis=f"the {selected.sum()} healthy training recordings {description}",
    )


def _similar_recordings(
    reference: TrainingReference,
    healthy: Bool[np.ndarray, " recording"],
    specimen: str,
    condition: Float64[np.ndarray, " quantity"],
) -> tuple[Bool[np.ndarray, " recording"], str]:
    """Return the most similar healthy recordings that are enough for a range."""
    at_point = healthy.copy()
    for column, tolerance in enumerate((SPEED_TOLERANCE, PRESSURE_TOLERANCE)):
        if np.isfinite(condition[column]):
            at_point &= values_match(reference.condition[:, column], condition[column], tolerance)
    of_machine = np.array([bool(name) and name == specimen for name in reference.specimen])

    candidates = (
        (at_point & of_machine, "of this machine at this operating point"),
        (at_point, "at this operating point, of all machines"),
    )
    for selected, description in candidates:
        if selected.sum() >= _MIN_RECORDINGS:
            return selected, description
    return healthy, "of all machines and operating points"


def detector_spectrum(
    layout: BandPowerLayout, deviation: Deviation, healthy: Float[np.ndarray, "recording level"]
) -> HealthySpectrum:
    """Return a recording's spectrum in a detector's bands, over the healthy recordings.

    Parameters
    ----------
    layout : of the detector.
    deviation : of the recording.
    healthy : band powers of the recordings that it was compared with [dB].
    """
    n_channels = len(layout.channels)
    columns = [index for index, power in enumerate(layout.band_powers) if power.is_band]
    n_bands = len(columns) // n_channels
    bands = [layout.band_powers[index] for index in columns[:n_bands]]
    low = np.array([band.low for band in bands])
    high = np.array([band.high for band in bands])

    recording = healthy.mean(axis=0) + deviation.change
    rows = np.vstack([recording, healthy])[:, columns]
    density = rows.reshape(len(rows), n_channels, n_bands) - 10 * np.log10(high - low)
    return HealthySpectrum(
        channels=layout.channels,
        unit=layout.unit,
        low=low,
        high=high,
        level=density[0],
        healthy=density[1:],
        basis=f"the {len(healthy)} healthy recordings of its operating point",
    )
