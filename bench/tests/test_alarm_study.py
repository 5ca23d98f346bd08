"""The study of the watch's alarm, and the courses of the rig's pumps that it watches."""

from pathlib import Path

import numpy as np
import pytest

from swashtwin.foundation import MPa
from swashtwin_bench import StudyTable, Work, run_study
from swashtwin_bench.questions.alarms import AlarmStudySettings, alarms
from swashtwin_bench.rigs.courses import TRENDS, PlantCourse, plant_course

TINY = AlarmStudySettings(
    pumps=1, healthy=10, worn=16, onset=8, severity=3.0, duration=0.7, learning=5
)


# ---- the study of the alarm


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the finished courses of `study`."""
    return tmp_path_factory.mktemp("alarms")


@pytest.fixture(scope="module")
def study(out: Path) -> StudyTable:
    """The study of one pump of fleet 100."""
    return alarms(Work((100,), out=out), TINY)


@pytest.mark.nightly
def test_a_healthy_course_counts_false_alarms(study: StudyTable) -> None:
    # of ten recordings, five are learned from
    assert study.values("watched", course="healthy") == [5.0]
    assert study.values("false_alarms", course="healthy") == [0.0]
    assert "0 false alarms in 5 recordings watched (0, 95 % interval 0 to 0.52)" in study.answer[0]


@pytest.mark.nightly
def test_each_faulty_course_reports_when_its_alarm_came(study: StudyTable) -> None:
    assert {trial.factors["course"] for trial in study.trials} == {"healthy", *TRENDS}
    # a course ends at severity 3
    severities = [trial.values["alarm_at"] for trial in study.trials]
    assert 0 < np.nanmin(severities) <= 3


@pytest.mark.nightly
def test_the_answer_counts_the_alarms_and_the_faults_that_they_name(study: StudyTable) -> None:
    alarmed = [trial.values for trial in study.trials if np.isfinite(trial.values["delay"])]
    assert alarmed
    assert all(values["named_right"] <= values["likeliest_right"] <= 1 for values in alarmed)
    assert f" of {len(alarmed)} (" in study.answer[-1]


@pytest.mark.nightly
def test_finished_courses_are_read_and_not_recorded_again(study: StudyTable, out: Path) -> None:
    # a marked result shows which numbers the second study takes
    for path in out.rglob("result.json"):
        text = path.read_text(encoding="utf-8")
        path.write_text(text.replace('"watched": 5.0', '"watched": 77.0'), encoding="utf-8")

    again = alarms(Work((100,), out=out), TINY)
    assert again.values("watched", course="healthy") == [77.0]
    delay = study.values("delay", course="piston")
    assert again.values("delay", course="piston") == pytest.approx(delay, nan_ok=True)


@pytest.mark.nightly
def test_the_study_of_the_detector_counts_the_odd_recordings_that_were_left_out() -> None:
    study = run_study("detector", work=Work((100,)), settings={"pumps": 1, "duration": 0.7})
    row = {"two odd ones": "bursts"}
    assert study.values("healthy", **row) == [32.0]
    assert study.values("left_out", **row) == [2.0]


# ---- courses of the rig's pumps


def test_the_recordings_of_a_course_do_not_depend_on_the_batch() -> None:
    course = PlantCourse(recordings=5, kind="piston", onset=2, duration=0.2)
    in_twos = plant_course(100, "A", course, batch=2)
    at_once = plant_course(100, "A", course, batch=5)

    for (first, first_severity), (second, second_severity) in zip(in_twos, at_once, strict=True):
        assert first_severity == second_severity
        np.testing.assert_array_equal(first.signal, second.signal)


def test_a_fault_grows_evenly_from_its_onset_to_the_last_recording() -> None:
    course = PlantCourse(recordings=6, kind="piston", onset=2, severity=2.0)
    assert course.severities().tolist() == [0, 0, 0.5, 1.0, 1.5, 2.0]


def test_recordings_have_the_label_of_the_fault_from_its_onset_on() -> None:
    course = PlantCourse(recordings=4, kind="piston", onset=2, duration=0.2)
    labels = [recording.label for recording, _ in plant_course(100, "A", course)]
    assert labels == ["normal", "normal", "piston", "piston"]


def test_a_course_states_what_was_set_and_drifts_within_the_operating_point() -> None:
    # 90 recordings are 30 days at three a day
    pairs = plant_course(100, "A", PlantCourse(recordings=90, duration=0.05))
    conditions = [recording.condition for recording, _ in pairs if recording.condition]
    assert {condition.discharge_pressure for condition in conditions} == {MPa(10)}

    # temperature drifts over days: successive recordings differ by less than the whole range
    temperature = np.array([condition.oil_temperature for condition in conditions])
    assert np.ptp(temperature) > 8
    assert np.abs(np.diff(temperature)).mean() < 0.5 * np.ptp(temperature)
