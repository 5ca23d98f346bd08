"""Plans of the next recording: predicted interval widths are those of the next calibration."""

from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commandline import one_line, run, run_json

from swashtwin.calibration import (
    Calibration,
    GaussNewton,
    Nuisances,
    RecordingPlan,
    calibrate,
    load_calibration,
    plan_recording,
    sum_interval_widths,
)
from swashtwin.foundation import InputError, MPa, rpm
from swashtwin.physics import Twin
from swashtwin.pump import OperatingCondition, Pump, Sensor
from swashtwin.recordings import Recording
from swashtwin.signals import add_noise

CHANNELS = ("cover_z", "body_y", "body_x")
MOVED_CHANNELS = ("cover_z", "body_y", "cover_y")


@pytest.fixture(scope="module")
def machine(pump: Pump, at_15: OperatingCondition) -> Twin:
    """A healthy pump at 860 rev/min and 10 MPa, with a fourth sensor."""
    cover = Sensor("cover_y", pump.sensors[0].position, (0.0, 1.0, 0.0))
    wider = replace(pump, sensors=(*pump.sensors, cover))
    return Twin(wider, at_15.replace(discharge_pressure=MPa(10)), bandwidth=2600)


def recording_at(
    machine: Twin,
    speed: float,
    pressure: float,
    channels: tuple[str, ...] = CHANNELS,
    seed: int = 0,
) -> Recording:
    """Noisy recording of 1.3 s at `speed` [rev/min] and `pressure` [MPa]."""
    condition = machine.condition.replace(speed=rpm(speed), discharge_pressure=MPa(pressure))
    name = f"{speed:g} {pressure:g} {seed}"
    recording = machine.at(condition).simulate(1.3, 6400.0, phase=1.0 + seed, recording_id=name)
    recording = recording.select_channels(list(channels))
    return recording.replace(signal=add_noise(recording.signal, 30.0, seed))


def calibrate_machine(machine: Twin, *recordings: Recording) -> Calibration:
    return calibrate(
        machine.pump,
        recordings,
        method=GaussNewton(starts=1),
        nuisances=Nuisances.housing(),
        explain_misfit=False,
    )


@pytest.fixture(scope="module")
def first(machine: Twin) -> Recording:
    return recording_at(machine, 860, 10)


@pytest.fixture(scope="module")
def calibration(machine: Twin, first: Recording) -> Calibration:
    return calibrate_machine(machine, first)


def test_the_predicted_width_is_that_of_the_next_calibration(
    machine: Twin, calibration: Calibration, first: Recording
) -> None:
    (candidate,) = plan_recording(calibration, speeds=[rpm(1500)], pressures=[MPa(15)]).candidates
    assert candidate.total_interval_width < sum_interval_widths(calibration.estimates) - 1
    assert candidate.duration == pytest.approx(1.3)
    # a further recording takes no information away
    assert all(factor >= 1 - 1e-3 for factor in candidate.narrowing_factors.values())

    next_calibration = calibrate_machine(machine, first, recording_at(machine, 1500, 15))
    width = sum_interval_widths(next_calibration.estimates)
    assert candidate.total_interval_width == pytest.approx(width, abs=0.15)
    for estimate in next_calibration.estimates:
        low, high = estimate.interval
        expected_factor = candidate.expected_factors[estimate.symbol]
        assert expected_factor == pytest.approx((high / low) ** 0.5, rel=0.1), estimate.symbol


def test_a_moved_sensor_is_planned_and_calibrated_with_the_others(
    machine: Twin, calibration: Calibration, first: Recording
) -> None:
    (candidate,) = plan_recording(
        calibration, speeds=[rpm(860)], pressures=[MPa(15)], sensors=[MOVED_CHANNELS]
    ).candidates
    moved = recording_at(machine, 860, 15, MOVED_CHANNELS)
    next_calibration = calibrate_machine(machine, first, moved)

    assert next_calibration.posterior.channels == (*CHANNELS, "cover_y")
    fitted_channels = [fit.spectra.channels for fit in next_calibration.fits]
    assert fitted_channels == [CHANNELS, MOVED_CHANNELS]

    width = sum_interval_widths(next_calibration.estimates)
    assert candidate.total_interval_width == pytest.approx(width, abs=0.25)
    for estimate, value in zip(next_calibration.estimates, machine.values.tolist(), strict=True):
        assert estimate.interval[0] <= value <= estimate.interval[1]


def test_a_repetition_with_fewer_sensors_adds_no_information(
    machine: Twin, calibration: Calibration, first: Recording
) -> None:
    fewer_channels = CHANNELS[:2]
    repetition = recording_at(machine, 860, 10, fewer_channels, seed=1)
    next_calibration = calibrate_machine(machine, first, repetition)
    width = sum_interval_widths(next_calibration.estimates)
    assert width == pytest.approx(sum_interval_widths(calibration.estimates), abs=0.4)

    (candidate,) = plan_recording(
        calibration, speeds=[rpm(860)], pressures=[MPa(10)], sensors=[fewer_channels]
    ).candidates
    assert candidate.total_interval_width == pytest.approx(width, abs=0.15)


def test_candidates_stay_within_the_rating_and_long_enough(calibration: Calibration) -> None:
    plan = plan_recording(calibration)
    candidates = plan.candidates
    # one speed at three pressures: 860 rev/min is rated, and at less 1.3 s are below 16 revolutions
    assert len(candidates) == 3
    assert plan.excluded_speeds == pytest.approx((rpm(860) * 2 / 3,))
    assert plan.required_duration == pytest.approx(16 / (860 * 2 / 3 / 60))
    assert max(each.speed for each in candidates) == pytest.approx(rpm(860))
    assert max(each.discharge_pressure for each in candidates) == pytest.approx(MPa(15))


def test_candidates_are_ranked_by_width_with_a_repetition_last(calibration: Calibration) -> None:
    plan = plan_recording(calibration)
    widths = [candidate.total_interval_width for candidate in plan.candidates]
    assert widths == sorted(widths)
    assert plan.total_interval_width == sum_interval_widths(calibration.estimates)

    # recorded one after another, each narrows further, the first as much as alone
    sequence = [candidate.total_interval_width for candidate in plan.sequence]
    assert sequence[0] == widths[0]
    assert 1 < len(sequence) <= 3
    assert sequence == sorted(sequence, reverse=True)

    repetition = plan.candidates[-1]
    condition = (repetition.speed, repetition.discharge_pressure)
    assert condition == pytest.approx((rpm(860), MPa(10)))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            {"sensors": [["top"]]},
            r"sensors \(top\) must be different sensors of the pump, which has cover_z",
        ),
        ({"speeds": []}, "Specify at least one speed"),
        ({"speeds": [rpm(60)]}, "shorter than 16 revolutions: record longer"),
    ],
    ids=["unknown sensor", "no speed", "too slow for the duration"],
)
def test_impossible_candidates_are_refused_with_the_remedy(
    calibration: Calibration, arguments: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        plan_recording(calibration, **arguments)


def test_a_band_without_lines_at_a_speed_is_refused(calibration: Calibration) -> None:
    # 1500 rev/min have the first line at 175 Hz
    low_band = replace(calibration, settings={**calibration.settings, "band": [0, 150]})
    with pytest.raises(InputError, match="contains no multiple of the piston-pass frequency"):
        plan_recording(low_band, speeds=[rpm(1500)])


@pytest.fixture
def path(calibration: Calibration, tmp_path: Path) -> Path:
    return calibration.save(tmp_path / "calibration.json")


@pytest.fixture
def command(path: Path) -> tuple[Any, ...]:
    grid = ("--speeds", "600 rpm, 1500 rpm", "--pressures", "5 MPa,15 MPa")
    return ("twin", "next", path, *grid)


@pytest.fixture
def plan(path: Path) -> RecordingPlan:
    speeds = [rpm(600), rpm(1500)]
    pressures = [MPa(5), MPa(15)]
    return plan_recording(load_calibration(path), speeds=speeds, pressures=pressures)


def test_the_command_ranks_as_the_function(command: tuple[Any, ...], plan: RecordingPlan) -> None:
    printed = run_json(*command, "--sensors", "cover_z, body_y, body_x")["candidates"]
    expected = asdict(plan)["candidates"]
    for name in ("speed", "discharge_pressure", "duration", "total_interval_width"):
        np.testing.assert_allclose([row[name] for row in printed], [row[name] for row in expected])


def test_the_command_prints_a_table(command: tuple[Any, ...]) -> None:
    output = " ".join(run(*command).stdout.split())
    assert "Candidates for the next recording" in output
    assert "1500 rpm" in output
    assert "C_v" in output
    assert "Left out: 600 rpm. A recording as long as the previous ones (1.3 s)" in output
    assert "record at least 1.6 s." in output
    assert "Recorded one after another" in output


def test_the_command_refuses_unknown_sensors_and_speeds_without_a_unit(path: Path) -> None:
    error = one_line(run("twin", "next", path, "--sensors", "top", code=3))
    assert "must be different sensors of the pump" in error
    error = one_line(run("twin", "next", path, "--speeds", "600", code=3))
    assert "600" in error


def test_the_command_prints_none_for_candidates_that_narrow_nothing(
    command: tuple[Any, ...], plan: RecordingPlan, monkeypatch: pytest.MonkeyPatch
) -> None:
    # as narrow already as the second candidate would make it
    width = plan.candidates[1].total_interval_width
    resolved = replace(plan, total_interval_width=width)
    monkeypatch.setattr("swashtwin.calibration.plan_recording", lambda *_, **__: resolved)

    output = " ".join(run(*command).stdout.split())

    assert output.count(" none ") == len(plan.candidates) - 1
    reason = "the model error of the twin exceeds what a further recording resolves"
    assert f"none: there, {reason}" in output
