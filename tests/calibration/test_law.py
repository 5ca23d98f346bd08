"""The law of a recess: found again from a twin's own recordings, kept in the file, and used by
synthesis.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from swashtwin.calibration import (
    Calibration,
    GaussNewton,
    Nuisances,
    calibrate,
    estimate_severity,
    identify_law,
    load_calibration,
)
from swashtwin.foundation import InputError, MPa, mm, um
from swashtwin.physics import Twin
from swashtwin.pump import OperatingCondition, PistonWear, Pump, SwashPlateDefect
from swashtwin.recordings import Recording
from swashtwin.signals import add_noise
from swashtwin.synthesis import synthesize

CORNER = 1100.0
TRUE = SwashPlateDefect(depth=mm(0.06), corner=CORNER)
STATED = SwashPlateDefect(depth=mm(0.07))


@pytest.fixture(scope="module")
def recordings(pump: Pump, at_15: OperatingCondition) -> list[Recording]:
    twin = Twin(pump, at_15, bandwidth=3000)

    def record(fault: SwashPlateDefect | None, pressure: float) -> Recording:
        name = f"{'recess' if fault else 'healthy'}_{pressure / 1e6:.0f}"
        condition = at_15.replace(discharge_pressure=pressure)
        clean = twin.at(condition).with_fault(fault).simulate(2.0, 7680.0, recording_id=name)
        level = 20.0 if fault is None else 14.0  # the noise of the second is the louder one
        return replace(
            clean, signal=add_noise(clean.signal, level, 0, name), specimen="A", synthetic=False
        )

    return [record(fault, MPa(pressure)) for fault in (None, TRUE) for pressure in (5, 10)]


@pytest.fixture(scope="module")
def calibration(pump: Pump, recordings: list[Recording]) -> Calibration:
    recipe = {"method": GaussNewton(starts=1), "nuisances": Nuisances.typical(), "phases": False}
    return calibrate(pump, recordings, law=STATED, explain_misfit=False, **recipe)


def test_corner_and_contact_are_found_with_an_interval(calibration: Calibration) -> None:
    law = calibration.law
    assert law is not None
    depth, corner, fall, *_ = law.estimates
    assert fall.interval[0] < TRUE.fall < fall.interval[1]
    assert corner.value == pytest.approx(CORNER, rel=0.3)
    assert corner.interval[0] < CORNER < corner.interval[1]
    assert corner.verdict == "identified"
    assert depth.interval[0] < TRUE.depth < depth.interval[1]
    assert max(law.evidence, key=lambda name: law.evidence[name]) == "shared, half_sine"
    assert law.evidence["lift_off, half_sine"] < -3
    assert law.noise_factor > 1.2
    assert [item.unit for item in law.estimates] == ["m", "Hz", "", "m", "rad", ""]


def test_the_file_carries_the_law_and_its_recordings(
    calibration: Calibration, tmp_path: Path
) -> None:
    loaded = load_calibration(calibration.save(tmp_path / "calibration.json"))
    assert loaded.law == calibration.law
    assert {"recess_5", "recess_10"} < set(loaded.recording_hashes)


def test_windows_of_a_stated_recess_follow_the_law_at_another_pressure(
    calibration: Calibration, recordings: list[Recording]
) -> None:
    arguments = {
        "count": 12,
        "like": recordings[:2],
        "pressure": MPa(15),
        "window": 1024,
        "background": "none",
    }
    lawful = synthesize(calibration, STATED, **arguments)
    without = synthesize(replace(calibration, law=None), STATED, **arguments)
    power = [np.abs(np.fft.rfft(windows.signal)).mean(axis=(0, 1)) for windows in (lawful, without)]
    high = np.arange(len(power[0])) * 7.5 > 2 * CORNER
    assert power[0][high].sum() < power[1][high].sum()


def test_a_depth_that_the_recordings_do_not_tell_is_the_one_stated_where_noise_rises(
    calibration: Calibration,
) -> None:
    law = calibration.law
    assert law is not None
    depth = replace(law.estimates[0], value=1e-7, verdict="at bound")
    unseen = replace(
        law, fault=replace(law.fault, depth=1e-7), estimates=(depth, *law.estimates[1:])
    )
    assert unseen.noise_factor_of(STATED) == pytest.approx(law.noise_factor)
    assert law.noise_factor_of(law.fault) == pytest.approx(law.noise_factor)


def test_windows_say_that_no_recording_told_how_slippers_follow(
    calibration: Calibration, recordings: list[Recording]
) -> None:
    law = calibration.law
    assert law is not None
    estimates = [
        replace(item, verdict="not identified") if item == law.corner else item
        for item in law.estimates
    ]
    unknown = replace(calibration, law=replace(law, estimates=tuple(estimates)))
    arguments = {
        "count": 2,
        "like": recordings[:2],
        "pressure": MPa(10),
        "window": 1024,
        "background": "none",
    }
    assert "(corner: not identified); the windows guess it" in " ".join(
        synthesize(unknown, STATED, **arguments).notes
    )
    for source, fault in ((calibration, STATED), (unknown, TRUE), (unknown, None)):
        assert "follow a recess" not in " ".join(synthesize(source, fault, **arguments).notes)


def test_severity_searches_a_stated_recess_under_the_law(
    calibration: Calibration, recordings: list[Recording]
) -> None:
    (estimate,) = estimate_severity(
        calibration, recordings[2:3], STATED, healthy=recordings[:2], free=()
    ).estimates
    depth, corner = estimate.dimensions
    assert depth.interval[0] < TRUE.depth < depth.interval[1]
    assert corner.dimension.name == "corner"
    assert corner.interval[0] < CORNER < corner.interval[1]


def test_what_has_no_law_to_search_is_refused(
    calibration: Calibration, recordings: list[Recording]
) -> None:
    with pytest.raises(InputError, match="no unknowns"):
        identify_law(calibration, recordings, PistonWear(clearance=um(60)), recordings)
    with pytest.raises(InputError, match="Omit fault"):
        calibrate(calibration.nominal.pump, recordings, fault=STATED, law=STATED)
