"""The study of planned recordings pairs plan and random choice by pump, and keeps finished sequences."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commandline import run_json

import swashtwin.bench.questions.next_recording as study
from swashtwin.foundation import InputError, MPa, rpm


def test_falls_are_paired_by_pump_and_draws_averaged(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def sequence(kind: str, seed: int, way: str, added: int) -> dict[str, Any]:
        step = 2.5 if way == "plan" else (0.8 if way == "random 1" else 1.2)
        widths = [10.0 - min(step * count, 4.0) + 0.01 * seed for count in range(added + 1)]
        return {"widths": widths, "covered": [6] * (added + 1), "recorded": [kind] * (added + 1)}

    monkeypatch.setattr(study, "_sequence", sequence)
    words = ("bench", "next-recording", "--seeds", "100,101,102", "--pumps", "own", "--out", tmp_path)
    table = run_json(*words)
    rows = {(row["choice"], row["recordings"]): row for row in table["rows"]}
    assert rows["plan", "2"]["fall"]["values"] == pytest.approx([2.5] * 3)
    assert rows["random", "2"]["fall"]["values"] == pytest.approx([1.0] * 3)
    assert "2.50 times as much" in table["answer"][0]
    assert "less 2 times random: 0.50 to 0.50" in table["answer"][0]
    assert "1 planned less 2 drawn recordings: the width falls by 0.50 more, 0.50 to 0.50" in table["answer"][-1]

    def refuse(*_: object) -> None:
        raise InputError("recorded again")

    monkeypatch.setattr(study, "_sequence", refuse)
    assert run_json(*words)["rows"] == table["rows"]


@pytest.mark.parametrize("kind", study.PUMPS)
def test_a_planned_recording_is_a_candidate_and_is_taken(monkeypatch: pytest.MonkeyPatch, kind: str) -> None:
    for name, value in {"SPEEDS": (rpm(1200),), "PRESSURES": (MPa(10), MPa(15)), "DURATIONS": (1.3,)}.items():
        monkeypatch.setattr(study, name, value)
    monkeypatch.setattr(study, "SETS", study.SETS[:2])
    monkeypatch.setattr(study, "FIRST", study.Choice(rpm(860), MPa(10), 1.3))
    result = study._sequence(kind, 100, "plan", 1)
    assert result["recorded"][0] == "860 rpm, 10 MPa, 1.3 s, cover_z body_y body_x"
    assert result["recorded"][1] in [choice.name for choice in study.choices_of(kind)]
    assert len(result["widths"]) == len(result["covered"]) == 2
    assert np.isfinite(result["widths"]).all()


def test_a_pump_of_the_rig_is_not_assembled_anew() -> None:
    pump = study._RigPump(100)
    truths = [pump.record(study.Choice(rpm(speed), MPa(10), 1.3), 1)[1] for speed in (860, 1200)]
    np.testing.assert_allclose(truths[0], truths[1], rtol=0.01)


def test_unknown_pumps_are_refused() -> None:
    with pytest.raises(InputError, match="must be of own, rig"):
        study.run_next_recording(pumps=["mine"])
