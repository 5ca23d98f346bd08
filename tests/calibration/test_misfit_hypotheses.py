"""A simple mistake that explains a misfit is named; a misfit that none explains is only told of."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import torch
from twin_recordings import SIX_VALUES, recording_of, worn_twin

from swashtwin.calibration import Calibration, GaussNewton, Nuisances, calibrate, is_warning, measure, objective_of
from swashtwin.calibration.uncertainty.misfit_hypotheses import misfit_hypotheses
from swashtwin.foundation import stream
from swashtwin.physics import Scales, Twin
from swashtwin.pump import OperatingCondition, Pump
from swashtwin.recordings import Recording
from swashtwin_bench.questions.twin_matrix import CHANNELS
from swashtwin_bench.questions.wrong_twins import with_swap, with_unit_error

QUICK = GaussNewton(starts=1)


@pytest.fixture(scope="module")
def twin(pump: Pump, at_15: OperatingCondition) -> Twin:
    return worn_twin(pump, at_15)


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
        (with_swap("body_x", "body_y"), "body_y and body_x have each other's name: look at the wiring"),
        (with_unit_error(("cover_z",)), "cover_z reads 0.1 times what it should beside the others: in g?"),
        (with_unit_error(CHANNELS), "the gain of all channels is 0.1 times the twin's: in g?"),
    ],
)
def test_a_mistake_of_the_recording_is_named(
    twin: Twin, recording: Recording, change: Callable[[Recording], Recording], words: str
) -> None:
    assert_named(calibrated(twin, change(recording)), words)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (partial(scaled, name="mount", factor=1.5), "the mounting's stiffness is 0.67 times the twin's"),
        (partial(scaled, name="mount", factor=0.5), "the mounting's stiffness is 2 times the twin's"),
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


def test_values_do_not_depend_on_whether_the_misfit_is_explained(twin: Twin, recording: Recording) -> None:
    wrong = replace(twin, scales=Scales(mount=1.5))
    explained, plain = (
        calibrate(wrong, [recording], method=QUICK, explain_misfit=explain, **SIX_VALUES) for explain in (True, False)
    )
    assert plain.estimates == explained.estimates
    assert any("the misfit falls from" in note for note in explained.notes)
    assert not any("the misfit falls from" in note for note in plain.notes)


def test_a_searched_constant_that_was_left_in_the_wrong_valley_is_named(twin: Twin) -> None:
    stiff = recording_of(replace(twin, scales=Scales(mount=1.8)))
    calibration = calibrate(twin, [stiff], method=QUICK, nuisances=Nuisances(mount=0.3), phases=False)
    is_right = calibration.twin.scales.mount == pytest.approx(1.8, rel=0.05)
    assert is_right or any("the mounting's stiffness is 1.8 times" in note for note in calibration.notes)


def test_a_misfit_that_no_single_mistake_explains_names_none(twin: Twin, recording: Recording) -> None:
    objective = objective_of(twin, measure(twin, [recording]))
    factor = np.exp(0.5 * stream(0, "misfit").standard_normal(len(objective.measured)))
    scattered = objective.with_observables(objective.measured.numpy() * factor)
    misfit = float(scattered.weighted_loss(torch.as_tensor(QUICK.search(scattered, seed=0).point)))
    assert misfit > 2
    assert misfit_hypotheses(scattered, misfit) == ()
