"""A misfit that a simple mistake explains is reported with the mistake, any other without one."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from twin_recordings import DAMPER, SIX_VALUES, recording_of, with_amplitudes

from swashtwin.calibration import (
    Calibration,
    GaussNewton,
    Nuisances,
    Objective,
    build_objective,
    calibrate,
    drawing_errors,
    is_warning,
    measure,
)
from swashtwin.calibration.discrepancy import linearize
from swashtwin.calibration.drawing_errors import ALL_PORTS, score_drawing
from swashtwin.calibration.misfit_hypotheses import find_suspected_mistakes
from swashtwin.calibration.posterior import (
    MAX_MISFIT,
    build_estimates,
    compute_misfit,
    posterior_covariance,
)
from swashtwin.calibration.severity.doubt import describe_doubt
from swashtwin.foundation import MPa, deg, random_stream
from swashtwin.physics import Scales, Twin
from swashtwin.pump import OperatingCondition, Pump
from swashtwin.recordings import Recording
from swashtwin_bench.questions.twin_matrix import CHANNELS, with_mixing, with_unit_error

QUICK = GaussNewton(starts=1)


@pytest.fixture(scope="module")
def recording(twin: Twin) -> Recording:
    return recording_of(twin)


def calibrate_quickly(twin: Twin, recording: Recording) -> Calibration:
    """Calibrate the six values."""
    return calibrate(twin, [recording], method=QUICK, **SIX_VALUES)


def with_mount_factor(twin: Twin, factor: float) -> Twin:
    return replace(twin, scales=Scales(mount=factor))


def with_half_the_depth(twin: Twin) -> Twin:
    assert twin.fault is not None
    return twin.with_fault(twin.fault.scaled(0.5))


def warnings_of(calibration: Calibration) -> list[str]:
    return [note for note in calibration.notes if is_warning(note)]


def assert_mistake_reported(calibration: Calibration, message: str) -> None:
    warnings = warnings_of(calibration)
    assert any("the misfit falls from" in text and message in text for text in warnings), warnings


def test_a_correct_twin_causes_no_warning(twin: Twin, recording: Recording) -> None:
    calibration = calibrate_quickly(twin, recording)
    assert len(calibration.notes) == 1
    assert not warnings_of(calibration)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            with_mixing(("body_x", "body_y"), np.eye(2)[::-1]),
            "body_y and body_x have each other's name: check the wiring",
        ),
        (
            with_unit_error(("cover_z",)),
            "cover_z reads 0.1 times what it should relative to the other channels: are its samples in g?",
        ),
        (
            with_unit_error(CHANNELS),
            "the gain of all channels is 0.1 times the twin's: are its samples in g?",
        ),
    ],
    ids=["channels swapped", "one channel in g", "all channels in g"],
)
def test_a_mistake_of_the_recording_is_reported(
    twin: Twin, recording: Recording, change: Callable[[Recording], Recording], message: str
) -> None:
    assert_mistake_reported(calibrate_quickly(twin, change(recording)), message)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            partial(with_mount_factor, factor=0.5),
            "the mounting's stiffness is 2 times the twin's",
        ),
        (partial(replace, topology="T2"), "the bodies are joined as in topology T1"),
        (with_half_the_depth, "the defect's excitation is 2 times the twin's"),
    ],
    ids=["mounting", "topology", "depth"],
)
def test_a_mistake_of_the_twin_is_reported(
    twin: Twin, recording: Recording, change: Callable[[Twin], Twin], message: str
) -> None:
    assert_mistake_reported(calibrate_quickly(change(twin), recording), message)


def test_explaining_the_misfit_changes_no_value(twin: Twin, recording: Recording) -> None:
    wrong = with_mount_factor(twin, 1.5)
    explained = calibrate(wrong, [recording], method=QUICK, explain_misfit=True, **SIX_VALUES)
    plain = calibrate(wrong, [recording], method=QUICK, explain_misfit=False, **SIX_VALUES)

    assert plain.estimates == explained.estimates
    assert_mistake_reported(explained, "the mounting's stiffness is 0.67 times the twin's")
    assert not any("the misfit falls from" in note for note in plain.notes)


def test_the_search_starts_again_from_a_mistake_and_reaches_the_lower_minimum(twin: Twin) -> None:
    stiff = recording_of(with_mount_factor(twin, 1.8))

    def calibrate_mounting(explain_misfit: bool) -> Calibration:
        return calibrate(
            twin,
            [stiff],
            method=QUICK,
            nuisances=Nuisances(mount=0.3),
            phases=False,
            explain_misfit=explain_misfit,
        )

    single_start = calibrate_mounting(explain_misfit=False)
    assert single_start.is_in_doubt

    restarted = calibrate_mounting(explain_misfit=True)
    assert restarted.misfit < single_start.misfit
    assert restarted.twin.scales.mount == pytest.approx(1.8, rel=0.05)
    # the prior stays around the twin that was given
    np.testing.assert_array_equal(
        restarted.posterior.unknowns.start, single_start.posterior.unknowns.start
    )


def test_a_direction_of_the_mounting_that_was_not_searched_is_reported(
    pump: Pump, at_15: OperatingCondition
) -> None:
    healthy = Twin(pump, at_15.replace(discharge_pressure=MPa(10)), bandwidth=2600)
    recording = recording_of(replace(healthy, scales=Scales(mount_y=1.5)), np.ones(6))

    (warning,) = warnings_of(calibrate_quickly(healthy, recording))

    assert "the mounting's stiffness along y is 1.5 times" in warning
    assert "nuisances=by-axis" in warning


@pytest.fixture(scope="module")
def objective(twin: Twin) -> Objective:
    """Of a recording of the twin itself."""
    return build_objective(twin, measure(twin, [recording_of(twin, np.ones(6))]))


@pytest.fixture(scope="module")
def scattered(objective: Objective) -> Objective:
    """The same with lines that scatter by half, which no mistake explains."""
    scatter = random_stream(0, "misfit").standard_normal(len(objective.measured))
    return with_amplitudes(objective, objective.measured.numpy() * np.exp(0.5 * scatter))


def test_a_large_misfit_leaves_no_value_identified(
    objective: Objective, scattered: Objective
) -> None:
    start = objective.unknowns.start
    covariance = posterior_covariance(objective, start)
    estimates = build_estimates(objective, start, covariance)
    assert "identified" in [estimate.verdict for estimate in estimates]

    assert compute_misfit(scattered, start) > MAX_MISFIT
    doubtful_estimates = build_estimates(scattered, start, covariance)
    assert "identified" not in [estimate.verdict for estimate in doubtful_estimates]


def test_a_wrong_pressure_is_one_mistake(twin: Twin, recording: Recording) -> None:
    """A size from the score and one of the factors that are tried may explain it equally well."""
    wrong = with_pressure_factor(twin, 1.2)
    calibration = calibrate_quickly(wrong, recording.replace(condition=wrong.condition))

    mistakes = [note for note in warnings_of(calibration) if "the misfit falls from" in note]
    assert [note.count("the discharge pressure is about") for note in mistakes] == [1]


def test_scatter_is_explained_by_no_mistake(scattered: Objective) -> None:
    point = QUICK.search(scattered, seed=0).point
    assert compute_misfit(scattered, point) > MAX_MISFIT
    assert find_suspected_mistakes(scattered, point) == ()


@pytest.fixture(scope="module")
def healthy(pump: Pump, at_15: OperatingCondition) -> Twin:
    return Twin(pump, at_15.replace(discharge_pressure=MPa(10)), bandwidth=2600)


@pytest.fixture(scope="module")
def healthy_recording(healthy: Twin) -> Recording:
    return recording_of(healthy)


def with_area_factor(twin: Twin, factor: float) -> Twin:
    group = twin.pump.rotating_group
    diameter = group.piston_diameter * factor**0.5
    group = replace(group, piston_diameter=diameter)
    return replace(twin, pump=replace(twin.pump, rotating_group=group))


def with_pressure_factor(twin: Twin, factor: float) -> Twin:
    pressure = factor * twin.condition.discharge_pressure
    return twin.at(twin.condition.replace(discharge_pressure=pressure))


def with_later_ports(twin: Twin, angle: float, names: tuple[str, ...]) -> Twin:
    plate = twin.pump.valve_plate
    angles = {name: getattr(plate, name) + angle for name in names}
    return replace(twin, pump=replace(twin.pump, valve_plate=replace(plate, **angles)))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        pytest.param(
            partial(with_area_factor, factor=0.7),
            "the pistons' area is about 1.4 times the pump file's: check "
            "rotating_group.piston_diameter",
            marks=pytest.mark.nightly,
        ),
        (
            partial(with_pressure_factor, factor=0.9),
            "the discharge pressure is about 1.1 times the specified one",
        ),
        pytest.param(
            partial(with_later_ports, angle=deg(3), names=ALL_PORTS),
            "all ports open and close about 3 deg earlier than in the pump file",
            marks=pytest.mark.nightly,
        ),
    ],
    ids=["area", "pressure", "all ports"],
)
def test_a_wrong_number_of_the_drawing_is_reported_with_the_default_nuisances(
    healthy: Twin, healthy_recording: Recording, change: Callable[[Twin], Twin], message: str
) -> None:
    wrong = change(healthy)
    recording = healthy_recording.replace(condition=wrong.condition)

    calibration = calibrate(wrong, [recording], method=QUICK)

    assert_mistake_reported(calibration, message)
    assert any(message in mistake for mistake in calibration.suspected_mistakes)
    assert "identified" not in {estimate.verdict for estimate in calibration.estimates}
    assert calibration.is_in_doubt
    assert "correct what the notes of the calibration name" in calibration.doubt
    assert message in describe_doubt(calibration)


def test_a_port_far_beyond_its_tolerance_is_reported_with_the_default_nuisances(
    healthy: Twin, healthy_recording: Recording
) -> None:
    wrong = with_later_ports(healthy, deg(3), ("discharge_open",))
    calibration = calibrate(wrong, [healthy_recording], method=QUICK)

    (warning,) = warnings_of(calibration)
    assert "check valve_plate.discharge_open" in warning
    assert calibration.is_in_doubt


@pytest.mark.nightly
def test_a_slightly_wrong_area_biases_no_value(healthy: Twin, healthy_recording: Recording) -> None:
    """Gains and ports take up what an area that is 10 % too small does to the lines."""
    wrong = with_area_factor(healthy, 0.9)
    recording = healthy_recording.replace(condition=wrong.condition)

    calibration = calibrate(wrong, [recording], method=QUICK)

    truth = healthy.values.numpy() * DAMPER
    for estimate, value in zip(calibration.estimates, truth.tolist(), strict=True):
        assert estimate.interval[0] <= value <= estimate.interval[1], estimate.symbol


def test_a_correct_drawing_causes_no_warning_with_the_default_nuisances(
    healthy: Twin, healthy_recording: Recording
) -> None:
    assert not warnings_of(calibrate(healthy, [healthy_recording], method=QUICK))


def test_a_number_that_changes_no_line_is_not_judged(
    objective: Objective, monkeypatch: pytest.MonkeyPatch
) -> None:
    pressure = drawing_errors.DRAWING_ERRORS[0]
    without_effect = replace(pressure, change=lambda twin, size: twin)
    monkeypatch.setattr(drawing_errors, "DRAWING_ERRORS", (without_effect, pressure))

    (score,) = score_drawing(linearize(objective, objective.unknowns.start))
    assert score.error is pressure
