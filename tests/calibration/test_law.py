"""The law of a recess: recovered from a twin's recordings, saved, and used by synthesis."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swashtwin.calibration import (
    Calibration,
    FaultLaw,
    GaussNewton,
    Nuisances,
    calibrate,
    estimate_severity,
    identify_law,
    load_calibration,
)
from swashtwin.foundation import InputError, MPa, mm, um
from swashtwin.learning import WindowSet
from swashtwin.physics import Twin
from swashtwin.pump import OperatingCondition, PistonWear, Pump, SwashPlateDefect
from swashtwin.recordings import Recording
from swashtwin.signals import add_noise
from swashtwin.synthesis import synthesize

CORNER_HZ = 1100.0
TRUE = SwashPlateDefect(depth=mm(0.06), corner=CORNER_HZ)
SPECIFIED = SwashPlateDefect(depth=mm(0.07))


@pytest.fixture(scope="module")
def recordings(pump: Pump, at_15: OperatingCondition) -> list[Recording]:
    """Two healthy recordings at 5 and 10 MPa, then two of the recess."""
    twin = Twin(pump, at_15, bandwidth=3000)

    def record(fault: SwashPlateDefect | None, pressure: float) -> Recording:
        name = f"{'recess' if fault else 'healthy'}_{pressure / 1e6:.0f}"
        condition = at_15.replace(discharge_pressure=pressure)
        clean = twin.at(condition).with_fault(fault).simulate(2.0, 7680.0, recording_id=name)
        snr_db = 20.0 if fault is None else 14.0  # a recess raises the noise
        signal = add_noise(clean.signal, snr_db, 0, name)
        return replace(clean, signal=signal, specimen="A", synthetic=False)

    return [
        record(None, MPa(5)),
        record(None, MPa(10)),
        record(TRUE, MPa(5)),
        record(TRUE, MPa(10)),
    ]


@pytest.fixture(scope="module")
def calibration(pump: Pump, recordings: list[Recording]) -> Calibration:
    return calibrate(
        pump,
        recordings,
        law=SPECIFIED,
        explain_misfit=False,
        method=GaussNewton(starts=1),
        nuisances=Nuisances.typical(),
        phases=False,
    )


@pytest.fixture(scope="module")
def law(calibration: Calibration) -> FaultLaw:
    assert calibration.law is not None
    return calibration.law


def test_depth_corner_and_fall_are_recovered_within_their_intervals(law: FaultLaw) -> None:
    depth, corner, fall, *_ = law.estimates
    assert depth.interval[0] < TRUE.depth < depth.interval[1]
    assert corner.interval[0] < CORNER_HZ < corner.interval[1]
    assert fall.interval[0] < TRUE.fall < fall.interval[1]

    assert corner.value == pytest.approx(CORNER_HZ, rel=0.3)
    assert corner.verdict == "identified"
    assert [estimate.unit for estimate in law.estimates] == ["m", "Hz", "", "m", "rad", ""]


def test_the_true_contact_has_the_highest_evidence(law: FaultLaw) -> None:
    assert max(law.evidence, key=lambda name: law.evidence[name]) == "shared, half_sine"
    assert law.evidence["lift_off, half_sine"] < -3


def test_the_higher_noise_of_a_recess_is_estimated(law: FaultLaw) -> None:
    assert law.noise_factor > 1.2


def test_a_saved_calibration_keeps_the_law_and_its_recordings(
    calibration: Calibration, tmp_path: Path
) -> None:
    loaded = load_calibration(calibration.save(tmp_path / "calibration.json"))
    assert loaded.law == calibration.law
    assert {"recess_5", "recess_10"} < set(loaded.recording_hashes)


def synthesize_windows(
    calibration: Calibration,
    fault: SwashPlateDefect | None,
    recordings: list[Recording],
    **arguments: Any,
) -> WindowSet:
    return synthesize(
        calibration, fault, like=recordings[:2], window=1024, background="none", **arguments
    )


def test_windows_of_a_specified_recess_follow_the_law_at_another_pressure(
    calibration: Calibration, recordings: list[Recording]
) -> None:
    arguments = {"count": 12, "pressure": MPa(15)}
    with_law = synthesize_windows(calibration, SPECIFIED, recordings, **arguments)
    without_law = synthesize_windows(
        replace(calibration, law=None), SPECIFIED, recordings, **arguments
    )

    def amplitude_above_corner(windows: WindowSet) -> float:
        spectrum = np.abs(np.fft.rfft(windows.signal)).mean(axis=(0, 1))
        frequency = np.arange(len(spectrum)) * 7.5
        return spectrum[frequency > 2 * CORNER_HZ].sum()

    assert amplitude_above_corner(with_law) < amplitude_above_corner(without_law)


def test_noise_rises_at_the_specified_depth_if_recordings_do_not_determine_the_depth(
    law: FaultLaw,
) -> None:
    depth = replace(law.estimates[0], value=1e-7, verdict="at bound")
    without_depth = replace(
        law, fault=replace(law.fault, depth=1e-7), estimates=(depth, *law.estimates[1:])
    )
    assert without_depth.noise_factor_of(SPECIFIED) == pytest.approx(law.noise_factor)
    assert law.noise_factor_of(law.fault) == pytest.approx(law.noise_factor)


@pytest.fixture
def without_corner(calibration: Calibration, law: FaultLaw) -> Calibration:
    estimates = tuple(
        replace(estimate, verdict="not identified") if estimate == law.corner else estimate
        for estimate in law.estimates
    )
    return replace(calibration, law=replace(law, estimates=estimates))


def test_windows_of_a_recess_report_that_they_guess_an_unidentified_corner(
    without_corner: Calibration, recordings: list[Recording]
) -> None:
    windows = synthesize_windows(without_corner, SPECIFIED, recordings, count=2, pressure=MPa(10))
    assert "(corner: not identified); the windows guess it" in " ".join(windows.notes)


@pytest.mark.parametrize(
    ("is_identified", "fault"),
    [(True, SPECIFIED), (False, TRUE), (False, None)],
    ids=["identified", "specified with the fault", "no recess"],
)
def test_other_windows_report_no_guess_of_the_corner(
    calibration: Calibration,
    without_corner: Calibration,
    recordings: list[Recording],
    is_identified: bool,
    fault: SwashPlateDefect | None,
) -> None:
    source = calibration if is_identified else without_corner
    windows = synthesize_windows(source, fault, recordings, count=2, pressure=MPa(10))
    assert "follow a recess" not in " ".join(windows.notes)


def test_severity_searches_a_specified_recess_under_the_law(
    calibration: Calibration, recordings: list[Recording]
) -> None:
    healthy = recordings[:2]
    (estimate,) = estimate_severity(
        calibration, recordings[2:3], SPECIFIED, healthy=healthy, free=()
    ).estimates
    depth, corner = estimate.dimensions

    assert depth.interval[0] < TRUE.depth < depth.interval[1]
    assert corner.dimension.name == "corner"
    assert corner.interval[0] < CORNER_HZ < corner.interval[1]


def test_a_fault_without_a_law_is_refused(
    calibration: Calibration, recordings: list[Recording]
) -> None:
    with pytest.raises(InputError, match="no unknowns"):
        identify_law(calibration, recordings, PistonWear(clearance=um(60)), recordings)


def test_a_law_cannot_be_searched_with_a_given_fault(
    calibration: Calibration, recordings: list[Recording]
) -> None:
    with pytest.raises(InputError, match="Omit fault"):
        calibrate(calibration.nominal.pump, recordings, fault=SPECIFIED, law=SPECIFIED)
