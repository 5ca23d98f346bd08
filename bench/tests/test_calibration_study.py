"""The study of calibration methods compares twins with recordings they never saw, and intervals
with the truth.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from swashtwin.calibration import GaussNewton
from swashtwin.foundation import InputError
from swashtwin.signals import order_spectrum
from swashtwin_bench import StudyTable, Work, rig_recordings
from swashtwin_bench.questions.calibration import CONTENDERS, CalibrationStudySettings, calibration
from swashtwin_bench.rigs.measuring import sensor_lines, true_values
from swashtwin_bench.rigs.writing import RigSize

THREE_PRESSURES = "calibrated_at_three_pressures"
NAMES = (THREE_PRESSURES, "gauss_newton")


@pytest.fixture(autouse=True, scope="module")
def _quick() -> Iterator[None]:
    """Calibrate from a single start on recordings of 1.5 s, without a search for mistakes."""
    contenders = dict(CONTENDERS)
    for name in NAMES:
        contenders[name] = replace(
            CONTENDERS[name], method=GaussNewton(starts=1), explain_misfit=False
        )

    module = "swashtwin_bench.questions.calibration"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(f"{module}.CONTENDERS", contenders)
        patch.setattr(f"{module}.RigSize", partial(RigSize, duration=1.5))
        yield


@pytest.fixture(scope="module")
def study(_quick: None) -> StudyTable:
    """The study of two pumps of fleet 102."""
    settings = CalibrationStudySettings(specimens=2, repeats=2, contenders=NAMES)
    return calibration(Work((102,)), settings)


def test_each_twin_has_a_trial_for_each_pump(study):
    rows = study.rows()
    assert [row["twin"] for row in rows] == [
        "nominal",
        THREE_PRESSURES,
        "gauss_newton",
        "rig_truth_of_another_recording",
        "rig_truth",
    ]
    assert all(len(row["rmse"]["values"]) == 2 for row in rows)
    assert study.seeds == (102,)


@pytest.mark.parametrize("twin", ["nominal", THREE_PRESSURES, "gauss_newton"])
def test_no_twin_beats_the_rig_s_own_lines(study, twin):
    # no model can know more about a run than those lines
    best = np.array(study.values("rmse", twin="rig_truth"))
    assert (best < np.array(study.values("rmse", twin=twin))).all()


def test_calibrating_brings_spectra_nearer_on_held_out_recordings(study):
    nominal = np.mean(study.values("sve", twin="nominal"))
    calibrated = np.mean(study.values("sve", twin=THREE_PRESSURES))
    assert calibrated < 0.8 * nominal


def test_the_study_lists_interval_and_truth_of_every_value(study):
    intervals = study.details["intervals"]
    assert set(intervals) == {THREE_PRESSURES, "gauss_newton"}

    # two pumps with six interface values each
    values = intervals[THREE_PRESSURES]["single"]
    assert len(values) == intervals[THREE_PRESSURES]["values"] == 12
    for value in values:
        low, high = value["interval"]
        assert value["held"] == (low <= value["truth"] <= high)
        assert value["factor"] == pytest.approx((high / low) ** 0.5)


def test_the_study_counts_the_values_that_are_called_identified(study):
    intervals = study.details["intervals"][THREE_PRESSURES]
    identified = [value for value in intervals["single"] if value["verdict"] == "identified"]
    assert len(identified) == intervals["identified"]

    # a nominal twin has no intervals
    assert math.isnan(study.values("coverage", twin="nominal")[0])


def test_the_origin_says_that_the_rig_is_no_machine(study):
    assert "stand-in for a machine" in study.origin


def test_lines_of_the_rig_s_truth_are_those_that_are_measured():
    size = RigSize(specimens=1, repeats=1)
    recording, run = next(iter(rig_recordings(7, size, labels=("normal",))))
    assert recording.condition is not None
    assert true_values(run).shape == (6,)

    orders = np.array([28, 35, 42])
    measured = order_spectrum(
        recording.signal, recording.sample_rate, recording.condition.shaft_frequency, orders
    ).amplitude
    truth = np.abs(sensor_lines(run)[:, orders - 1])

    # weaker lines drown in the noise of the rig
    is_loud = truth > 0.3
    assert is_loud.any()
    np.testing.assert_allclose(measured[is_loud], truth[is_loud], rtol=0.1)


@pytest.mark.parametrize(
    ("changes", "name"),
    [
        ({"label": "piston"}, "piston"),
        ({"repeats": 1}, "repeats"),
        ({"contenders": ("magic",)}, "magic"),
    ],
)
def test_invalid_settings_are_refused_by_name(changes, name):
    with pytest.raises(InputError, match=name):
        CalibrationStudySettings(**changes)
