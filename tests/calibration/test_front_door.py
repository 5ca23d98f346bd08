"""`calibrate` on a pump's name and recordings with operating points, without further settings."""

from dataclasses import replace

import numpy as np
import pytest
from twin_recordings import DAMPER, SIX_VALUES, recording_of

from swashtwin.calibration import Calibration, GaussNewton, calibrate
from swashtwin.foundation import DataError, InputError, MPa, mm, rpm
from swashtwin.physics import Twin
from swashtwin.pump import OperatingCondition, Pump, SwashPlateDefect
from swashtwin.recordings import Recording
from swashtwin.synthesis import synthesize

QUICK = GaussNewton(starts=1, max_iterations=4)
RECESS = SwashPlateDefect(length=mm(30), width=mm(24), depth=mm(0.6))


def healthy_recording(
    pump: Pump, pressure: float, *, speed: float = 860.0, seed: int = 0
) -> Recording:
    """Recording at `pressure` [MPa] and `speed` [rev/min] of a pump off the nominal values."""
    condition = OperatingCondition(speed=rpm(speed), discharge_pressure=MPa(pressure))
    recording = recording_of(Twin(pump, condition, bandwidth=2600), DAMPER, seed=seed)
    return replace(recording, recording_id=f"healthy-{seed}")


@pytest.fixture(scope="module")
def recordings(pump: Pump) -> list[Recording]:
    """Two recordings near 10 MPa, one at 15 MPa."""
    return [
        healthy_recording(pump, 10.0, seed=0),
        healthy_recording(pump, 15.0, seed=1),
        healthy_recording(pump, 10.2, speed=862.0, seed=2),
    ]


@pytest.fixture(scope="module")
def default_calibration(recordings: list[Recording]) -> Calibration:
    return calibrate("25scy14-1b", recordings[:1], seed=1)


def test_a_name_and_a_recording_are_enough(default_calibration: Calibration) -> None:
    true_values = default_calibration.nominal.values.numpy() * DAMPER
    for estimate, true in zip(default_calibration.estimates, true_values, strict=True):
        assert estimate.interval[0] < true < estimate.interval[1]


def test_by_default_gauss_newton_fits_phases_and_the_housing(
    default_calibration: Calibration,
) -> None:
    assert default_calibration.method == "GaussNewton"
    assert default_calibration.settings["phases"]
    # values, scales, ports, gains, crosstalk; frequencies, damping ratios and residues of two modes
    assert len(default_calibration.posterior.unknowns) == 6 + 11 + 2 + 3 + 6 + 2 + 2 + 6


def test_the_text_of_a_calibration_names_pump_method_and_identified_values(
    default_calibration: Calibration,
) -> None:
    start = "<Calibration of 25scy14-1b (normal) by GaussNewton on 1 recording; identified: "
    assert repr(default_calibration).startswith(start)


@pytest.mark.parametrize(
    ("channel", "sensor", "is_noted"),
    [("body_y", "body_y", False), ("acc", "cover_z", True)],
    ids=["sensor of the pump", "unknown sensor"],
)
def test_one_sensor_calibrates_and_makes_windows(
    recordings: list[Recording], channel: str, sensor: str, is_noted: bool
) -> None:
    recording = recordings[0].select_channels(["body_y"]).replace(channels=(channel,))

    calibration = calibrate("25scy14-1b", [recording], method=QUICK, explain_misfit=False)
    notes = " ".join(calibration.notes)
    assert ("is not a sensor of the pump" in notes) == is_noted
    assert calibration.posterior.channels == (sensor,)

    windows = synthesize(
        calibration, None, count=1, like=[recording], window=2048, background="none"
    )
    assert windows.channels == (channel,)
    assert np.isfinite(windows.signal).all()


def test_recordings_are_grouped_by_operating_point_and_fitted_together(
    recordings: list[Recording],
) -> None:
    calibration = calibrate("25scy14-1b", recordings, method=QUICK, **SIX_VALUES)

    assert calibration.excluded_recordings == ()
    # 10 and 10.2 MPa are one operating point, their mean
    assert [len(fit.recording_ids) for fit in calibration.fits] == [2, 1]
    pressures = [fit.condition.discharge_pressure for fit in calibration.fits]
    assert pressures == pytest.approx([MPa(10.1), MPa(15)])
    assert calibration.fits[0].condition.speed == pytest.approx(rpm(861))


def test_a_recording_labeled_healthy_is_calibrated_as_normal(
    pump: Pump, recordings: list[Recording]
) -> None:
    recording = recordings[0].replace(label="healthy")
    calibration = calibrate(pump, [recording], method=QUICK, **SIX_VALUES)
    assert calibration.recording_ids == ("healthy-0",)

    # its windows have the label of the recordings
    measured = replace(recording, synthetic=False)
    windows = synthesize(calibration, None, count=1, like=[measured], window=1024)
    assert windows.classes == ("healthy",)
    assert set(windows.label) == {"healthy"}


@pytest.fixture(scope="module")
def faulty_twin(pump: Pump, at_15: OperatingCondition) -> Twin:
    return Twin(pump, at_15, RECESS, bandwidth=2600)


@pytest.fixture(scope="module")
def faulty_recording(faulty_twin: Twin) -> Recording:
    return recording_of(faulty_twin)


def test_recordings_of_a_fault_are_calibrated_with_that_fault(
    pump: Pump, faulty_recording: Recording
) -> None:
    calibration = calibrate(pump, [faulty_recording], fault=RECESS, method=QUICK, **SIX_VALUES)
    assert calibration.twin.fault == RECESS


def test_recordings_of_a_fault_without_the_fault_are_refused(
    pump: Pump, faulty_recording: Recording
) -> None:
    message = r"No recording is labeled 'normal' \(labels: swash_plate\).* give fault for"
    with pytest.raises(DataError, match=message):
        calibrate(pump, [faulty_recording])


def test_a_twin_takes_no_further_fault(
    pump: Pump, at_15: OperatingCondition, faulty_recording: Recording
) -> None:
    with pytest.raises(InputError, match="fault applies to a pump only"):
        calibrate(Twin(pump, at_15), [faulty_recording], fault=RECESS)


@pytest.fixture(scope="module")
def without_condition(recordings: list[Recording]) -> Recording:
    return replace(recordings[0], recording_id="bare", condition=None)


def test_recordings_without_an_operating_point_are_refused_with_the_way_to_give_it(
    without_condition: Recording,
) -> None:
    message = r'bare specifies no operating point.* such as "860 rpm" and "10 MPa"'
    with pytest.raises(DataError, match=message):
        calibrate("25scy14-1b", [without_condition])


def test_a_recording_without_an_operating_point_is_excluded_from_the_others(
    recordings: list[Recording], without_condition: Recording
) -> None:
    mixed = [without_condition, recordings[1]]
    calibration = calibrate("25scy14-1b", mixed, method=QUICK, **SIX_VALUES)
    assert calibration.excluded_recordings == (
        ("bare", "it lacks speed or pressure; add them to the index"),
    )


def test_impossible_bounds_are_refused_before_a_recording_is_measured(
    recordings: list[Recording],
) -> None:
    # measuring it would raise another error
    broken = replace(recordings[0], signal=np.full((3, 9000), np.nan))
    with pytest.raises(InputError, match="must be a factor above 1"):
        calibrate("25scy14-1b", [broken], bounds=0.5)


def test_a_calibration_needs_a_pump(recordings: list[Recording]) -> None:
    with pytest.raises(InputError, match="must be a pump, the name of a pump, a twin"):
        calibrate([], recordings)


def test_a_calibration_needs_recordings() -> None:
    with pytest.raises(DataError, match="there are no recordings"):
        calibrate("25scy14-1b", [])
