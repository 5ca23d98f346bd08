"""Compare a twin's lines with measured ones, line by line."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from swashtwin.physics import Twin
from swashtwin.signals import spectral_correlation, spectrum_value_error

MIN_AMPLITUDE = 1e-12
"""Amplitude [m/s^2] that stands for a line that the twin lacks; the logarithm of zero is
infinite.
"""


@dataclass(frozen=True, eq=False)
class MeasuredLines:
    """Line amplitudes of a measurement."""

    channels: tuple[str, ...]
    """Channels."""
    orders: Int[np.ndarray, " order"]
    """Multiples of the shaft frequency."""
    amplitude: Float[np.ndarray, "channel order"]
    """Amplitudes [m/s^2]."""
    deviation: Float[np.ndarray, "channel order"]
    """Their standard deviations [m/s^2]."""


@dataclass(frozen=True, eq=False)
class LineMisfit:
    """Differences between the lines of a twin and measured ones."""

    level_difference: Float[np.ndarray, "channel order"]
    """Level of the twin's line over the measured one [dB]; NaN if the measured line is not clear of
    the noise.
    """
    spectral_correlation: float
    """Correlation of the lines' levels, 1 at best (`signals.spectral_correlation`)."""
    spectrum_value_error: float
    """Sum of the differences over the sum of the measured lines."""


def compare_lines(
    twin: Twin, amplitude: Float[np.ndarray, "channel line"], measured: MeasuredLines
) -> LineMisfit:
    """Return the misfit of a twin's lines.

    Parameters
    ----------
    amplitude : amplitudes [m/s^2] of the twin's channels at its orders.
    """
    channel_rows = [twin.pump.channels.index(name) for name in measured.channels]
    is_simulated = np.isin(measured.orders, twin.orders)
    columns = np.searchsorted(twin.orders, measured.orders[is_simulated])

    # A twin has no line at an order beyond its bandwidth.
    simulated = np.zeros_like(measured.amplitude)
    simulated[:, is_simulated] = amplitude[channel_rows][:, columns]

    is_clear = measured.amplitude > measured.deviation
    reference = np.where(is_clear, measured.amplitude, np.nan)
    return LineMisfit(
        20 * np.log10(np.maximum(simulated, MIN_AMPLITUDE) / reference),
        spectral_correlation(measured.amplitude, simulated),
        spectrum_value_error(measured.amplitude, simulated),
    )
