"""What `calibrate` makes of a pump's name and of recordings that state their operating points."""

from dataclasses import replace

import numpy as np
import pytest
from twin_recordings import DAMPER, SIX_VALUES, recording_of

from swashtwin.calibration import GaussNewton, calibrate
from swashtwin.foundation import DataError, InputError, MPa, mm, rpm
from swashtwin.physics import Twin
from swashtwin.pump import OperatingCondition, Pump, SwashPlateDefect
from swashtwin.recordings import Recording
from swashtwin.synthesis import synthesize

QUICK = GaussNewton(starts=1, max_iterations=4)


def healthy_recording(
    pump: Pump, pressure: float, *, speed: float = 860.0, seed: int = 0
) -> Recording:
    """Recording of a pump of other values than the nominal ones at that pressure [MPa] and speed
    [rev/min].
    """
    condition = OperatingCondition(speed=rpm(speed), discharge_pressure=MPa(pressure))
    recording = recording_of(Twin(pump, condition, bandwidth=2600), DAMPER, seed=seed)
    return replace(recording, recording_id=f"healthy-{seed}")


@pytest.fixture(scope="module")
def recordings(pump: Pump) -> list[Recording]:
    """Two recordings near 10 MPa, one at 15 MPa."""
    points = [(10.0, 860.0), (15.0, 860.0), (10.2, 862.0)]
    return [healthy_recording(pump, p, speed=n, seed=seed) for seed, (p, n) in enumerate(points)]


def test_a_name_and_a_recording_are_enough(recordings: list[Recording]) -> None:
    calibration = calibrate("25scy14-1b", recordings[:1], seed=1)
    assert calibration.method == "GaussNewton"
    assert calibration.settings["phases"]
    assert len(calibration.posterior.unknowns) == 6 + 11 + 3 + 6 + 2 + 2 + 6
    assert repr(calibration).startswith(
        "<Calibration of 25scy14-1b (normal) by GaussNewton on 1 recording; identified: "
    )
    true = calibration.nominal.values.numpy() * DAMPER
    for estimate, value in zip(calibration.estimates, true, strict=True):
        assert estimate.interval[0] < value < estimate.interval[1]


@pytest.mark.parametrize(("name", "is_free"), [("body_y", False), ("acc", True)])
def test_one_sensor_calibrates_and_makes_windows(
    recordings: list[Recording], name: str, is_free: bool
) -> None:
    one = [
        recording.select_channels(["body_y"]).replace(channels=(name,))
        for recording in recordings[:1]
    ]
    calibration = calibrate("25scy14-1b", one, method=QUICK, explain_misfit=False)
    assert any("is not a sensor of the pump" in note for note in calibration.notes) == is_free
    assert calibration.posterior.channels == ("cover_z" if is_free else "body_y",)
    windows = synthesize(calibration, None, count=1, like=one, window=2048, background="none")
    assert windows.channels == (name,)
    assert np.isfinite(windows.signal).all()


def test_recordings_are_grouped_by_operating_point_and_fitted_together(
    recordings: list[Recording],
) -> None:
    calibration = calibrate("25scy14-1b", recordings, method=QUICK, **SIX_VALUES)
    assert calibration.excluded_recordings == ()
    assert [len(fit.recording_ids) for fit in calibration.fits] == [2, 1]
    pressures = [fit.condition.discharge_pressure for fit in calibration.fits]
    assert pressures == pytest.approx([MPa(10.1), MPa(15)])
    assert calibration.fits[0].condition.speed == pytest.approx(rpm(861))


def test_a_healthy_label_may_read_healthy(pump: Pump, recordings: list[Recording]) -> None:
    recording = recordings[0].replace(label="healthy")
    calibration = calibrate(pump, [recording], method=QUICK, **SIX_VALUES)
    assert calibration.recording_ids == ("healthy-0",)
    windows = synthesize(
        calibration, None, count=1, like=[replace(recording, synthetic=False)], window=1024
    )
    assert windows.classes == ("healthy",)
    assert set(windows.label) == {"healthy"}


def test_recordings_of_a_fault_are_calibrated_with_that_fault(pump: Pump) -> None:
    fault = SwashPlateDefect(length=mm(30), width=mm(24), depth=mm(0.6))
    condition = OperatingCondition(speed=rpm(860), discharge_pressure=MPa(15))
    recording = recording_of(Twin(pump, condition, fault, bandwidth=2600))
    calibration = calibrate(pump, [recording], fault=fault, method=QUICK, **SIX_VALUES)
    assert calibration.twin.fault == fault
    with pytest.raises(
        DataError,
        match=r"No recording is labeled 'normal' \(labels: swash_plate\).* give fault for",
    ):
        calibrate(pump, [recording])
    with pytest.raises(InputError, match="fault applies to a pump only"):
        calibrate(Twin(pump, condition), [recording], fault=fault)


def test_recordings_without_a_condition_are_refused_with_the_way_to_give_it(
    recordings: list[Recording],
) -> None:
    unstated = replace(recordings[0], recording_id="unstated", condition=None)
    with pytest.raises(
        DataError, match=r'unstated specifies no operating point.* such as "860 rpm" and "10 MPa"'
    ):
        calibrate("25scy14-1b", [unstated])
    calibration = calibrate("25scy14-1b", [unstated, recordings[1]], method=QUICK, **SIX_VALUES)
    assert calibration.excluded_recordings == (
        ("unstated", "it lacks speed or pressure; add them to the index"),
    )


def test_what_cannot_be_calibrated_is_refused_before_a_recording_is_measured(
    recordings: list[Recording],
) -> None:
    broken = replace(recordings[0], signal=np.full((3, 9000), np.nan))
    with pytest.raises(InputError, match="must be a factor above 1"):
        calibrate("25scy14-1b", [broken], bounds=0.5)
    with pytest.raises(InputError, match="must be a pump, the name of a pump, a twin"):
        calibrate([], recordings)
    with pytest.raises(DataError, match="there are no recordings"):
        calibrate("25scy14-1b", [])
