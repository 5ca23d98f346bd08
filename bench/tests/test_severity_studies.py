"""Studies of severities and of what moves, on the virtual rig, told as tables and figures."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from swashtwin.calibration import GaussNewton
from swashtwin.pump import BoreDefect, GrooveErosion, SwashPlateDefect
from swashtwin_bench import StudyTable, Work, write_study_report
from swashtwin_bench.questions import severity as study
from swashtwin_bench.questions.severity import SeverityStudySettings, _Case, _values
from swashtwin_bench.rigs.courses import TRENDS, trend_recordings

CASE = _Case(
    "piston", "clearance", 2, "A", "a", 6e-5, 6e-5, 5e-5, 7e-5, "identified", True, 2e-5, 1.0
)


@pytest.fixture(autouse=True, scope="module")
def _short_recordings() -> Iterator[None]:
    """Studies on recordings of 1.5 s, each twin calibrated from a single start."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            "swashtwin_bench.questions.severity.trend_recordings",
            partial(trend_recordings, duration=1.5),
        )
        patch.setattr(
            "swashtwin_bench.questions.severity.GaussNewton", partial(GaussNewton, starts=1)
        )
        yield


@pytest.fixture
def severity(monkeypatch: pytest.MonkeyPatch) -> StudyTable:
    """The study of a single pump and fault."""
    for module in ("questions.severity", "rigs.courses"):
        monkeypatch.setattr(
            f"swashtwin_bench.{module}.TRENDS", {"swash_plate": TRENDS["swash_plate"]}
        )
    monkeypatch.setattr("swashtwin_bench.questions.severity.PUMPS", ("A",))
    return study.severity(Work((7,)), SeverityStudySettings((1.0,)))


def test_a_trend_holds_healthy_recordings_then_rising_faults_of_one_pump() -> None:
    pairs = list(trend_recordings(3, "B", severities=(0.5, 2.0), healthy=1, duration=0.2))
    assert [recording.label for recording, _ in pairs[:3]] == [
        "normal",
        "swash_plate",
        "swash_plate",
    ]
    assert {recording.specimen for recording, _ in pairs} == {"B"}
    recess = [run.fault for _, run in pairs if isinstance(run.fault, SwashPlateDefect)]
    assert recess[1].depth == pytest.approx(4 * recess[0].depth)
    widths = {run.fault.half_width for _, run in pairs if isinstance(run.fault, BoreDefect)}
    assert len(widths) == 2
    assert max(run.fault.advance for _, run in pairs if isinstance(run.fault, GrooveErosion)) < 0.2


@pytest.mark.nightly
def test_the_study_of_severities_names_faults_and_dimensions(
    severity: StudyTable, tmp_path: Path
) -> None:
    rows = severity.rows()
    assert [(row["fault"], row["dimension"]) for row in rows] == [
        ("swash_plate", "depth"),
        ("swash_plate", "length"),
    ]
    assert 0 <= rows[0]["coverage"]["mean"] <= 1
    assert rows[0]["error"]["mean"] < 1
    assert "stand-in for a machine" in severity.origin
    page = write_study_report(severity, folder=tmp_path).read_text(encoding="utf-8")
    assert "stand-in for a machine" in page


def test_errors_coverage_and_ranks_are_those_of_the_cases() -> None:
    other = replace(
        CASE, recording_id="b", truth=1.2e-4, estimate=6e-5, low=5e-5, high=7e-5, detected=False
    )
    healthy = replace(CASE, recording_id="c", truth=0.0, detected=False)
    values = _values([CASE, other, healthy])
    assert values["coverage"] == 0.5
    assert values["detected"] == 0.5
    assert values["false_alarms"] == 0.0
    assert values["bias"] == pytest.approx(np.log(0.5) / 2)
    assert values["change"] == pytest.approx(np.log(2))
    assert values["limit"] == pytest.approx(2e-5 / TRENDS["piston"].severity)
