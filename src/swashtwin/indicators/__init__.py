"""What people who look after machines expect to be told of a recording, each with an exact convention.

Amplitudes are one-sided and peak (a sine of amplitude 1 reads 1), levels are root mean squares (it reads 0.7071),
tapers are corrected, means are removed; docs/indicators.md has the whole list.
"""

from swashtwin.indicators.cepstrum import harmonic_family_index, real_cepstrum
from swashtwin.indicators.envelope import EnvelopeSpectrum, envelope_spectrum
from swashtwin.indicators.kurtogram import Kurtogram, kurtogram
from swashtwin.indicators.levels import band_rms, velocity_rms
from swashtwin.indicators.line_spectra import KINDS, Kind, LineSpectrum, Mark, spectrum_of
from swashtwin.indicators.registry import BANDS, FAMILIES, Band, Indicator
from swashtwin.indicators.synchronous import SynchronousLines, synchronous_lines
from swashtwin.indicators.table import IndicatorTable, Row, indicators_of, stacked
from swashtwin.indicators.trend import Trend, TrendPoint, trend_of

__all__ = [
    "BANDS",
    "FAMILIES",
    "KINDS",
    "Band",
    "EnvelopeSpectrum",
    "Indicator",
    "IndicatorTable",
    "Kind",
    "Kurtogram",
    "LineSpectrum",
    "Mark",
    "Row",
    "SynchronousLines",
    "Trend",
    "TrendPoint",
    "band_rms",
    "envelope_spectrum",
    "harmonic_family_index",
    "indicators_of",
    "kurtogram",
    "real_cepstrum",
    "spectrum_of",
    "stacked",
    "synchronous_lines",
    "trend_of",
    "velocity_rms",
]
