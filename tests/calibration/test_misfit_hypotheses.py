"""A simple mistake that explains a misfit is named; a misfit that none explains is only told of."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from twin_recordings import SIX_VALUES, recording_of, with_amplitudes

from swashtwin.calibration import (
    Calibration,
    GaussNewton,
    Nuisances,
    build_objective,
    calibrate,
    is_warning,
    measure,
)
from swashtwin.calibration.misfit_hypotheses import find_misfit_hypotheses
from swashtwin.calibration.posterior import (
    MAX_MISFIT,
    build_estimates,
    compute_misfit,
    posterior_covariance,
)
from swashtwin.foundation import MPa, random_stream
from swashtwin.physics import Scales, Twin
from swashtwin.pump import OperatingCondition, Pump
from swashtwin.recordings import Recording
from swashtwin_bench.questions.twin_matrix import CHANNELS, with_mixing, with_unit_error

QUICK = GaussNewton(starts=1)


@pytest.fixture(scope="module")
def recording(twin: Twin) -> Recording:
    return recording_of(twin)


def calibrated(twin: Twin, recording: Recording) -> Calibration:
    """Quick calibration of the six values."""
    return calibrate(twin, [recording], method=QUICK, **SIX_VALUES)


def scaled(twin: Twin, name: str, factor: float) -> Twin:
    """The twin with a factor on one of its constants."""
    return replace(twin, scales=replace(Scales(), **{name: factor}))


def shallow(twin: Twin) -> Twin:
    """The twin whose defect is half as deep."""
    assert twin.fault is not None
    return twin.with_fault(twin.fault.scaled(0.5))


def test_a_right_twin_is_not_warned_of(twin: Twin, recording: Recording) -> None:
    notes = calibrated(twin, recording).notes
    assert len(notes) == 1
    assert not is_warning(notes[0])


@pytest.mark.parametrize(
    ("change", "words"),
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
)
def test_a_mistake_of_the_recording_is_named(
    twin: Twin, recording: Recording, change: Callable[[Recording], Recording], words: str
) -> None:
    assert_named(calibrated(twin, change(recording)), words)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            partial(scaled, name="mount", factor=0.5),
            "the mounting's stiffness is 2 times the twin's",
        ),
        (partial(replace, topology="T2"), "the bodies are joined as in topology T1"),
        (shallow, "the defect's excitation is 2 times the twin's"),
    ],
)
def test_a_mistake_of_the_twin_is_named(
    twin: Twin, recording: Recording, change: Callable[[Twin], Twin], words: str
) -> None:
    assert_named(calibrated(change(twin), recording), words)


def assert_named(calibration: Calibration, words: str) -> None:
    """A warning names a mistake in these words."""
    warnings = [note for note in calibration.notes if is_warning(note)]
    assert any("the misfit falls from" in note and words in note for note in warnings), warnings


def test_values_do_not_depend_on_mistakes_beyond_what_is_searched(
    twin: Twin, recording: Recording
) -> None:
    wrong = scaled(twin, "mount", 1.5)
    explained, plain = (
        calibrate(wrong, [recording], method=QUICK, explain_misfit=explain, **SIX_VALUES)
        for explain in (True, False)
    )
    assert plain.estimates == explained.estimates
    assert_named(explained, "the mounting's stiffness is 0.67 times the twin's")
    assert not any("the misfit falls from" in note for note in plain.notes)


def test_the_search_starts_again_from_a_mistake_and_ends_in_the_better_valley(twin: Twin) -> None:
    stiff = recording_of(replace(twin, scales=Scales(mount=1.8)))
    once, again = (
        calibrate(
            twin,
            [stiff],
            method=QUICK,
            nuisances=Nuisances(mount=0.3),
            phases=False,
            explain_misfit=explain,
        )
        for explain in (False, True)
    )
    assert once.is_in_doubt
    assert again.misfit < once.misfit
    assert again.twin.scales.mount == pytest.approx(1.8, rel=0.05)
    np.testing.assert_array_equal(again.posterior.unknowns.start, once.posterior.unknowns.start)


def test_a_direction_of_the_mounting_that_was_not_searched_is_named(
    pump: Pump, at_15: OperatingCondition
) -> None:
    healthy = Twin(pump, at_15.replace(discharge_pressure=MPa(10)), bandwidth=2600)
    machine = recording_of(replace(healthy, scales=Scales(mount_y=1.5)), np.ones(6))
    notes = calibrate(healthy, [machine], method=QUICK, **SIX_VALUES).notes
    (warning,) = (note for note in notes if is_warning(note))
    assert "the mounting's stiffness along y is 1.5 times" in warning
    assert "nuisances=by-axis" in warning


def test_a_misfit_that_no_mistake_explains_leaves_no_value_identified(twin: Twin) -> None:
    objective = build_objective(twin, measure(twin, [recording_of(twin, np.ones(6))]))
    start = objective.unknowns.start
    covariance = posterior_covariance(objective, start)
    assert "identified" in [
        estimate.verdict for estimate in build_estimates(objective, start, covariance)
    ]
    factor = np.exp(0.5 * random_stream(0, "misfit").standard_normal(len(objective.measured)))
    scattered = with_amplitudes(objective, objective.measured.numpy() * factor)
    assert compute_misfit(scattered, start) > MAX_MISFIT
    assert "identified" not in [
        estimate.verdict for estimate in build_estimates(scattered, start, covariance)
    ]
    point = QUICK.search(scattered, seed=0).point
    assert (misfit := compute_misfit(scattered, point)) > MAX_MISFIT
    assert find_misfit_hypotheses(scattered, misfit) == ()
