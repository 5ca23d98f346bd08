"""Names that other rooms import, and where each lives."""

from .bearings import BEARINGS as BEARINGS
from .bearings import SEATS as SEATS
from .bearings import defect_prominences as defect_prominences
from .bearings import prewhitened as prewhitened
from .comparison import aligned as aligned
from .comparison import peak_error as peak_error
from .comparison import spectral_correlation as spectral_correlation
from .comparison import spectrum_value_error as spectrum_value_error
from .comparison import waveform_rmse as waveform_rmse
from .filtering import NoiseKind as NoiseKind
from .filtering import add_noise as add_noise
from .filtering import band_limited as band_limited
from .filtering import unit_noise as unit_noise
from .indicator_table import IndicatorTable as IndicatorTable
from .indicator_table import Row as Row
from .indicator_table import indicators_of as indicators_of
from .indicator_table import long_indicators as long_indicators
from .indicator_table import stacked as stacked
from .indicators import BANDS as BANDS
from .indicators import FAMILIES as FAMILIES
from .indicators import Band as Band
from .indicators import Indicator as Indicator
from .levels import TIME_STATISTICS as TIME_STATISTICS
from .levels import time_statistics as time_statistics
from .line_spectra import LineSpectrum as LineSpectrum
from .line_spectra import LineSpectrumKind as LineSpectrumKind
from .line_spectra import Mark as Mark
from .line_spectra import spectrum_of as spectrum_of
from .order_bands import OrderBands as OrderBands
from .shaft_angle import ShaftAngle as ShaftAngle
from .shaft_angle import resampled_by_angle as resampled_by_angle
from .shaft_angle import stated_angle as stated_angle
from .shaft_angle import tachometer_speed as tachometer_speed
from .spectra import OrderSpectrum as OrderSpectrum
from .spectra import band_shares as band_shares
from .spectra import fourier_lines as fourier_lines
from .spectra import hann_taper as hann_taper
from .spectra import inverse_transform as inverse_transform
from .spectra import line_frequencies as line_frequencies
from .spectra import order_spectrum as order_spectrum
from .spectra import periodic_signal as periodic_signal
from .spectra import power_density as power_density
from .spectra import signal_envelope as signal_envelope
from .spectra import synchronous_signal as synchronous_signal
from .spectra import tapered_transform as tapered_transform
from .spectra import transform as transform
from .tracking import piston_pass_angle as piston_pass_angle
from .tracking import tracked_speed as tracked_speed
from .trend import Trend as Trend
from .trend import TrendPoint as TrendPoint
from .trend import trend_of as trend_of

__all__ = [
    "BANDS",
    "BEARINGS",
    "FAMILIES",
    "SEATS",
    "TIME_STATISTICS",
    "Band",
    "Indicator",
    "IndicatorTable",
    "LineSpectrum",
    "LineSpectrumKind",
    "Mark",
    "NoiseKind",
    "OrderBands",
    "OrderSpectrum",
    "Row",
    "ShaftAngle",
    "Trend",
    "TrendPoint",
    "add_noise",
    "aligned",
    "band_limited",
    "band_shares",
    "defect_prominences",
    "fourier_lines",
    "hann_taper",
    "indicators_of",
    "inverse_transform",
    "line_frequencies",
    "long_indicators",
    "order_spectrum",
    "peak_error",
    "periodic_signal",
    "piston_pass_angle",
    "power_density",
    "prewhitened",
    "resampled_by_angle",
    "signal_envelope",
    "spectral_correlation",
    "spectrum_of",
    "spectrum_value_error",
    "stacked",
    "stated_angle",
    "synchronous_signal",
    "tachometer_speed",
    "tapered_transform",
    "time_statistics",
    "tracked_speed",
    "transform",
    "trend_of",
    "unit_noise",
    "waveform_rmse",
]
