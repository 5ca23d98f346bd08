"""The study of remaining lives: its courses, its straight line, and what it counts."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from swashtwin_bench.questions import life as study
from swashtwin_bench.questions.life import (
    LIFE_DAYS,
    LifeStudySettings,
    _answer,
    _draw_course,
    _Forecast,
    _straight_line,
    life,
)
from swashtwin_bench.results.runs import Work

FORECAST = _Forecast(
    seed=1,
    kind="piston",
    recordings=6,
    truth=50.0,
    days=60.0,
    interval=(40.0, 90.0),
    reason="",
    line=(55.0, 100.0, 200.0),
    severities=(0.2, 0.3),
    verdicts=("identified", "weak"),
)


def test_a_course_grows_from_its_first_severity_towards_the_limit() -> None:
    settings = LifeStudySettings()
    severities, end_of_life = _draw_course(3, "piston", settings)

    assert severities[0] == settings.first
    assert np.all(np.diff(severities) > 0)
    assert severities[-1] < settings.limit
    assert end_of_life == LIFE_DAYS
    other, _ = _draw_course(4, "piston", settings)
    assert not np.allclose(severities, other)


def test_a_straight_line_meets_the_limit_when_its_points_do() -> None:
    days = np.arange(-50.0, 1.0, 10.0)
    noise = 0.001 * np.array([1, -1, 1, 1, -1, 1])
    low, middle, high = _straight_line(days, 1 + 0.02 * days + noise, limit=2.0)
    assert low < middle < high
    assert middle == pytest.approx(50, rel=0.02)


def test_a_line_that_falls_never_meets_the_limit() -> None:
    days = np.arange(-50.0, 1.0, 10.0)
    noise = 0.001 * np.array([1, -1, 1, 1, -1, 1])
    assert _straight_line(days, 1 - 0.01 * days + noise, limit=2.0) == (np.inf, np.inf, np.inf)


def test_a_forecast_is_counted_by_its_interval() -> None:
    values = FORECAST.values()
    assert (values["known"], values["coverage"], values["width"]) == (1.0, 1.0, 2.25)
    assert values["error"] == pytest.approx(np.log(1.2))
    assert values["line_coverage"] == 0.0

    (answer,) = _answer([FORECAST], LifeStudySettings(at=(6,)))
    assert "1 of 1 lives are stated; 1 of 1 intervals hold the truth" in answer
    (answer,) = _answer([FORECAST], LifeStudySettings(at=(9,)))
    assert answer == "After 9 recordings no remaining life is stated."


def test_a_course_that_is_finished_is_not_computed_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    computed = []

    def forecast(seed: int, kind: str, settings: LifeStudySettings) -> list[_Forecast]:
        computed.append(seed)
        # a straight line may never meet the limit, which JSON must hold too
        return [replace(FORECAST, seed=seed, line=(55.0, np.inf, np.inf))]

    monkeypatch.setattr(study, "_forecast", forecast)
    settings = LifeStudySettings(kinds=("piston",), at=(6,))
    work = Work(seeds=(1, 2), out=tmp_path)
    first = life(work, settings)
    again = life(work, settings)
    assert computed == [1, 2]
    assert again.answer == first.answer


@pytest.mark.nightly
def test_the_study_states_the_life_of_a_worn_piston(tmp_path: Path) -> None:
    settings = LifeStudySettings(kinds=("piston",), worn=5, at=(5,))
    table = life(Work(seeds=(100,), out=tmp_path), settings)
    (trial,) = table.trials
    assert trial.factors == {"fault": "piston", "recordings": "5"}
    assert trial.values["known"] == 1.0
