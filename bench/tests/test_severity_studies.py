"""Studies of fault severity on trends of the virtual rig's pumps, as tables and figures."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from swashtwin.calibration import GaussNewton
from swashtwin.pump import BoreDefect, GrooveErosion, SwashPlateDefect
from swashtwin.recordings import Recording
from swashtwin_bench import StudyTable, Work, write_study_report
from swashtwin_bench.questions import severity as study
from swashtwin_bench.questions.severity import SeverityStudySettings, _Case, _values
from swashtwin_bench.rigs.courses import TRENDS, trend_recordings
from swashtwin_bench.rigs.measuring import Run

CASE = _Case(
    kind="piston",
    dimension="clearance",
    seed=2,
    specimen="A",
    recording_id="a",
    truth=6e-5,
    estimate=6e-5,
    low=5e-5,
    high=7e-5,
    verdict="identified",
    detected=True,
    limit=2e-5,
    wall_s=1.0,
)
"""A clearance that is detected and estimated without error."""


@pytest.fixture(autouse=True, scope="module")
def _short_recordings() -> Iterator[None]:
    """Make recordings of 1.5 s and calibrate each twin from a single start."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study, "trend_recordings", partial(trend_recordings, duration=1.5))
        patch.setattr(study, "GaussNewton", partial(GaussNewton, starts=1))
        yield


@pytest.fixture
def severity(monkeypatch: pytest.MonkeyPatch) -> StudyTable:
    """The study of a single pump and fault."""
    only_recess = {"swash_plate": TRENDS["swash_plate"]}
    for module in ("questions.severity", "rigs.courses"):
        monkeypatch.setattr(f"swashtwin_bench.{module}.TRENDS", only_recess)
    monkeypatch.setattr(study, "PUMPS", ("A",))

    return study.severity(Work((7,)), SeverityStudySettings((1.0,)))


# ---- trends of the rig


@pytest.fixture(scope="module")
def trend() -> list[tuple[Recording, Run]]:
    """One healthy recording of pump B, then each fault at half and at twice the typical severity."""
    return list(trend_recordings(3, "B", severities=(0.5, 2.0), healthy=1, duration=0.2))


def test_a_trend_has_healthy_recordings_and_then_the_faults_of_one_pump(
    trend: list[tuple[Recording, Run]],
) -> None:
    labels = [recording.label for recording, _ in trend]
    assert labels[:3] == ["normal", "swash_plate", "swash_plate"]
    assert {recording.specimen for recording, _ in trend} == {"B"}


def test_a_severity_scales_the_dimensions_of_a_fault(trend: list[tuple[Recording, Run]]) -> None:
    faults = [run.fault for _, run in trend]

    # the severities are 0.5 and 2, so the second recess is four times as deep
    shallow, deep = (fault for fault in faults if isinstance(fault, SwashPlateDefect))
    assert deep.depth == pytest.approx(4 * shallow.depth)

    # twice the typical advance of 5 deg is 0.175 rad
    advances = [fault.advance for fault in faults if isinstance(fault, GrooveErosion)]
    assert max(advances) < 0.2


def test_the_widths_of_bores_scatter_within_a_trend(trend: list[tuple[Recording, Run]]) -> None:
    widths = {run.fault.half_width for _, run in trend if isinstance(run.fault, BoreDefect)}
    assert len(widths) == 2


# ---- the study


@pytest.mark.nightly
def test_the_study_names_faults_and_their_dimensions(severity: StudyTable, tmp_path: Path) -> None:
    rows = severity.rows()
    dimensions = [(row["fault"], row["dimension"]) for row in rows]
    assert dimensions == [("swash_plate", "depth"), ("swash_plate", "length")]

    depth = rows[0]
    assert 0 <= depth["coverage"]["mean"] <= 1
    assert depth["error"]["mean"] < 1

    # no reader may take figures of the rig for figures of a machine
    assert "stand-in for a machine" in severity.origin
    page = write_study_report(severity, folder=tmp_path).read_text(encoding="utf-8")
    assert "stand-in for a machine" in page


def test_errors_coverage_and_ranks_are_those_of_the_cases() -> None:
    missed = replace(
        CASE,
        recording_id="b",
        truth=1.2e-4,
        estimate=6e-5,
        low=5e-5,
        high=7e-5,
        detected=False,
    )
    healthy = replace(CASE, recording_id="c", truth=0.0, detected=False)

    values = _values([CASE, missed, healthy])

    # one of the two faults is covered by its interval and detected, and the healthy pump is not
    assert values["coverage"] == 0.5
    assert values["detected"] == 0.5
    assert values["false_alarms"] == 0.0

    # errors are logarithms: 0 and ln(1/2); the truth doubles while the estimate stays
    assert values["bias"] == pytest.approx(np.log(0.5) / 2)
    assert values["change"] == pytest.approx(np.log(2))
    assert values["limit"] == pytest.approx(2e-5 / TRENDS["piston"].severity)
