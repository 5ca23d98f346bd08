"""The suspect of an alarm: named, doubted, or plainly not named; and what was found beside it."""

import json
import sys
import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commandline import run
from plant import AT_15, Plant
from starlette.testclient import TestClient
from tiny_prior import PISTONS, write_prior
from watched_pumps import LEARNING, hum, watch_config, write_hum

from swashtwin.diagnosis import Diagnosis
from swashtwin.foundation import DataError, to_table
from swashtwin.monitoring import (
    History,
    OperatingPointMonitor,
    OperatingPointState,
    WatchConfig,
    run_watch,
)
from swashtwin.monitoring.alarms.baseline import load_baseline
from swashtwin.monitoring.alarms.operating_point import OperatingPoint
from swashtwin.monitoring.alarms.suspect import (
    PriorNotAdaptedError,
    Suspect,
    Suspects,
)
from swashtwin.monitoring.alarms.suspect_severity import SeverityRequest
from swashtwin.monitoring.config.settings import Machine
from swashtwin.monitoring.page.watch_page import build_watch_page
from swashtwin.monitoring.service import severities
from swashtwin.recordings import Recording, write_recording

POINT = OperatingPoint(157.08, None)


def at_speed(seed: int, gain: float = 1.0) -> Recording:
    return hum(seed, gain=gain).replace(attributes={"speed": "1500 rpm"})


def learned(pistons: int | None = PISTONS, count: int = 6) -> OperatingPointState:
    state = None
    for seed in range(count):
        state = (
            OperatingPointMonitor("pump-1", baseline_recordings=5, pistons=pistons)
            .judge(at_speed(seed), state)
            .state
        )
    assert state is not None
    return state


def named(
    machine: Machine,
    recording: Recording,
    state: OperatingPointState,
    point: OperatingPoint = POINT,
) -> Suspect:
    suspects = Suspects()
    try:
        return suspects.name(machine, point, state.baseline, recording)
    except PriorNotAdaptedError as needed:
        suspects.adapt(needed.request)
        return suspects.name(machine, point, state.baseline, recording)


def test_an_alarm_names_its_suspect_and_what_was_found_stands_beside_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_prior(tmp_path / "prior.safetensors", at_speed(98), at_speed(99, 6.0))
    (tmp_path / "damaged.json").write_text("{}", encoding="utf-8")
    facts = f'pistons = {PISTONS}\nprior = "prior.safetensors"\ncalibration = "damaged.json"'
    config = watch_config(tmp_path, '[[channel]]\nkind = "log"', machine=facts)
    for number in range(LEARNING + 10):
        write_hum(
            tmp_path / "incoming" / f"{number:03}.h5",
            number,
            number,
            gain=1.0 if number < LEARNING else 6.0,
        )
    run_watch(config, once=True)
    measure_again(config, 1, "Severity is not measured: killed.", monkeypatch)
    measure_again(config, 1, "Severity is not measured: killed.", monkeypatch)
    measure_again(config, 1, "Severity: 30 um.", monkeypatch, verdict="weak")
    measure_again(config, 0, "Severity: 99 um.", monkeypatch, verdict="weak")
    run_watch(config, once=True)
    command = (
        "watch",
        "event",
        config.path,
        "pump-1",
        "--found",
        "piston 3, 30 um",
        "--maintenance",
        "--json",
    )
    assert json.loads(run(*command).stdout)["found"] == "piston 3, 30 um"
    history = History.open("", config.folder)
    (alarm,) = history.reader.alarms("pump-1")
    assert (alarm.evidence["suspect"]["certainty"], alarm.evidence["suspect"]["label"]) == (
        "sure",
        "piston",
    )
    assert (
        alarm.evidence["suspect"]["recording"] == history.reader.recordings("pump-1", limit=1)[0].id
    )
    assert (alarm.evidence["found"]["text"], alarm.state) == ("piston 3, 30 um", "closed")
    severity = alarm.evidence["severity"]
    assert (severity["label"], severity["recording"]) == (
        "piston",
        alarm.evidence["suspect"]["recording"],
    )
    of_recording = {
        row.state: row.reasons["suspect"] for row in history.reader.recordings("pump-1")
    }
    assert of_recording["alarm"]["probabilities"].keys() == {
        "normal",
        "piston",
        "cylinder_block",
        "other",
    }
    assert of_recording["learning"] is None
    assert history.reader.events("pump-1")[0].note == "found: piston 3, 30 um"
    page = TestClient(build_watch_page(config, history), base_url="http://127.0.0.1:8642")
    page_text = page.get("/alarms/1").text
    assert (
        page_text.index("Suspect: piston")
        < page_text.index("Severity: 30 um.")
        < page_text.index("Finding: piston 3")
    )
    assert page.get("/api/alarms/1").json()["evidence"]["severity"] == severity
    history.close()
    opened, *measured = (config.folder / "alarms.log").read_text(encoding="utf-8").splitlines()
    assert "Suspect: piston (" in opened
    assert all("alarm measured (" in line for line in measured)
    reasons = ("Severity is not measured: ", "not measured: killed.", "Severity: 30 um.")
    assert all(reason in line for reason, line in zip(reasons, measured, strict=True))


def measure_again(
    config: WatchConfig, times: int, sentence: str, monkeypatch: pytest.MonkeyPatch, **answer: str
) -> None:
    """A watch that starts anew measures the severity so many times, however often it looks."""
    requests = []

    def measure_severity(question: SeverityRequest) -> dict[str, Any]:
        requests.append(question)
        return {"label": question.label, "sentence": sentence, "notes": [], **answer}

    monkeypatch.setattr(severities, "measure_severity", measure_severity)
    history = History.open("", config.folder)
    measurer = severities.SeverityMeasurer(config, history)
    measurer.measure_all(threading.Event())
    measurer.measure_all(threading.Event())
    history.close()
    assert len(requests) == times


def test_the_calibrated_twin_measures_the_severity_of_a_suspect(
    plant: Plant, tmp_path: Path
) -> None:
    def measured(
        label: str, worn: Path | None = plant.worn, pistons: int = PISTONS
    ) -> dict[str, object]:
        machine = Machine(name="pump-1", pistons=pistons, calibration=plant.calibration)
        healthy = tuple(plant.worn.parent.glob("A_normal*"))
        return SeverityRequest(machine, label, worn, healthy).measure()

    severity = measured("piston")  # the pump has a recess
    assert severity["verdict"] == "not detected"
    assert severity["sentence"].startswith("Severity, if piston: clearance ")
    assert severity["sentence"].endswith(
        f"not detected; detection limit {severity['detection_limit']:.3g} µm."
    )
    assert severity["interval"][0] == 0 < severity["value"] < severity["interval"][1]
    assert any("calibration is in doubt" in note for note in severity["notes"])
    elsewhere = write_recording(
        at_speed(1).replace(condition=AT_15.replace(discharge_pressure=1e7)), tmp_path / "a.h5"
    )
    for facts, message in (
        ({"label": "other"}, "no fault of the class"),
        ({"label": "piston", "pistons": 9}, "another pump, 25scy14-1b"),
        ({"label": "piston", "worn": None}, "were not kept"),
        (
            {"label": "piston", "worn": elsewhere},
            "is for 860 rpm, 15 MPa, but the recording is at 860 rpm, 10 MPa",
        ),
    ):
        with pytest.raises(DataError, match=message):
            measured(**facts)


def test_nothing_is_found_where_there_was_no_alarm(tmp_path: Path) -> None:
    config = watch_config(tmp_path)
    assert (
        "had no alarm"
        in run("watch", "event", config.path, "pump-1", "--found", "air", code=3).stderr
    )


@pytest.mark.parametrize(
    ("changes", "certainty", "sentence"),
    [
        ({"probabilities": {"piston": 0.9, "normal": 0.1}}, "sure", "Suspect: piston (90 %)."),
        (
            {"probabilities": {"piston": 0.5, "normal": 0.3}},
            "unsure",
            "unsure: piston (50 %), or normal (30 %).",
        ),
        (
            {
                "probabilities": {"piston": 1.0, "normal": 0.0},
                "unknown": True,
                "reasons": ("Unlike.",),
            },
            "unknown",
            "Unl",
        ),
        (
            {"label": "normal", "probabilities": {"normal": 0.9, "piston": 0.1}},
            "unsure",
            "unsure: piston (10 %); the",
        ),
        (
            {"label": None, "no_verdict": "it is short."},
            "none",
            "No suspect is named: it is short.",
        ),
    ],
)
def test_a_suspect_is_as_sure_as_its_prior(
    changes: dict[str, object], certainty: str, sentence: str
) -> None:
    suspect = Suspect.of(replace(Diagnosis("a", "prior", label="piston"), **changes))
    assert suspect.certainty == certainty
    assert sentence in suspect.sentence


def test_where_no_suspect_can_be_named_it_is_said_why(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    state = learned()
    loud = at_speed(50, 6.0)
    damaged = tmp_path / "damaged.safetensors"
    damaged.write_bytes(b"no prior")
    pump = Machine(name="pump-1", pistons=PISTONS)
    for machine, recording, known_state, point, sentence in (
        (Machine(name="pump-1"), loud, state, POINT, "Add pump or pistons"),
        (pump, loud, state, OperatingPoint(None, None), "the speed is not known"),
        (pump, loud, learned(None), POINT, "learned without the piston count"),
        (pump, loud, learned(9), POINT, "learned without the piston count"),
        (pump, loud.slice(0, 1024), learned(9), POINT, "lasts 0.2 s"),
        (pump, loud, state, POINT, "has no channel x, only cover_z"),
        (
            Machine(name="pump-1", pistons=PISTONS, prior=damaged),
            loud,
            state,
            POINT,
            "damaged.safetensors",
        ),
    ):
        suspect = named(machine, recording, known_state, point)
        assert (suspect.certainty, suspect.label) == ("none", None)
        assert sentence in suspect.sentence
    monkeypatch.setattr(sys, "executable", "/no/python")
    assert "could not be adapted (FileNotFoundError)" in named(pump, loud, state).sentence


def test_levels_of_the_prior_are_those_of_the_recordings_that_were_learned(tmp_path: Path) -> None:
    state = None
    for seed in range(7):
        gain = 20.0 if seed == 2 else 1.0
        state = (
            OperatingPointMonitor("pump-1", pistons=PISTONS)
            .judge(at_speed(seed, gain), state)
            .state
        )
        table = json.loads(json.dumps(to_table(state.baseline)).replace("NaN", "null"))
        state = replace(state, baseline=load_baseline(table))
    assert state is not None
    assert state.baseline.dropped == 1
    assert state.baseline.orders.shape == (6, 2 * 77)
    assert np.nanmax(np.ptp(state.baseline.orders, axis=0)) < 1
