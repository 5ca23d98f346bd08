"""What `swashtwin evaluate` prints of a model that raises alarms."""

from dataclasses import replace

import pytest

from swashtwin.cli.models import _print_alarm_scores
from swashtwin.diagnosis import AlarmScores
from swashtwin.diagnosis.alarm_scores import ClassAlarms

PISTON = ClassAlarms(
    label="piston",
    is_healthy=False,
    n_recordings=12,
    n_no_verdict=2,
    n_alarms=9,
    n_correct=None,
    alarm_rate=0.75,
    interval=(0.5, 0.9),
    auroc=0.98,
    no_verdict="the recording is short.",
)


def printed_lines(scores: AlarmScores, capsys: pytest.CaptureFixture[str]) -> list[str]:
    _print_alarm_scores(scores)
    return [line for text in capsys.readouterr() for line in text.splitlines()]


def test_alarms_of_a_detector_are_a_row_of_each_class(capsys: pytest.CaptureFixture[str]) -> None:
    healthy = replace(PISTON, label="normal", is_healthy=True, n_alarms=1, no_verdict="")
    lines = printed_lines(AlarmScores(0.05, (healthy, PISTON)), capsys)

    assert any("false-alarm rate of 0.05" in line for line in lines)
    (row,) = [line.split() for line in lines if line.split()[:1] == ["piston"]]
    assert row[:4] == ["piston", "12", "2", "9"]
    assert " ".join(row).endswith("0.50 to 0.90 0.98")
    note = "note: no verdict on recordings of piston: the recording is short."
    assert note in " ".join(" ".join(lines).split())


def test_alarms_of_a_prior_state_how_many_faults_were_named_right(
    capsys: pytest.CaptureFixture[str],
) -> None:
    lines = printed_lines(AlarmScores(None, (replace(PISTON, n_correct=8),)), capsys)

    assert not any("false-alarm rate" in line for line in lines)
    (row,) = [line.split() for line in lines if line.split()[:1] == ["piston"]]
    assert row[-1] == "8"
