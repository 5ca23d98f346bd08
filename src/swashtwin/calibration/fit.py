"""Agreement of a twin with a measurement, as the paper reports it: waveforms, spectra, RMSE, PE,
SVE.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from types import MappingProxyType

import numpy as np
import torch
from jaxtyping import Complex, Float, Int

from swashtwin.calibration.measurement import Measurement
from swashtwin.calibration.posterior import Posterior
from swashtwin.calibration.spectrum_objective import Comparison
from swashtwin.foundation import short_repr
from swashtwin.physics import Twin
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import Recording
from swashtwin.signals import (
    align_waveform,
    band_limited,
    peak_error,
    spectral_correlation,
    spectrum_value_error,
    synchronous_signal,
    waveform_rmse,
)

MAX_WINDOWS = 8
"""Windows compared per recording, evenly spread over it."""
SUBSAMPLE_SHIFTS = 4
"""Shifts tried within one sample; without them the error at 2.5 kHz and 25.6 kHz would be a
tenth.
"""
ERROR_NAMES = ("rmse", "relative_rmse", "peak_error", "spectrum_value_error")
"""Fields of an `Agreement` that are zero at best."""
AGREEMENT_LABELS = MappingProxyType(
    {
        "rmse": "RMSE of the waveforms [m/s²]",
        "relative_rmse": "RMSE over the RMS of the measured waveform",
        "peak_error": "PE, peak error over the measured peak",
        "spectrum_value_error": "SVE, spectrum value error over the measured lines",
        "spectral_correlation": "correlation of the lines' levels in dB",
    }
)
"""Titles of the fields of an `Agreement`, with their units."""
POSTERIOR_DRAWS = 64
"""Twins drawn from the posterior for the band of each line."""
MARGIN_REVOLUTIONS = 5
"""Revolutions at each end, measured and simulated, that are not compared: the band filter settles
there.
"""


@dataclass(frozen=True)
class Agreement:
    """Differences between measured and simulated acceleration within the band.

    Waveforms are compared over windows of one revolution, each aligned over all phases, and
    averaged over windows and recordings: the shaft angle at the start of a recording is unknown. A
    model without noise cannot reach zero.
    """

    rmse: float
    """Root mean square of the waveforms' difference [m/s^2] (the paper's RMSE)."""
    relative_rmse: float
    """The same over the root mean square of the measured waveform; 1 is the error of a silent
    twin.
    """
    peak_error: float
    """Difference of the peaks over the measured peak (the paper's PE)."""
    spectrum_value_error: float
    """Sum of the lines' differences over the sum of the measured lines (the paper's SVE; our
    reading).
    """
    spectral_correlation: float
    """Correlation of the lines' levels in dB over channels and orders, 1 at best
    (`signals.spectral_correlation`).
    """


@dataclass(frozen=True, eq=False)
class Waveforms:
    """One revolution, measured and simulated, aligned."""

    time: Float[np.ndarray, " time"]
    """Time [s]."""
    measured: Float[np.ndarray, "channel time"]
    """Measured acceleration [m/s^2], within the band."""
    nominal: Float[np.ndarray, "channel time"]
    """The nominal twin [m/s^2]."""
    calibrated: Float[np.ndarray, "channel time"]
    """The calibrated twin [m/s^2]."""


@dataclass(frozen=True, eq=False)
class Spectra:
    """Line amplitudes, measured and simulated."""

    channels: tuple[str, ...]
    """Channels."""
    orders: Int[np.ndarray, " order"]
    """Multiples of the shaft frequency."""
    frequency: Float[np.ndarray, " order"]
    """The same in Hz, at the twin's speed."""
    measured: Float[np.ndarray, "channel order"]
    """Measured amplitude [m/s^2]."""
    deviation: Float[np.ndarray, "channel order"]
    """Standard deviation of the measured amplitude [m/s^2]."""
    nominal: Float[np.ndarray, "channel order"]
    """The nominal twin [m/s^2]."""
    calibrated: Float[np.ndarray, "channel order"]
    """The calibrated twin [m/s^2]."""
    low: Float[np.ndarray, "channel order"]
    """Amplitude below which 5 % of the twins drawn from the posterior lie [m/s^2]."""
    high: Float[np.ndarray, "channel order"]
    """Amplitude above which 5 % of them lie [m/s^2]; between both are 90 %."""


@dataclass(frozen=True, eq=False)
class Fit:
    """Agreement with the recordings of one operating point, before and after calibration."""

    condition: OperatingCondition
    """The operating point."""
    recording_ids: tuple[str, ...]
    """Recordings measured there; the waveforms are of the first."""
    nominal_agreement: Agreement
    """Agreement of the nominal twin."""
    calibrated_agreement: Agreement
    """Agreement of the calibrated twin with the same recordings: no test, because it was calibrated
    on them.
    """
    spectra: Spectra
    """Lines before and after calibration."""
    waveforms: Waveforms
    """One revolution before and after calibration."""
    duration: float
    """Total length of the recordings [s]."""

    __repr__ = short_repr


def evaluate_fit(
    comparison: Comparison, nominal: Twin, calibrated: Twin, posterior: Posterior
) -> Fit:
    """Return the fit of both twins at the comparison's operating point.

    Its spectra hold the range of each line under the posterior.
    """
    measurement = comparison.measurement
    condition = comparison.twin.condition

    amplitudes, agreements, waveforms = [], [], []
    for twin in (nominal.at(condition), calibrated.at(condition)):
        amplitude = comparison.amplitude_of(twin)
        agreement, measured_waveform, waveform = evaluate_agreement(measurement, twin, amplitude)
        amplitudes.append(amplitude)
        agreements.append(agreement)
        waveforms.append(waveform)

    points = torch.as_tensor(posterior.draws(POSTERIOR_DRAWS, seed=0))
    with torch.no_grad():
        drawn_amplitudes = comparison.lines(posterior.unknowns, points).abs().numpy()
    low, high = np.quantile(drawn_amplitudes, (0.05, 0.95), axis=0)

    sample_rate = measurement.recordings[0].sample_rate
    return Fit(
        condition=condition,
        recording_ids=measurement.recording_ids,
        nominal_agreement=agreements[0],
        calibrated_agreement=agreements[1],
        spectra=Spectra(
            channels=measurement.channels,
            orders=measurement.orders,
            frequency=measurement.orders * condition.shaft_frequency,
            measured=measurement.amplitude,
            deviation=measurement.deviation,
            nominal=amplitudes[0],
            calibrated=amplitudes[1],
            low=low,
            high=high,
        ),
        waveforms=Waveforms(
            time=np.arange(measured_waveform.shape[1]) / sample_rate,
            measured=measured_waveform,
            nominal=waveforms[0],
            calibrated=waveforms[1],
        ),
        duration=sum(recording.duration for recording in measurement.recordings),
    )


def average_agreements(agreements: Sequence[Agreement]) -> Agreement:
    """Return the mean of each field."""
    means = {
        error.name: float(np.mean([getattr(agreement, error.name) for agreement in agreements]))
        for error in fields(Agreement)
    }
    return Agreement(**means)


def evaluate_agreement(
    measurement: Measurement, twin: Twin, amplitude: Float[np.ndarray, "channel order"]
) -> tuple[Agreement, Float[np.ndarray, "channel time"], Float[np.ndarray, "channel time"]]:
    """Return the agreement, and one revolution of the first recording, measured and simulated.

    Parameters
    ----------
    amplitude : the twin's line amplitudes [m/s^2] at the measurement's orders.
    """
    rows = [twin.pump.channels.index(name) for name in measurement.channels]
    with torch.no_grad():
        lines = twin.acceleration().numpy()[rows]
    return evaluate_line_agreement(measurement, lines, twin.orders, amplitude)


def evaluate_line_agreement(
    measurement: Measurement,
    lines: Complex[np.ndarray, "channel line"],
    orders: Int[np.ndarray, " line"],
    amplitude: Float[np.ndarray, "channel order"],
) -> tuple[Agreement, Float[np.ndarray, "channel time"], Float[np.ndarray, "channel time"]]:
    """Return what `evaluate_agreement` does for complex lines [m/s^2] at shaft `orders`.

    Parameters
    ----------
    amplitude : amplitudes of the lines [m/s^2] at the measurement's orders.
    """
    windows = []
    for recording in measurement.recordings:
        windows += _align_windows(recording, lines, orders, measurement.band)

    rmses = [waveform_rmse(measured, simulated) for measured, simulated in windows]
    measured_rms = [float(np.sqrt(np.mean(measured**2))) for measured, _ in windows]
    relative = [error / rms for error, rms in zip(rmses, measured_rms, strict=True)]
    peaks = [peak_error(measured, simulated) for measured, simulated in windows]

    agreement = Agreement(
        rmse=float(np.mean(rmses)),
        relative_rmse=float(np.mean(relative)),
        peak_error=float(np.mean(peaks)),
        spectrum_value_error=spectrum_value_error(measurement.amplitude, amplitude),
        spectral_correlation=spectral_correlation(measurement.amplitude, amplitude),
    )
    return agreement, *windows[0]


def _align_windows(
    recording: Recording, lines: np.ndarray, orders: np.ndarray, band: tuple[float, float]
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return windows of one revolution, measured and simulated, aligned."""
    turn = _samples_per_revolution(recording)
    # half the shaft frequency at least, so that no slow drift counts
    low = max(band[0], 0.5 * recording.sample_rate / turn)
    high = band[1]
    measured = band_limited(recording.signal, recording.sample_rate, low, high)
    simulations = [
        _simulate_waveform(lines, orders, recording, (low, high), step / SUBSAMPLE_SHIFTS)
        for step in range(SUBSAMPLE_SHIFTS)
    ]

    n_turns = measured.shape[1] // turn - 2 * MARGIN_REVOLUTIONS
    last_turn = MARGIN_REVOLUTIONS + n_turns - 1
    selected_turns = np.unique(
        np.linspace(MARGIN_REVOLUTIONS, last_turn, min(MAX_WINDOWS, n_turns)).astype(int)
    )

    windows = []
    for turn_index in selected_turns:
        start = turn_index * turn
        window = measured[:, start : start + turn]
        # the shaft angle at the start of a recording is unknown, so every shift is tried
        candidates = [align_waveform(window, simulated) for simulated in simulations]
        errors = [waveform_rmse(window, candidate) for candidate in candidates]
        windows.append((window, candidates[int(np.argmin(errors))]))
    return windows


def _samples_per_revolution(recording: Recording) -> int:
    assert recording.condition is not None  # a measurement holds no recording without one
    return round(recording.condition.period * recording.sample_rate)


def _simulate_waveform(
    lines: np.ndarray,
    orders: np.ndarray,
    recording: Recording,
    band: tuple[float, float],
    shift: float,
) -> Float[np.ndarray, "channel time"]:
    """Return two revolutions at the recording's speed and rate, through its filter, the start
    shifted by `shift` [sample].
    """
    assert recording.condition is not None
    rate = recording.sample_rate
    turn = _samples_per_revolution(recording)

    is_resolved = orders * recording.condition.shaft_frequency < 0.49 * rate
    samples = np.arange((2 + 2 * MARGIN_REVOLUTIONS) * turn) + shift
    angle = recording.condition.speed * samples / rate
    signal = synchronous_signal(lines[:, is_resolved], orders[is_resolved], angle)

    # the filter has settled after the margin
    margin = MARGIN_REVOLUTIONS * turn
    return band_limited(signal, rate, *band)[:, margin : margin + 2 * turn]
