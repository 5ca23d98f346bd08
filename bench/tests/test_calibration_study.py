"""The study of calibration methods holds twins against recordings they never saw, and intervals
against the truth.
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

NAMES = ("calibrated", "gauss_newton")


@pytest.fixture(autouse=True, scope="module")
def _quick() -> Iterator[None]:
    """Calibrations from a single start on recordings of 1.5 s."""
    quick = {
        **CONTENDERS,
        **{name: replace(CONTENDERS[name], method=GaussNewton(starts=1)) for name in NAMES},
    }
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("swashtwin_bench.questions.calibration.CONTENDERS", quick)
        patch.setattr(
            "swashtwin_bench.questions.calibration.RigSize", partial(RigSize, duration=1.5)
        )
        yield


@pytest.fixture(scope="module")
def study(_quick: None) -> StudyTable:
    return calibration(
        Work((7,)), CalibrationStudySettings(specimens=2, repeats=2, contenders=NAMES)
    )


def test_each_twin_has_a_trial_for_each_pump(study):
    twins = [row["twin"] for row in study.rows()]
    assert twins == [
        "nominal",
        "calibrated",
        "gauss_newton",
        "rig_truth_of_another_recording",
        "rig_truth",
    ]
    assert all(len(row["rmse"]["values"]) == 2 for row in study.rows())
    assert study.seeds == (7,)


def test_no_twin_beats_the_rig_s_own_lines(study):
    for index in range(2):
        best = study.values("rmse", twin="rig_truth")[index]
        others = [
            study.values("rmse", twin=name)[index]
            for name in ("nominal", "calibrated", "gauss_newton")
        ]
        assert best < min(others)


def test_calibrating_brings_spectra_nearer_on_recordings_held_out(study):
    nominal, calibrated = (
        np.mean(study.values("sve", twin=name)) for name in ("nominal", "calibrated")
    )
    assert calibrated < 0.8 * nominal


def test_the_study_holds_intervals_and_verdicts_of_every_value(study):
    intervals = study.details["intervals"]
    assert set(intervals) == {"calibrated", "gauss_newton"}
    single = intervals["calibrated"]["single"]
    assert len(single) == intervals["calibrated"]["values"] == 12
    for row in single:
        low, high = row["interval"]
        assert row["held"] == (low <= row["truth"] <= high)
    sure = [row for row in single if row["verdict"] == "identified"]
    assert len(sure) == intervals["calibrated"]["identified"]
    assert math.isnan(study.values("coverage", twin="nominal")[0])


def test_the_origin_says_that_the_rig_is_no_machine(study):
    assert "stand-in for a machine" in study.origin


def test_lines_of_the_rig_s_truth_are_those_that_are_measured():
    ((recording, run), *_) = rig_recordings(7, RigSize(specimens=1, repeats=1), labels=("normal",))
    lines = sensor_lines(run)
    orders = np.array([28, 35, 42])
    assert recording.condition is not None
    spectrum = order_spectrum(
        recording.signal, recording.sample_rate, recording.condition.shaft_frequency, orders
    )
    loud = np.abs(lines[:, orders - 1]) > 0.3
    assert loud.any()
    np.testing.assert_allclose(
        spectrum.amplitude[loud], np.abs(lines[:, orders - 1])[loud], rtol=0.1
    )
    assert true_values(run).shape == (6,)


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"label": "piston"}, "piston"),
        ({"repeats": 1}, "repeats"),
        ({"contenders": ("magic",)}, "magic"),
    ],
)
def test_settings_that_cannot_be_are_refused_by_name(changes, named):
    with pytest.raises(InputError, match=named):
        CalibrationStudySettings(**changes)
