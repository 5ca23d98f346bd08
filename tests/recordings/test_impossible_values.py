"""Samples that no sensor measured are found by the inspection and by the watch alike."""

from pathlib import Path

import numpy as np
import pytest

from swashtwin.diagnosis import AnomalyDetector
from swashtwin.foundation import DataError
from swashtwin.monitoring.alarms.sensors import check_sensors
from swashtwin.recordings import Finding, Recording, inspect_recordings, load_recording
from swashtwin.recordings.channel_checks import require_usable

CASES = Path(__file__).parent / "cases"
RATE = 10_000.0
N_SAMPLES = 20_000
TIME = np.arange(N_SAMPLES) / RATE


def vibration(seed: int = 0) -> np.ndarray:
    noise = np.random.default_rng(seed).standard_normal(N_SAMPLES)
    return 2 * np.sin(2 * np.pi * 143.3 * TIME) + 0.5 * noise


def recording_of(signal: np.ndarray) -> Recording:
    return Recording(signal=signal[None], sample_rate=RATE, recording_id="r", label="normal")


def findings_of(recording: Recording) -> dict[str, Finding]:
    (report,) = inspect_recordings([recording]).recordings
    return {finding.kind: finding for finding in report.findings}


def overwritten(numbers: list[int], value: float, gain: float = 1.0) -> np.ndarray:
    signal = gain * vibration()
    signal[numbers] = value
    return signal


# ---- marks of missing values


@pytest.mark.parametrize(
    ("file", "message"),
    [
        ("K09-sentinel.csv", "3 of 2000 samples are exactly -98056.7 m/s^2 (-9999 in the file)"),
        ("K09-p32767.csv", "2 of 1999 samples are exactly 321335 m/s^2 (32767 in the file)"),
    ],
)
def test_a_file_with_marks_of_missing_values_is_refused_with_the_mark(
    file: str, message: str
) -> None:
    recording = load_recording(CASES / file)

    finding = findings_of(recording)["missing"]

    assert finding.severity == "error"
    assert message in finding.message
    with pytest.raises(DataError, match="a mark of missing values"):
        require_usable(recording)
    assert [sensor.kind for sensor in check_sensors(recording)] == ["spikes"]


@pytest.mark.parametrize(
    ("numbers", "value", "gain"),
    [
        ([7, 300, 301, 302, 9000], -9999.0, 1.0),
        ([40, 41], 1e6, 1.0),
        ([5, 5000], -32768.0, 1.0),
        # In m/s^2, beside a strong vibration.
        ([5, 77, 4000], -999.0, 10.0),
        # A third of the samples.
        (np.flatnonzero(np.random.default_rng(1).random(N_SAMPLES) < 0.3).tolist(), 9999.0, 1.0),
    ],
)
def test_one_value_far_from_all_others_marks_missing_values(
    numbers: list[int], value: float, gain: float
) -> None:
    recording = recording_of(overwritten(numbers, value, gain))

    assert f"{len(numbers)} of {N_SAMPLES}" in findings_of(recording)["missing"].message
    assert [sensor.kind for sensor in check_sensors(recording)] == ["spikes"]


def test_a_mark_among_samples_that_are_mostly_zero_is_found() -> None:
    signal = np.round(0.3 * vibration())
    signal[[11, 470, 9000]] = 32767

    assert "missing" in findings_of(recording_of(signal))


@pytest.mark.parametrize("value", [-9999.0, 999.0, -99999.0])
@pytest.mark.parametrize("factor", [1.0, 9.80665, 1e-3])
def test_one_number_of_nines_in_the_file_marks_a_missing_value(
    value: float, factor: float, tmp_path: Path
) -> None:
    signal = vibration()
    signal[500] = value
    (tmp_path / "a.csv").write_text("acc\n" + "\n".join(map(repr, signal.tolist())))
    unit = {1.0: "m/s^2", 9.80665: "g", 1e-3: "mm/s^2"}[factor]

    recording = load_recording(tmp_path / "a.csv", sample_rate=RATE, unit=unit)

    finding = findings_of(recording)["missing"]
    assert f"1 of {N_SAMPLES} samples is exactly" in finding.message
    assert "spikes" not in findings_of(recording)
    with pytest.raises(DataError, match="a mark of missing values"):
        require_usable(recording)
    (sensor,) = check_sensors(recording)
    assert f": {value * factor:.6g}, a mark of missing values" in sensor.sentence


def test_pulses_between_two_levels_are_named_for_what_they_are() -> None:
    signal = np.where(np.arange(N_SAMPLES) % 303 < 9, 5.0, 0.0)

    finding = findings_of(recording_of(signal))["two_levels"]

    assert finding.severity == "warning"
    assert "two levels only, 0 and 5 m/s^2: the pulses of a tachometer" in finding.message


def test_a_mark_among_pulses_is_found() -> None:
    signal = np.where(np.arange(N_SAMPLES) % 303 < 9, 1.0, 0.0)
    signal[[400, 7000, 7013]] = -9999

    assert "missing" in findings_of(recording_of(signal))


# ---- spikes


@pytest.mark.parametrize(
    "signal",
    [
        pytest.param(overwritten([500], 1500.0), id="one"),
        pytest.param(overwritten([500], -200.0), id="a hundred times"),
        pytest.param(
            np.where(np.arange(N_SAMPLES) % 1777 == 5, 900 + 400 * vibration(2), vibration()),
            id="of several heights",
        ),
    ],
)
def test_single_samples_beyond_a_gap_are_spikes(signal: np.ndarray) -> None:
    recording = recording_of(signal)

    assert findings_of(recording)["spikes"].severity == "warning"
    assert [sensor.kind for sensor in check_sensors(recording)] == ["spikes"]


def impacts(decay_samples: float, frequency: float) -> np.ndarray:
    """Return hits of very different strength that ring, in weak noise."""
    generator = np.random.default_rng(3)
    hits = np.zeros(N_SAMPLES)
    hits[generator.integers(0, N_SAMPLES, 20)] = 3 * generator.exponential(size=20)
    lag = np.arange(400)
    ringing = np.exp(-lag / decay_samples) * np.sin(frequency * lag + 0.3)
    noise = 0.003 * generator.standard_normal(N_SAMPLES)
    return np.asarray(np.convolve(hits, ringing)[:N_SAMPLES] + noise)


def pulses(share: float) -> np.ndarray:
    """Return the signal of a tachometer at 33 Hz with weak noise."""
    noise = 0.01 * np.random.default_rng(4).standard_normal(N_SAMPLES)
    return np.asarray(5.0 * np.less((33 * TIME) % 1, share) + noise)


@pytest.mark.parametrize(
    "signal",
    [
        pytest.param(vibration(), id="vibration"),
        pytest.param(np.random.default_rng(5).laplace(size=N_SAMPLES), id="heavy tails"),
        pytest.param(impacts(40, 1.1), id="impacts"),
        pytest.param(impacts(2, 2.9), id="short impacts"),
        pytest.param(np.round(20 * impacts(40, 1.1)), id="impacts in few counts"),
        pytest.param(np.round(100 * impacts(2, 2.9)), id="short impacts in few counts"),
        pytest.param(np.clip(3 * vibration(), -4, 4), id="clipped"),
        pytest.param(pulses(0.5), id="square wave"),
        pytest.param(np.round(vibration() * 3) / 3, id="coarse converter"),
        pytest.param(np.round(1000 * vibration()), id="counts"),
        pytest.param(np.round(0.3 * vibration()), id="few counts"),
        pytest.param(np.where(np.arange(N_SAMPLES) % 303 < 9, 5.0, 0.0), id="digital tachometer"),
        pytest.param(np.round(32000 * np.sin(2 * np.pi * 4833 * TIME)), id="near half the rate"),
    ],
)
def test_a_measured_signal_has_no_impossible_values(signal: np.ndarray) -> None:
    kinds = findings_of(recording_of(signal)).keys()

    assert not kinds & {"missing", "spikes", "wrapped", "made"}


def test_pulses_of_a_tachometer_mark_no_missing_values() -> None:
    assert "missing" not in findings_of(recording_of(np.clip(pulses(0.02), -1, 4.9)))


# ---- numbers that lost their sign, and samples that were made


@pytest.mark.parametrize(("bits", "amplitude"), [(16, 20.0), (16, 3000.0), (12, 300.0), (24, 1e5)])
@pytest.mark.parametrize("factor", [1.0, 6.1e-4])
def test_negative_numbers_without_their_sign_are_refused(
    bits: int, amplitude: float, factor: float
) -> None:
    counts = np.round(amplitude * vibration()).astype(int)
    recording = recording_of(factor * (counts % (1 << bits)))

    assert findings_of(recording)["wrapped"].severity == "error"
    with pytest.raises(DataError, match="stored without their sign"):
        require_usable(recording)
    assert "wrapped" not in findings_of(recording_of(factor * counts))


def test_a_file_whose_samples_are_held_is_reported() -> None:
    finding = findings_of(load_recording(CASES / "K17-held4.h5"))["made"]

    assert finding.severity == "warning"
    assert "every value stands 4 times" in finding.message


@pytest.mark.parametrize(
    ("signal", "message"),
    [
        pytest.param(np.repeat(vibration(), 2), "every value stands 2 times", id="twice"),
        pytest.param(np.repeat(vibration(), 25), "every value stands 25 times", id="25 times"),
        pytest.param(
            vibration()[(0.64 * np.arange(N_SAMPLES)).astype(int)], "1 or 2 times", id="12.8 to 20"
        ),
        pytest.param(
            np.where(np.arange(N_SAMPLES) % 3, 0, vibration()), "of 3 samples", id="zeros between"
        ),
        pytest.param(
            np.round(np.interp(np.arange(N_SAMPLES - 4) / 4, np.arange(N_SAMPLES), vibration()), 5),
            "straight lines of 4 steps",
            id="straight lines",
        ),
    ],
)
def test_samples_that_were_made_of_fewer_ones_are_reported(
    signal: np.ndarray, message: str
) -> None:
    assert message in findings_of(recording_of(signal))["made"].message


# ---- doubled channels


def two_channels(second: np.ndarray) -> Recording:
    return Recording(np.stack([vibration(), second]), RATE, "r", channels=("x", "y"))


@pytest.mark.parametrize(
    ("second", "message"),
    [
        pytest.param(vibration(), "it contains the signal of channel x: one", id="equal"),
        pytest.param(np.roll(vibration(), 1), "of channel x, 1 sample later: one", id="late"),
        pytest.param(
            -0.3 * np.roll(vibration(), 4) + 7, "of channel x, 4 samples later", id="scaled, late"
        ),
        pytest.param(
            np.round(2000 * np.roll(vibration(), 8)), "of channel x, 8 samples later", id="counts"
        ),
    ],
)
def test_a_channel_with_the_signal_of_another_one_is_reported(
    second: np.ndarray, message: str
) -> None:
    finding = findings_of(two_channels(second))["doubled"]

    assert finding.channel == "y"
    assert message in finding.message


def test_the_earlier_of_two_doubled_channels_is_the_original() -> None:
    recording = two_channels(vibration()).replace(
        signal=np.stack([np.roll(vibration(), 2), vibration()])
    )
    assert findings_of(recording)["doubled"].channel == "x"


@pytest.mark.parametrize(
    "second",
    [
        pytest.param(vibration(seed=1), id="same tone in other noise"),
        pytest.param(np.roll(vibration(), 1) + 0.05 * vibration(2), id="nearly the same"),
        pytest.param(np.roll(vibration(), 40), id="beyond the delays of a logger"),
    ],
)
def test_another_sensor_on_the_same_machine_is_not_doubled(second: np.ndarray) -> None:
    assert "doubled" not in findings_of(two_channels(second))


def test_equal_tones_without_noise_are_not_doubled() -> None:
    tones = [np.sin(2 * np.pi * 143.3 * TIME + phase) for phase in (0.0, 0.3, 1.0)]
    recording = Recording(np.stack(tones), RATE, "r", channels=("x", "y", "z"))
    assert "doubled" not in findings_of(recording)


# ---- diagnosis


def test_a_diagnosis_notes_spikes_and_has_no_verdict_on_marked_samples() -> None:
    healthy = [recording_of(vibration(seed)).replace(recording_id=f"r{seed}") for seed in range(12)]
    detector = AnomalyDetector().fit(healthy)

    spiky = detector.diagnose(recording_of(overwritten([500], 1500.0)))
    marked = detector.diagnose(recording_of(overwritten([500, 900], -9999.0)))

    assert any("spikes" in note for note in spiky.notes)
    assert marked.no_verdict is not None
    assert "mark of missing values" in marked.no_verdict


@pytest.mark.parametrize(
    ("second", "note"),
    [
        pytest.param(np.roll(vibration(50), 1), "contains the signal of channel x", id="doubled"),
        pytest.param(np.clip(vibration(51), -1, 1), "the range was exceeded", id="clipped"),
        pytest.param(
            np.where(TIME < 0.2, 0.0, vibration(51)), "flat stretches", id="without a signal"
        ),
    ],
)
def test_a_diagnosis_notes_what_the_inspection_warns_of(second: np.ndarray, note: str) -> None:
    healthy = [
        Recording(
            np.stack([vibration(seed), vibration(100 + seed)]),
            RATE,
            f"r{seed}",
            channels=("x", "y"),
        )
        for seed in range(12)
    ]
    detector = AnomalyDetector().fit(healthy)
    recording = Recording(np.stack([vibration(50), second]), RATE, "new", channels=("x", "y"))

    assert any(note in text for text in detector.diagnose(recording).notes)
