"""Recordings and settings that a calibration must not take: each ends in one line with file, value
and fix.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from twin_recordings import SIX_VALUES, recording_of

from swashtwin.calibration import GaussNewton, calibrate, measure
from swashtwin.calibration.speed_detection import detect_speed
from swashtwin.foundation import DataError, MPa, UnitError, um
from swashtwin.physics import Twin
from swashtwin.pump import CLASSES, OperatingCondition, PistonWear, Pump
from swashtwin.recordings import Recording
from swashtwin_bench import rig_recordings
from swashtwin_bench.rigs.writing import RigSize

QUICK = GaussNewton(starts=1, max_iterations=2)


@pytest.fixture(scope="module")
def recording(twin: Twin) -> Recording:
    return recording_of(twin)


@pytest.fixture(scope="module")
def rig() -> list[Recording]:
    """One specimen, all classes, 5, 10 and 15 MPa, of two fleets on which nothing was chosen; three
    repeats and one.
    """
    sizes = {
        seed: RigSize(specimens=1, repeats=repeats, duration=1.3)
        for seed, repeats in ((7, 3), (8, 1))
    }
    return [
        recording for seed, size in sizes.items() for recording, _ in rig_recordings(seed, size)
    ]


def stated_at(recording: Recording, factor: float) -> Recording:
    """The recording with its speed stated `factor` times as high."""
    assert recording.condition is not None
    return replace(
        recording, condition=recording.condition.replace(speed=factor * recording.condition.speed)
    )


def missing(signal: np.ndarray) -> np.ndarray:
    return np.where(np.arange(signal.shape[1]) == 100, [[0], [np.nan], [0]], 0) + signal


def clipped(signal: np.ndarray) -> np.ndarray:
    limit = np.quantile(np.abs(signal), 0.9, axis=1)[:, None]
    return np.clip(signal, -limit, limit)


def noise(signal: np.ndarray) -> np.ndarray:
    return 1e-3 * np.random.default_rng(1).standard_normal(signal.shape)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            lambda signal: signal[:, :4480],
            r"rec-0 \(0.7 s\): the signal covers 10.0 revolutions; its orders need",
        ),
        (lambda signal: signal[:, :300], "shorter than one revolution"),
        (missing, r"rec-0, body_y: 1 of \d+ samples are missing"),
        (
            clipped,
            r"rec-0, cover_z: \d\.\d+% of the samples are clipped at the extreme value .* wider range",
        ),
        (noise, "rec-0: no line exceeds the noise .* the pump was running"),
        (np.zeros_like, "every sample is 0: a dead"),
    ],
)
def test_an_unfit_signal_is_refused_in_one_line(
    twin: Twin, recording: Recording, change: Callable[[np.ndarray], np.ndarray], words: str
) -> None:
    with pytest.raises(DataError, match=words) as caught:
        measure(twin, [replace(recording, signal=change(recording.signal))])
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            {"channels": ("cover_z", "ch2", "body_x")},
            "no sensor for channel 'ch2', only cover_z, body_y, body_x",
        ),
        ({"unit": "V"}, r"rec-0 is in 'V', but a calibration needs m/s\^2. Specify unit"),
        ({"sample_rate": 6600.0}, "or the sample rate of 6600 Hz"),
    ],
)
def test_stated_facts_that_do_not_fit_are_refused(
    twin: Twin, recording: Recording, change: dict[str, Any], words: str
) -> None:
    with pytest.raises((DataError, UnitError), match=words):
        measure(twin, [replace(recording, **change)])


@pytest.mark.parametrize("factor", [0.5, 0.667, 0.9, 0.97, 1.03, 1.1, 1.5, 2.0])
def test_a_recording_of_another_speed_than_stated_is_refused_with_both_numbers(
    twin: Twin, recording: Recording, factor: float
) -> None:
    wrong = stated_at(recording, factor)
    assert wrong.condition is not None
    there = twin.at(wrong.condition)
    with pytest.raises(
        DataError,
        match=rf"rec-0: the specified speed is {860 * factor:.4g} rev/min, .* 7 pistons at (\d+)",
    ) as hit:
        measure(there, [wrong])
    shown = float(str(hit.value).split("7 pistons at ")[1].split(" rev")[0])
    assert shown == pytest.approx(860, rel=0.01)


def test_no_class_and_no_pressure_of_the_rig_raises_a_false_alarm(rig: list[Recording]) -> None:
    assert {recording.label for recording in rig} == set(CLASSES)
    for recording in rig:
        assert recording.condition is not None
        speed = detect_speed(recording, recording.condition.shaft_frequency, 7)
        assert not speed.contradicts, recording.recording_id
        assert speed.specified_contrast > 0.85 * speed.detected_contrast
        assert speed.detected == pytest.approx(speed.specified, rel=0.01)


@pytest.mark.parametrize("factor", [0.5, 0.9, 0.97, 1.03, 1.1, 1.5])
def test_every_wrongly_stated_speed_is_detected_on_the_rig(
    rig: list[Recording], factor: float
) -> None:
    for recording in rig[::3]:
        assert recording.condition is not None
        speed = detect_speed(recording, factor * recording.condition.shaft_frequency, 7)
        assert speed.contradicts, recording.recording_id
        assert speed.detected == pytest.approx(recording.condition.shaft_frequency, rel=0.01)


def test_lines_that_show_nothing_clearly_contradict_no_speed(recording: Recording) -> None:
    generator = np.random.default_rng(0)
    noise = replace(recording, signal=generator.standard_normal(recording.signal.shape))
    assert not detect_speed(noise, 14.3, 7).contradicts
    quiet = replace(recording, signal=recording.signal / recording.signal.std() + 30 * noise.signal)
    assert not detect_speed(quiet, 7.0, 7).contradicts


def test_a_speed_that_was_measured_along_is_believed(twin: Twin, recording: Recording) -> None:
    wrong = stated_at(recording, 1.1)
    assert wrong.condition is not None
    with_tachometer = replace(wrong, speed=np.full(wrong.signal.shape[1], wrong.condition.speed))
    with pytest.raises(DataError, match="the specified speed is"):
        measure(twin.at(wrong.condition), [wrong])
    assert measure(twin.at(wrong.condition), [with_tachometer]).recording_ids == ("rec-0",)


def test_a_recording_of_another_pressure_than_its_siblings_is_noted(
    pump: Pump, rig: list[Recording]
) -> None:
    of_pump = [recording for recording in rig[:45] if recording.label == "normal"]
    at = {
        level: [
            recording
            for recording in of_pump
            if recording.condition.discharge_pressure == MPa(level)
        ]
        for level in (5, 15)
    }  # type: ignore[union-attr]
    twin = Twin(pump, at[15][0].condition, bandwidth=2600)  # type: ignore[arg-type]
    odd = replace(at[5][0], recording_id="odd", condition=at[15][0].condition)
    assert measure(twin, at[15]).notes == ()
    (note,) = measure(twin, [*at[15], odd]).notes
    assert note.startswith("odd: its lines are 0.")
    assert "3 other recordings specified at 15 MPa. Check its pressure" in note
    alone = measure(twin, [odd])
    assert alone.notes == ()  # one recording alone tells nothing of its pressure
    calibration = calibrate(twin, [*at[15], odd], method=QUICK, **SIX_VALUES)
    assert note in calibration.notes


def test_a_few_cut_peaks_are_noted(twin: Twin, recording: Recording) -> None:
    limit = np.quantile(np.abs(recording.signal), 0.998, axis=1)[:, None]
    notes = measure(
        twin, [replace(recording, signal=np.clip(recording.signal, -limit, limit))]
    ).notes
    assert len(notes) <= 1
    crest = np.where(
        np.abs(recording.signal) == np.abs(recording.signal).max(), 0.0, recording.signal
    )
    crest[:, 100:110] = crest.max() * 1.2
    (note,) = measure(twin, [replace(recording, signal=crest)]).notes
    assert "exceeded the measuring range" in note


def test_shaft_orders_are_compared_where_one_piston_differs(
    pump: Pump, at_15: OperatingCondition
) -> None:
    worn = Twin(pump, at_15, PistonWear(clearance=um(60), piston=1), bandwidth=2600)
    recording = recording_of(worn, np.array([1, 1, 1.6, 0.7, 2.5, 1]))
    every = measure(worn, [recording], lines="shaft")
    assert every.orders.tolist() == list(range(1, 76))
    passing = measure(worn, [recording])
    common = np.isin(every.orders, passing.orders)
    lines = passing.amplitude[:, passing.orders <= 75]
    np.testing.assert_allclose(every.amplitude[:, common], lines, atol=0.03 * lines.max())
    between = every.amplitude[:, ~common]
    assert between.max() > 0.02 * lines.max()
    calibration = calibrate(
        worn, [recording], method=GaussNewton(starts=1), lines="shaft", **SIX_VALUES
    )
    assert calibration.settings["lines"] == "shaft"
    assert calibration.fits[0].spectra.orders.tolist() == every.orders.tolist()
    assert (
        calibration.calibrated_agreement.spectrum_value_error
        < 0.5 * calibration.nominal_agreement.spectrum_value_error
    )


def test_the_whole_spectrum_counts_what_no_value_changes(twin: Twin, recording: Recording) -> None:
    method = GaussNewton(starts=1)
    whole = calibrate(twin, [recording], method=method, lines="spectrum", **SIX_VALUES)
    lines = calibrate(twin, [recording], method=method, **SIX_VALUES)
    assert whole.fits[0].spectra.orders.tolist() == list(range(1, 175))
    np.testing.assert_allclose(whole.twin.values, lines.twin.values, rtol=0.1)
