"""The study of the watch's alarm, and the courses of the rig's pumps that it watches."""

from pathlib import Path

import numpy as np
import pytest

from swashtwin.foundation import MPa
from swashtwin_bench import Work, run_study
from swashtwin_bench.questions.alarms import AlarmStudySettings, alarms
from swashtwin_bench.rigs.courses import TRENDS, PlantCourse, plant_course

TINY = AlarmStudySettings(
    pumps=1, healthy=10, worn=16, onset=8, severity=3.0, duration=0.7, learning=5
)


@pytest.mark.nightly
def test_the_study_counts_false_alarms_says_when_each_alarm_came_and_reads_finished_courses(
    tmp_path: Path,
) -> None:
    study = alarms(Work((100,), out=tmp_path), TINY)
    assert study.values("watched", course="healthy") == [5.0]
    assert study.values("false_alarms", course="healthy") == [0.0]
    assert "0 false alarms in 5 recordings watched (0, 95 % interval 0 to 0.52)" in study.answer[0]
    assert {trial.factors["course"] for trial in study.trials} == {"healthy", *TRENDS}
    assert 0 < np.nanmin([trial.values["alarm_at"] for trial in study.trials]) <= 3
    alarmed = [trial.values for trial in study.trials if np.isfinite(trial.values["delay"])]
    assert alarmed
    assert all(values["named_right"] <= values["likeliest_right"] <= 1 for values in alarmed)
    assert f" of {len(alarmed)} (" in study.answer[-1]
    for path in tmp_path.rglob("result.json"):
        path.write_text(
            path.read_text(encoding="utf-8").replace('"watched": 5.0', '"watched": 77.0'),
            encoding="utf-8",
        )
    again = alarms(Work((100,), out=tmp_path), TINY)
    assert again.values("watched", course="healthy") == [77.0]
    assert again.values("delay", course="piston") == pytest.approx(
        study.values("delay", course="piston"), nan_ok=True
    )


@pytest.mark.nightly
def test_the_study_of_the_detector_counts_the_odd_recordings_that_were_left_out() -> None:
    study = run_study("detector", work=Work((100,)), settings={"pumps": 1, "duration": 0.7})
    assert [
        study.values(name, **{"two odd ones": "bursts"}) for name in ("healthy", "left_out")
    ] == [[32.0], [2.0]]


def test_the_recordings_of_a_course_do_not_depend_on_the_batch() -> None:
    course = PlantCourse(recordings=5, kind="piston", onset=2, duration=0.2)
    first, second = (list(plant_course(100, "A", course, batch=batch)) for batch in (2, 5))
    for (recording, severity), (other, same) in zip(first, second, strict=True):
        assert severity == same
        np.testing.assert_array_equal(recording.signal, other.signal)


def test_a_fault_grows_evenly_from_its_onset_to_the_last_recording() -> None:
    course = PlantCourse(recordings=6, kind="piston", onset=2, severity=2.0)
    assert course.severities().tolist() == [0, 0, 0.5, 1.0, 1.5, 2.0]
    pairs = list(
        plant_course(100, "A", PlantCourse(recordings=4, kind="piston", onset=2, duration=0.2))
    )
    assert [recording.label for recording, _ in pairs] == ["normal", "normal", "piston", "piston"]


def test_a_course_states_what_was_set_and_drifts_within_the_operating_point() -> None:
    recordings = [
        recording
        for recording, _ in plant_course(100, "A", PlantCourse(recordings=90, duration=0.05))
    ]
    conditions = [recording.condition for recording in recordings]
    assert {condition.discharge_pressure for condition in conditions if condition} == {MPa(10)}
    temperature = np.array([condition.oil_temperature for condition in conditions if condition])
    assert np.ptp(temperature) > 8
    assert np.abs(np.diff(temperature)).mean() < 0.5 * np.ptp(temperature)
