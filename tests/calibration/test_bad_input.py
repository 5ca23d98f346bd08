"""Recordings that a calibration refuses or remarks on: each message gives file, value and fix."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from twin_recordings import SIX_VALUES, recording_of

from swashtwin.calibration import GaussNewton, calibrate, measure
from swashtwin.calibration.speed_detection import detect_speed, require_piston_count
from swashtwin.foundation import DataError, InputError, MPa, UnitError, um
from swashtwin.physics import Twin
from swashtwin.pump import CLASSES, OperatingCondition, PistonWear, Pump
from swashtwin.recordings import Recording
from swashtwin_bench import rig_recordings
from swashtwin_bench.questions.twin_matrix import with_piston_count
from swashtwin_bench.rigs.writing import RigSize

QUICK = GaussNewton(starts=1, max_iterations=2)


@pytest.fixture(scope="module")
def recording(twin: Twin) -> Recording:
    return recording_of(twin)


@pytest.fixture(scope="module")
def rig() -> list[Recording]:
    """All classes of one specimen at 5, 10 and 15 MPa, of two fleets; three repeats and one.

    No setting of the detection of speed was chosen on these fleets.
    """
    repeats_by_seed = {7: 3, 8: 1}
    recordings: list[Recording] = []
    for seed, repeats in repeats_by_seed.items():
        size = RigSize(specimens=1, repeats=repeats, duration=1.3)
        recordings += [recording for recording, _ in rig_recordings(seed, size)]
    return recordings


def condition_of(recording: Recording) -> OperatingCondition:
    assert recording.condition is not None
    return recording.condition


def with_speed_factor(recording: Recording, factor: float) -> Recording:
    """The recording with its speed specified `factor` times as high."""
    condition = condition_of(recording)
    return replace(recording, condition=condition.replace(speed=factor * condition.speed))


def with_missing_sample(signal: np.ndarray) -> np.ndarray:
    incomplete = signal.copy()
    incomplete[1, 100] = np.nan
    return incomplete


def clipped(signal: np.ndarray) -> np.ndarray:
    limit = np.quantile(np.abs(signal), 0.9, axis=1)[:, None]
    return np.clip(signal, -limit, limit)


def silent(signal: np.ndarray) -> np.ndarray:
    return 1e-3 * np.random.default_rng(1).standard_normal(signal.shape)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda signal: signal[:, :4480],
            r"rec-0 \(0.7 s\): the signal covers 10.0 revolutions; its orders need",
        ),
        (lambda signal: signal[:, :300], "shorter than one revolution"),
        (with_missing_sample, r"rec-0, body_y: 1 of \d+ samples are missing"),
        (
            clipped,
            r"rec-0, cover_z: \d\.\d+% of the samples are clipped at the extreme value .* wider range",
        ),
        (silent, "rec-0: no line exceeds the noise .* the pump was running"),
        (np.zeros_like, "every sample is 0: a dead"),
    ],
    ids=["10 turns", "part of a turn", "missing sample", "clipped", "pump off", "dead channel"],
)
def test_an_unusable_signal_is_refused_in_one_line(
    twin: Twin, recording: Recording, change: Callable[[np.ndarray], np.ndarray], message: str
) -> None:
    unusable = replace(recording, signal=change(recording.signal))
    with pytest.raises(DataError, match=message) as error:
        measure(twin, [unusable])
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"channels": ("cover_z", "ch2", "body_x")},
            "no sensor for channel 'ch2', only cover_z, body_y, body_x",
        ),
        ({"unit": "V"}, r"rec-0 is in 'V', but a calibration needs m/s\^2. Specify unit"),
        ({"sample_rate": 6600.0}, "or the sample rate of 6600 Hz"),
    ],
    ids=["channel", "unit", "sample rate"],
)
def test_specified_properties_that_do_not_fit_are_refused(
    twin: Twin, recording: Recording, change: dict[str, Any], message: str
) -> None:
    with pytest.raises((DataError, UnitError), match=message):
        measure(twin, [replace(recording, **change)])


@pytest.mark.parametrize("factor", [0.5, 0.667, 0.9, 0.97, 1.03, 1.1, 1.5, 2.0])
def test_a_wrongly_specified_speed_is_refused_with_the_detected_speed(
    twin: Twin, recording: Recording, factor: float
) -> None:
    wrong = with_speed_factor(recording, factor)
    twin_at_wrong_speed = twin.at(condition_of(wrong))
    message = rf"rec-0: the specified speed is {860 * factor:.4g} rev/min, .* 7 pistons at (\d+)"
    with pytest.raises(DataError, match=message) as error:
        measure(twin_at_wrong_speed, [wrong])

    detected_rpm = float(str(error.value).split("7 pistons at ")[1].split(" rev")[0])
    assert detected_rpm == pytest.approx(860, rel=0.01)


def test_a_wrong_piston_count_is_named_beside_a_wrong_speed(
    twin: Twin, recording: Recording
) -> None:
    nine_pistons = replace(twin, pump=with_piston_count(twin.pump, 9))
    message = "9 pistons at 669 rev/min, or with 7 pistons at the specified speed"
    with pytest.raises(DataError, match=message):
        measure(nine_pistons, [recording])


def test_the_fleets_contain_every_class(rig: list[Recording]) -> None:
    assert {recording.label for recording in rig} == set(CLASSES)


def test_a_correct_speed_is_confirmed_for_every_class_and_pressure(rig: list[Recording]) -> None:
    for recording in rig:
        speed = detect_speed(recording, condition_of(recording).shaft_frequency, 7)
        assert not speed.contradicts, recording.recording_id
        assert speed.specified_contrast > 0.85 * speed.detected_contrast
        assert speed.detected == pytest.approx(speed.specified, rel=0.01)


@pytest.mark.parametrize("factor", [0.5, 0.9, 0.97, 1.03, 1.1, 1.5])
def test_every_wrongly_specified_speed_is_detected_for_every_class_and_pressure(
    rig: list[Recording], factor: float
) -> None:
    for recording in rig[::3]:  # one of the three repeats
        true_speed = condition_of(recording).shaft_frequency
        speed = detect_speed(recording, factor * true_speed, 7)
        assert speed.contradicts, recording.recording_id
        assert speed.detected == pytest.approx(true_speed, rel=0.01)


def test_lines_refuse_another_piston_count(rig: list[Recording]) -> None:
    recordings = [recording for recording in rig if recording.label == "normal"]
    require_piston_count(recordings, 7, remedy="")
    for wrong_count in (5, 9, 11):
        message = f"of a pump with 7 pistons at the specified speed, not of one with {wrong_count}"
        with pytest.raises(InputError, match=message):
            require_piston_count(recordings, wrong_count, remedy="")


def test_hidden_lines_and_short_recordings_refuse_no_piston_count(recording: Recording) -> None:
    noise = np.random.default_rng(0).standard_normal(recording.signal.shape)
    hidden = replace(recording, signal=noise)
    half_a_second = round(0.5 * recording.sample_rate)
    short = replace(recording, signal=recording.signal[:, :half_a_second])
    signal = recording.signal.copy()
    signal[0, 5] = np.nan
    not_finite = replace(recording, signal=signal)
    for unclear in (hidden, short, not_finite):
        require_piston_count([unclear], 9, remedy="")


def test_lines_hidden_by_noise_contradict_no_speed(recording: Recording) -> None:
    noise = np.random.default_rng(0).standard_normal(recording.signal.shape)
    only_noise = replace(recording, signal=noise)
    assert not detect_speed(only_noise, 14.3, 7).contradicts

    # half of the true speed, which a clear recording contradicts
    hidden = replace(recording, signal=recording.signal / recording.signal.std() + 30 * noise)
    assert not detect_speed(hidden, 7.0, 7).contradicts


def test_a_speed_measured_with_a_tachometer_is_not_questioned(
    twin: Twin, recording: Recording
) -> None:
    wrong = with_speed_factor(recording, 1.1)
    condition = condition_of(wrong)
    twin_at_wrong_speed = twin.at(condition)
    with pytest.raises(DataError, match="the specified speed is"):
        measure(twin_at_wrong_speed, [wrong])

    with_tachometer = replace(wrong, speed=np.full(wrong.signal.shape[1], condition.speed))
    assert measure(twin_at_wrong_speed, [with_tachometer]).recording_ids == ("rec-0",)


@pytest.fixture(scope="module")
def healthy_by_pressure(rig: list[Recording]) -> dict[float, list[Recording]]:
    """Healthy recordings of the first fleet by specified pressure."""
    by_pressure: dict[float, list[Recording]] = {}
    for recording in rig[:45]:
        if recording.label == "normal":
            pressure = condition_of(recording).discharge_pressure
            by_pressure.setdefault(pressure, []).append(recording)
    return by_pressure


@pytest.fixture(scope="module")
def mislabeled(healthy_by_pressure: dict[float, list[Recording]]) -> Recording:
    """A recording at 5 MPa that is specified at 15 MPa."""
    specified = healthy_by_pressure[MPa(15)][0].condition
    return replace(healthy_by_pressure[MPa(5)][0], recording_id="mislabeled", condition=specified)


def test_a_recording_at_another_pressure_than_its_siblings_is_noted(
    pump: Pump, healthy_by_pressure: dict[float, list[Recording]], mislabeled: Recording
) -> None:
    siblings = healthy_by_pressure[MPa(15)]
    twin = Twin(pump, condition_of(siblings[0]), bandwidth=2600)
    assert measure(twin, siblings).notes == ()

    (note,) = measure(twin, [*siblings, mislabeled]).notes
    assert note.startswith("mislabeled: its lines are 0.")
    assert "3 other recordings specified at 15 MPa. Check its pressure" in note

    calibration = calibrate(twin, [*siblings, mislabeled], method=QUICK, **SIX_VALUES)
    assert note in calibration.notes


def test_the_pressure_of_a_single_recording_is_not_questioned(
    pump: Pump, mislabeled: Recording
) -> None:
    # without siblings its lines say nothing of its pressure
    twin = Twin(pump, condition_of(mislabeled), bandwidth=2600)
    assert measure(twin, [mislabeled]).notes == ()


def test_a_few_clipped_peaks_are_noted_at_most_once(twin: Twin, recording: Recording) -> None:
    limit = np.quantile(np.abs(recording.signal), 0.998, axis=1)[:, None]
    clipped_peaks = replace(recording, signal=np.clip(recording.signal, -limit, limit))
    assert len(measure(twin, [clipped_peaks]).notes) <= 1


def test_a_flat_peak_is_noted(twin: Twin, recording: Recording) -> None:
    is_highest = np.abs(recording.signal) == np.abs(recording.signal).max()
    signal = np.where(is_highest, 0.0, recording.signal)
    signal[:, 100:110] = signal.max() * 1.2

    (note,) = measure(twin, [replace(recording, signal=signal)]).notes
    assert "exceeded the measuring range" in note


@pytest.fixture(scope="module")
def worn_twin(pump: Pump, at_15: OperatingCondition) -> Twin:
    """A pump with one piston that differs: lines at every shaft order, and not only at 7, 14 ..."""
    return Twin(pump, at_15, PistonWear(clearance=um(60), piston=1), bandwidth=2600)


@pytest.fixture(scope="module")
def worn_recording(worn_twin: Twin) -> Recording:
    return recording_of(worn_twin, np.array([1, 1, 1.6, 0.7, 2.5, 1]))


def test_shaft_orders_are_measured_as_multiples_of_the_piston_frequency_are(
    worn_twin: Twin, worn_recording: Recording
) -> None:
    shaft = measure(worn_twin, [worn_recording], lines="shaft")
    piston_pass = measure(worn_twin, [worn_recording])
    assert shaft.orders.tolist() == list(range(1, 76))

    is_common = np.isin(shaft.orders, piston_pass.orders)
    lines = piston_pass.amplitude[:, piston_pass.orders <= 75]
    atol = 0.03 * lines.max()
    np.testing.assert_allclose(shaft.amplitude[:, is_common], lines, atol=atol)
    assert shaft.amplitude[:, ~is_common].max() > 0.02 * lines.max()


def test_a_calibration_on_shaft_orders_approaches_the_recording(
    worn_twin: Twin, worn_recording: Recording
) -> None:
    method = GaussNewton(starts=1)
    calibration = calibrate(worn_twin, [worn_recording], method=method, lines="shaft", **SIX_VALUES)

    assert calibration.settings["lines"] == "shaft"
    assert calibration.fits[0].spectra.orders.tolist() == list(range(1, 76))
    nominal_error = calibration.nominal_agreement.spectrum_value_error
    assert calibration.calibrated_agreement.spectrum_value_error < 0.5 * nominal_error


def test_the_whole_spectrum_gives_nearly_the_values_of_the_lines(
    twin: Twin, recording: Recording
) -> None:
    method = GaussNewton(starts=1)
    spectrum = calibrate(twin, [recording], method=method, lines="spectrum", **SIX_VALUES)
    lines = calibrate(twin, [recording], method=method, **SIX_VALUES)

    assert spectrum.fits[0].spectra.orders.tolist() == list(range(1, 175))
    # not the same: the spectrum also counts what no value changes
    np.testing.assert_allclose(spectrum.twin.values, lines.twin.values, rtol=0.1)
