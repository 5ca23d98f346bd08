"""Differences between twin and measurement, as the paper reports them: waveforms, spectra, RMSE,
PE, SVE.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
import torch
from jaxtyping import Complex, Float, Int

from swashtwin.calibration.measurement import Measurement
from swashtwin.calibration.posterior import Posterior
from swashtwin.calibration.spectrum_objective import Comparison
from swashtwin.physics import Twin
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import Recording
from swashtwin.signals import (
    aligned,
    band_limited,
    peak_error,
    spectral_correlation,
    spectrum_value_error,
    synchronous_signal,
    waveform_rmse,
)

MOST_WINDOWS = 8
"""Windows compared per recording, evenly spread over it."""
PHASES = 4
"""Shifts tried within one sample; without them the error at 2.5 kHz and 25.6 kHz would be a
tenth.
"""
ERRORS = ("rmse", "relative_rmse", "peak_error", "spectrum_value_error")
"""Figures of an `Agreement` that are zero at best."""
DRAWS = 64
"""Twins drawn from the posterior for the band of each line."""
MARGIN = 5
"""Revolutions at each end, measured and simulated, that are not compared: the band filter settles
there.
"""


@dataclass(frozen=True)
class Agreement:
    """Differences between measured and simulated acceleration within the band.

    Waveforms are compared over windows of one revolution, each aligned over all phases, and
    averaged over windows and
    recordings: the shaft angle at the start of a recording is unknown. A model without noise cannot
    reach zero.
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
    """The twin before calibration."""
    calibrated: Float[np.ndarray, "channel time"]
    """The twin after calibration."""


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
    """Its standard deviation [m/s^2]."""
    nominal: Float[np.ndarray, "channel order"]
    """The twin before calibration."""
    calibrated: Float[np.ndarray, "channel order"]
    """The twin after calibration."""
    low: Float[np.ndarray, "channel order"]
    """Amplitude below which a twentieth of the twins drawn from the posterior lies."""
    high: Float[np.ndarray, "channel order"]
    """Amplitude above which a twentieth of them lies; between both are 90 %."""


@dataclass(frozen=True, eq=False)
class Fit:
    """Agreement with the recordings of one condition, before and after calibration."""

    condition: OperatingCondition
    """The condition."""
    recording_ids: tuple[str, ...]
    """Recordings measured there; the waveforms are of the first."""
    before: Agreement
    """Agreement of the nominal twin."""
    after: Agreement
    """Agreement of the calibrated twin with the same recordings: no test, because it was calibrated
    on them.
    """
    spectra: Spectra
    """Lines before and after."""
    waveforms: Waveforms
    """One revolution before and after."""
    duration: float
    """Length of the recordings together [s]."""


def fit_of(comparison: Comparison, nominal: Twin, calibrated: Twin, posterior: Posterior) -> Fit:
    """Fit of both twins at the comparison's condition, with the range of each line under the
    posterior.
    """
    measurement, condition = comparison.measurement, comparison.twin.condition
    amplitudes, agreements, excerpts = [], [], []
    for twin in (nominal.at(condition), calibrated.at(condition)):
        amplitudes.append(comparison.amplitude_of(twin))
        near, measured, simulated = agreement(measurement, twin, amplitudes[-1])
        agreements.append(near)
        excerpts.append(simulated)
    with torch.no_grad():
        draws = (
            comparison.lines(posterior.unknowns, torch.as_tensor(posterior.draws(DRAWS, seed=0)))
            .abs()
            .numpy()
        )
    low, high = np.quantile(draws, (0.05, 0.95), axis=0)
    spectra = Spectra(
        channels=measurement.channels,
        orders=measurement.orders,
        frequency=measurement.orders * condition.shaft_frequency,
        measured=measurement.amplitude,
        deviation=measurement.deviation,
        nominal=amplitudes[0],
        calibrated=amplitudes[1],
        low=low,
        high=high,
    )
    times = np.arange(measured.shape[1]) / measurement.recordings[0].sample_rate
    before, after = agreements
    waveforms = Waveforms(times, measured, *excerpts)
    duration = sum(recording.duration for recording in measurement.recordings)
    return Fit(condition, measurement.recording_ids, before, after, spectra, waveforms, duration)


def average_agreements(agreements: Sequence[Agreement]) -> Agreement:
    """Mean of each figure."""
    names = [item.name for item in fields(Agreement)]
    return Agreement(
        **{
            name: float(np.mean([getattr(agreement, name) for agreement in agreements]))
            for name in names
        }
    )


def agreement(
    measurement: Measurement, twin: Twin, amplitude: Float[np.ndarray, "channel order"]
) -> tuple[Agreement, Float[np.ndarray, "channel time"], Float[np.ndarray, "channel time"]]:
    """Differences, and one revolution of the first recording measured and simulated.

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
    """The same of complex lines [m/s^2] at shaft `orders`, wherever they come from.

    Parameters
    ----------
    amplitude : their amplitudes [m/s^2] at the measurement's orders.
    """
    rmses, relative, peaks, excerpts = [], [], [], []
    for recording in measurement.recordings:
        turn = _samples_per_turn(recording)
        low, high = (
            max(measurement.band[0], 0.5 * recording.sample_rate / turn),
            measurement.band[1],
        )
        measured = band_limited(recording.signal, recording.sample_rate, low, high)
        shifted = [
            _simulated(lines, orders, recording, (low, high), step / PHASES)
            for step in range(PHASES)
        ]
        turns = measured.shape[1] // turn - 2 * MARGIN
        for number in np.unique(
            np.linspace(MARGIN, MARGIN + turns - 1, min(MOST_WINDOWS, turns)).astype(int)
        ):
            start = number * turn
            window = measured[:, start : start + turn]
            candidates = [aligned(window, simulated) for simulated in shifted]
            errors = [waveform_rmse(window, candidate) for candidate in candidates]
            twins = candidates[int(np.argmin(errors))]
            rmses.append(min(errors))
            relative.append(min(errors) / float(np.sqrt(np.mean(window**2))))
            peaks.append(peak_error(window, twins))
            excerpts.append((window, twins))
    result = Agreement(
        rmse=float(np.mean(rmses)),
        relative_rmse=float(np.mean(relative)),
        peak_error=float(np.mean(peaks)),
        spectrum_value_error=spectrum_value_error(measurement.amplitude, amplitude),
        spectral_correlation=spectral_correlation(measurement.amplitude, amplitude),
    )
    return result, *excerpts[0]


def _samples_per_turn(recording: Recording) -> int:
    assert recording.condition is not None  # measurements hold none without
    return round(recording.condition.period * recording.sample_rate)


def _simulated(
    lines: np.ndarray,
    orders: np.ndarray,
    recording: Recording,
    band: tuple[float, float],
    shift: float,
) -> Float[np.ndarray, "channel time"]:
    """Two revolutions at the recording's speed and rate, through its filter, the start shifted by
    `shift` [sample].
    """
    assert recording.condition is not None
    turn = _samples_per_turn(recording)
    is_resolved = orders * recording.condition.shaft_frequency < 0.49 * recording.sample_rate
    angle = (
        recording.condition.speed
        * (np.arange((2 + 2 * MARGIN) * turn) + shift)
        / recording.sample_rate
    )
    signal = synchronous_signal(lines[:, is_resolved], orders[is_resolved], angle)
    return band_limited(signal, recording.sample_rate, *band)[
        :, MARGIN * turn : (2 + MARGIN) * turn
    ]
