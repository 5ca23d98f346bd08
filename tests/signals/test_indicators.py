"""Indicators against signals whose values are known, and against SciPy."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import scipy.signal
import scipy.stats
from hypothesis import given, settings
from hypothesis import strategies as st
from pump_signals import RATE, TIME, pump

from swashtwin.foundation import DataError, InputError
from swashtwin.recordings import Recording
from swashtwin.signals import (
    Band,
    defect_orders,
    indicator_table,
    indicators_of,
    specified_angle,
    spectrum_of,
    stack_tables,
)
from swashtwin.signals.band_powers import band_rms
from swashtwin.signals.envelope import envelope_spectrum
from swashtwin.signals.kurtogram import Kurtogram, kurtograms
from swashtwin.signals.waveform_statistics import (
    TIME_STATISTICS,
    recording_statistics,
    time_statistics,
)


def kurtogram(signal: np.ndarray, **options: float) -> Kurtogram:
    """Return the kurtogram of one channel."""
    return kurtograms(signal[None], RATE, **options)[0]


def bursts(
    every: float = 1 / 40, ring: float = 3000.0, noise: float = 0.2, seed: int = 0
) -> np.ndarray:
    """Return decaying ringing at `ring` [Hz], excited once in `every` [s], in white noise."""
    rng = np.random.default_rng(seed)
    strikes = np.zeros(len(TIME))
    strikes[(np.arange(0, TIME[-1], every) * RATE).astype(int)] = 1
    fade = np.exp(-TIME[:200] * 600) * np.sin(2 * np.pi * ring * TIME[:200])
    return np.convolve(strikes, fade)[: len(TIME)] + noise * rng.standard_normal(len(TIME))


@given(
    frequency=st.floats(11, 900),
    amplitude=st.floats(1e-3, 1e3),
    phase=st.floats(0, 6.3),
    offset=st.floats(-50, 50),
)
@settings(max_examples=30, deadline=None)
def test_the_velocity_of_a_sine_is_its_amplitude_over_its_angular_frequency(
    frequency: float, amplitude: float, phase: float, offset: float
) -> None:
    signal = amplitude * (offset + np.sin(2 * np.pi * frequency * TIME + phase))
    expected = amplitude / (2 * np.pi * frequency) / math.sqrt(2)

    assert band_rms(signal[None], RATE, 10, 1000, of_velocity=True)[0] == pytest.approx(
        expected, rel=0.02 if frequency < 13 else 0.004
    )


WHITE_NOISE = np.random.default_rng(1).standard_normal((2, len(TIME)))


def test_the_energies_of_bands_that_share_an_edge_add_up_to_the_whole() -> None:
    # one of the edges is between two lines of the spectrum
    bands = [(0, 123.4), (123.4, 2000), (2000, 5000)]

    energies = [band_rms(WHITE_NOISE, RATE, low, high) ** 2 for low, high in bands]

    assert np.sum(energies, axis=0) == pytest.approx(band_rms(WHITE_NOISE, RATE, 0, 5000) ** 2)


def test_the_rms_of_a_band_of_white_noise_is_its_share_of_the_bandwidth() -> None:
    whole = band_rms(WHITE_NOISE, RATE, 0, 5000)
    fifth = band_rms(WHITE_NOISE, RATE, 1000, 2000)

    assert whole == pytest.approx(WHITE_NOISE.std(axis=1), rel=0.02)
    assert fifth == pytest.approx([math.sqrt(0.2)] * 2, rel=0.05)


def test_the_kurtogram_of_noise_scatters_about_zero_with_its_deviation() -> None:
    scores = []
    for seed in range(4):
        result = kurtogram(np.random.default_rng(seed).standard_normal(40000))
        inner = (result.low > 0) & (result.high < RATE / 2)
        scores.append((result.kurtosis / result.deviation)[inner])

    scores = np.concatenate(scores)
    assert abs(scores.mean()) < 0.25
    assert 0.8 < scores.std() < 1.5


def test_the_kurtosis_of_a_sine_is_minus_one() -> None:
    # Its envelope is constant.
    sine = np.sin(2 * np.pi * 1100 * TIME)

    assert kurtogram(sine).kurtosis[0] == pytest.approx(-1, abs=0.01)


def test_the_kurtosis_is_that_of_the_analytic_signal() -> None:
    signal = bursts()

    # without the ends, at which the transform is inaccurate
    power = np.abs(scipy.signal.hilbert(signal - signal.mean()))[40:-40] ** 2
    expected = (power**2).mean() / power.mean() ** 2 - 2

    assert kurtogram(signal).kurtosis[0] == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("ring", [1200.0, 3000.0, 4300.0])
def test_the_kurtogram_finds_the_band_that_rings(ring: float) -> None:
    result = kurtogram(bursts(ring=ring))
    low, high = result.band

    assert low - 200 < ring < high + 200
    assert high - low < 2000


def test_a_kurtogram_keeps_bands_that_are_wide_enough() -> None:
    result = kurtogram(bursts(), min_bandwidth=600.0)

    # 5 kHz, halved three times
    assert (result.high - result.low).min() == pytest.approx(625)


def test_a_constant_signal_has_no_kurtogram() -> None:
    with pytest.raises(InputError, match="kurtogram"):
        kurtogram(np.ones(1000))


def test_statistics_of_blocks_are_the_time_statistics() -> None:
    signal = bursts()[None]
    values = recording_statistics(Recording(signal + 5, RATE, "a"))
    whole = dict(zip(TIME_STATISTICS, time_statistics(signal - signal.mean())[0], strict=True))

    assert {name: value[0] for name, value in values.items()} == pytest.approx(
        {name: whole[name] for name in values}
    )


def test_the_automatic_envelope_shows_the_frequency_of_the_impacts() -> None:
    frequency, amplitude, _ = envelope_spectrum(bursts(noise=0.1)[None], RATE)
    low = frequency < 300
    assert frequency[low][amplitude[0, low].argmax()] == pytest.approx(40, abs=0.3)


def test_a_table_has_the_statistics_of_scipy_for_each_channel() -> None:
    recording = pump()
    signal = recording.signal - recording.signal.mean(axis=1, keepdims=True)
    rms = signal.std(axis=1)
    peak = np.abs(signal).max(axis=1)
    kurtosis = scipy.stats.kurtosis(signal, axis=1, fisher=False)
    skewness = scipy.stats.skew(signal, axis=1)

    table = indicators_of(recording, pistons=7)

    assert table.column("rms")[1] == pytest.approx(rms)
    assert table.column("peak")[1] == pytest.approx(peak)
    assert table.column("crest_factor")[1] == pytest.approx(peak / rms)
    assert table.column("kurtosis")[1] == pytest.approx(kurtosis)
    assert table.column("skewness")[1] == pytest.approx(skewness)


# the lines of `pump`: of the shaft, of the pistons and its double
@pytest.mark.parametrize(("order", "amplitude"), [(1, 0.3), (7, 1.0), (14, 0.4)])
def test_a_table_has_the_amplitudes_of_lines(order: int, amplitude: float) -> None:
    table = indicators_of(pump(), pistons=7)

    amplitudes = table.column(f"order_amplitude {order}x")[1]
    assert amplitudes == pytest.approx([amplitude] * 2, rel=0.02)


def test_a_table_has_units_and_gaps_for_bands_above_half_the_rate() -> None:
    table = indicators_of(pump(), pistons=7)

    assert [indicator.unit for indicator in table.columns[:3]] == ["m/s^2", "m/s^2", ""]
    assert np.isnan(table.column("band_rms 5000-10000 Hz")[1]).all()


def test_lines_along_an_angle_keep_their_amplitude() -> None:
    table = indicators_of(pump(), pistons=7, angle=specified_angle(pump()), families=("orders",))
    assert table.column("order_amplitude 7x")[1] == pytest.approx([1, 1], rel=0.02)


AROUND_THE_SHAFT = Band(0.5, 1.5, in_orders=True)


def test_a_band_in_orders_follows_the_speed() -> None:
    table = indicators_of(pump(), bands=(AROUND_THE_SHAFT,), families=("bands",))

    rms = table.column("band_rms 0.5-1.5x")[1]
    assert rms == pytest.approx([0.3 / math.sqrt(2)] * 2, rel=0.02)


def test_a_band_in_orders_is_left_out_without_a_speed() -> None:
    recording = replace(pump(), condition=None)

    table = indicators_of(recording, bands=(AROUND_THE_SHAFT,), families=("bands",))

    assert table.values.shape == (2, 0)


def test_a_short_recording_has_gaps_and_no_error() -> None:
    recording = replace(pump(), signal=pump().signal[:, :900])
    table = indicators_of(recording, pistons=7)

    assert np.isnan(table.column("velocity_rms")[1]).all()
    assert np.isnan(table.column("order_amplitude 7x")[1]).all()
    assert np.isfinite(table.column("rms")[1]).all()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        pytest.param({"families": ("speed",)}, "no family of indicators 'speed'", id="family"),
        pytest.param({"pistons": 0}, "pistons", id="pistons"),
    ],
)
def test_an_invalid_option_of_indicators_is_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        indicators_of(pump(), **options)


def test_an_unknown_indicator_is_refused() -> None:
    with pytest.raises(InputError, match="no indicator 'rsm'"):
        indicators_of(pump()).column("rsm")


def test_a_table_becomes_a_data_frame_with_units() -> None:
    pytest.importorskip("pandas")
    table = indicators_of(pump(), families=("statistics",))
    frame = table.to_pandas()

    assert frame.channel.tolist() == list(pump().channels)
    assert frame.rms.tolist() == table.column("rms")[1].tolist()
    assert frame.attrs["units"]["rms"] == pump().unit


def test_a_table_of_no_recording_is_refused() -> None:
    with pytest.raises(DataError, match="No recording"):
        stack_tables([])


@pytest.mark.parametrize(("kind", "position"), [("amplitude", 105.0), ("order", 7.0)])
def test_the_piston_line_is_at_its_mark(kind: str, position: float) -> None:
    spectrum = spectrum_of(pump(), kind, pistons=7)  # type: ignore[arg-type]
    assert spectrum.position[spectrum.amplitude[0].argmax()] == pytest.approx(position, rel=0.002)
    assert spectrum.amplitude[0].max() == pytest.approx(1, rel=0.05)
    assert [mark.name for mark in spectrum.marks] == [
        "1x",
        "2x",
        "7x",
        "14x",
        "21x",
        "28x",
        "35x",
    ]
    assert spectrum.marks[2].position == pytest.approx(position)


@pytest.mark.parametrize(
    "band",
    [
        pytest.param((1000.0, 99_000.0), id="above half the rate"),
        pytest.param((3000.0, 2000.0), id="edges exchanged"),
        pytest.param((-5.0, 100.0), id="below zero"),
    ],
)
def test_an_envelope_band_outside_zero_to_half_the_sample_rate_is_refused(
    band: tuple[float, float],
) -> None:
    with pytest.raises(InputError, match="half the sample rate"):
        spectrum_of(pump(), "envelope", band=band)


def test_the_statistics_of_a_long_recording_in_stretches_are_those_of_all_samples(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    time = np.arange(200_000) / RATE
    noise = np.random.default_rng(0).standard_normal((2, time.size))
    signal = noise + 0.5 * np.sin(2 * np.pi * 25 * time)
    recording = Recording(signal, RATE, "long", ("x", "y"), attributes={"speed": "1500 rpm"})
    whole = indicators_of(recording, pistons=9)

    monkeypatch.setattr(indicator_table, "MAX_SAMPLES", 100_000)
    monkeypatch.setattr(indicator_table, "STRETCH_SAMPLES", 60_000)
    parts = indicator_table.summarize_long_recording(
        recording, lambda part: indicators_of(part, pistons=9)
    )

    # as text, because the unknown pressure is NaN
    assert str(parts.rows) == str(whole.rows)
    assert parts.columns == whole.columns
    for name in ("rms", "peak", "crest_factor", "kurtosis", "skewness"):
        assert parts.column(name)[1] == pytest.approx(whole.column(name)[1], rel=1e-9)

    # the others are means over stretches of the recording
    for name in ("velocity_rms", "band_rms 10-1000 Hz", "order_amplitude 1x"):
        assert parts.column(name)[1] == pytest.approx(whole.column(name)[1], rel=0.05)


def test_the_defect_orders_are_those_of_the_maker() -> None:
    # CWRU's page, drive end (SKF 6205) and fan end (SKF 6203)
    assert defect_orders(9, 0.3126 / 1.537) == pytest.approx(
        (5.4152, 3.5848, 4.7135, 0.39828), rel=1e-4
    )
    assert defect_orders(8, 0.2656 / 1.122) == pytest.approx(
        (4.9469, 3.0530, 3.9874, 0.3817), rel=2e-4
    )


def test_a_contact_angle_slows_the_ball_less_than_the_other_rhythms() -> None:
    assert defect_orders(8, 0.3, math.radians(40)).ball == pytest.approx(3.157, rel=1e-3)


@pytest.mark.parametrize(("bodies", "ratio"), [(2, 0.2), (9, 0.0), (9, 1.2)])
def test_an_impossible_bearing_is_refused(bodies: int, ratio: float) -> None:
    with pytest.raises(InputError, match="bearing"):
        defect_orders(bodies, ratio)
