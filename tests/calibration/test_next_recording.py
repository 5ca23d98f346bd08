"""What to record next: expected widths are those that a calibration then has."""

from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from commandline import one_line, run, run_json

from swashtwin.calibration import (
    Calibration,
    GaussNewton,
    Nuisances,
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

USUAL = ("cover_z", "body_y", "body_x")
MOVED = ("cover_z", "body_y", "cover_y")


@pytest.fixture(scope="module")
def machine(pump: Pump, at_15: OperatingCondition) -> Twin:
    """A healthy pump at 860 rev/min and 10 MPa, with a fourth sensor."""
    cover = Sensor("cover_y", pump.sensors[0].position, (0.0, 1.0, 0.0))
    wider = replace(pump, sensors=(*pump.sensors, cover))
    return Twin(wider, at_15.replace(discharge_pressure=MPa(10)), bandwidth=2600)


def recording_at(
    machine: Twin, speed: float, pressure: float, channels: tuple[str, ...] = USUAL, seed: int = 0
) -> Recording:
    """Noisy recording of 1.3 s."""
    there = machine.at(
        machine.condition.replace(speed=rpm(speed), discharge_pressure=MPa(pressure))
    )
    recording = there.simulate(
        1.3, 6400.0, phase=1.0 + seed, recording_id=f"{speed:g} {pressure:g} {seed}"
    )
    recording = recording.select_channels(list(channels))
    return recording.replace(signal=add_noise(recording.signal, 30.0, seed))


def calibrated(machine: Twin, *recordings: Recording) -> Calibration:
    method = GaussNewton(starts=1)
    return calibrate(
        machine.pump, recordings, method=method, nuisances=Nuisances.housing(), explain_misfit=False
    )


@pytest.fixture(scope="module")
def first(machine: Twin) -> Recording:
    return recording_at(machine, 860, 10)


@pytest.fixture(scope="module")
def calibration(machine: Twin, first: Recording) -> Calibration:
    return calibrated(machine, first)


def test_the_width_that_was_foretold_comes_true(
    machine: Twin, calibration: Calibration, first: Recording
) -> None:
    (foretold,) = plan_recording(calibration, speeds=[rpm(1500)], pressures=[MPa(15)]).candidates
    after = calibrated(machine, first, recording_at(machine, 1500, 15))
    assert foretold.total_interval_width < sum_interval_widths(calibration.estimates) - 1
    assert foretold.total_interval_width == pytest.approx(
        sum_interval_widths(after.estimates), abs=0.15
    )
    assert foretold.duration == pytest.approx(1.3)
    assert all(factor >= 1 - 1e-3 for factor in foretold.narrowing_factors.values())


def test_a_sensor_elsewhere_is_foretold_and_calibrated_with_the_others(
    machine: Twin, calibration: Calibration, first: Recording
) -> None:
    (foretold,) = plan_recording(
        calibration, speeds=[rpm(860)], pressures=[MPa(15)], sensors=[MOVED]
    ).candidates
    after = calibrated(machine, first, recording_at(machine, 860, 15, MOVED))
    assert after.posterior.channels == (*USUAL, "cover_y")
    assert [fit.spectra.channels for fit in after.fits] == [USUAL, MOVED]
    assert foretold.total_interval_width == pytest.approx(
        sum_interval_widths(after.estimates), abs=0.25
    )
    for estimate, value in zip(after.estimates, machine.values.tolist(), strict=True):
        assert estimate.interval[0] <= value <= estimate.interval[1]


def test_a_repetition_with_fewer_sensors_is_no_new_information(
    machine: Twin, calibration: Calibration, first: Recording
) -> None:
    again = recording_at(machine, 860, 10, USUAL[:2], seed=1)
    before, after = (
        sum_interval_widths(calibration.estimates),
        sum_interval_widths(calibrated(machine, first, again).estimates),
    )
    assert after == pytest.approx(before, abs=0.4)
    (foretold,) = plan_recording(
        calibration, speeds=[rpm(860)], pressures=[MPa(10)], sensors=[USUAL[:2]]
    ).candidates
    assert foretold.total_interval_width == pytest.approx(after, abs=0.15)


def test_candidates_are_ranked_within_the_rating_and_a_repetition_comes_last(
    calibration: Calibration,
) -> None:
    plan = plan_recording(calibration)
    widths = [item.total_interval_width for item in plan.candidates]
    assert (
        len(widths) == 3
    )  # 860 rev/min is the rated speed, and at less 1.3 s are below 16 revolutions
    assert max(item.speed for item in plan.candidates) == pytest.approx(rpm(860))
    assert max(item.discharge_pressure for item in plan.candidates) == pytest.approx(MPa(15))
    assert widths == sorted(widths)
    assert plan.total_interval_width == sum_interval_widths(calibration.estimates)
    last = plan.candidates[-1]
    assert (last.speed, last.discharge_pressure) == pytest.approx((rpm(860), MPa(10)))


def test_what_cannot_be_planned_is_said_in_plain_words(calibration: Calibration) -> None:
    with pytest.raises(
        InputError,
        match=r"sensors \(top\) must be different sensors of the pump, which has cover_z",
    ):
        plan_recording(calibration, sensors=[["top"]])
    with pytest.raises(InputError, match="Specify at least one speed"):
        plan_recording(calibration, speeds=[])
    with pytest.raises(InputError, match="shorter than 16 revolutions: record longer"):
        plan_recording(calibration, speeds=[rpm(60)])
    with pytest.raises(InputError, match="contains no multiple of the piston-pass frequency"):
        plan_recording(
            replace(calibration, settings={**calibration.settings, "band": [0, 150]}),
            speeds=[rpm(1500)],
        )


def test_the_command_ranks_what_the_function_ranks(
    calibration: Calibration, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = calibration.save(tmp_path / "calibration.json")
    words = ("twin", "next", path, "--speeds", "600 rpm, 1500 rpm", "--pressures", "5 MPa,15 MPa")
    answer = run_json(*words, "--sensors", "cover_z, body_y, body_x")
    plan = plan_recording(
        load_calibration(path),
        speeds=[rpm(600), rpm(1500)],
        pressures=[MPa(5), MPa(15)],
    )
    expected = asdict(plan)["candidates"]
    for name in ("speed", "discharge_pressure", "duration", "total_interval_width"):
        answered, wanted = (
            [row[name] for row in rows] for rows in (answer["candidates"], expected)
        )
        np.testing.assert_allclose(answered, wanted)
    shown = run(*words).stdout
    assert "Candidates for the next recording" in shown
    assert "1500 rpm" in shown
    assert "must be different sensors of the pump" in one_line(
        run("twin", "next", path, "--sensors", "top", code=3)
    )
    assert "600" in one_line(run("twin", "next", path, "--speeds", "600", code=3))
    widened = replace(plan, total_interval_width=plan.candidates[1].total_interval_width)
    monkeypatch.setattr("swashtwin.calibration.plan_recording", lambda *args, **options: widened)
    shown = " ".join(run(*words).stdout.split())
    assert shown.count(" none ") == len(plan.candidates) - 1
    assert (
        "none: there, the model error of the twin exceeds what a further recording resolves"
        in shown
    )
