"""The suspect of an alarm: sure, unsure or not named; its severity, and the reported finding."""

import json
import re
import sys
import threading
from dataclasses import replace
from datetime import timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commandline import run
from judgments import judgment
from plant import AT_15, Plant
from starlette.testclient import TestClient
from tiny_prior import PISTONS, write_prior
from watched_pumps import LEARNING, START, hum, watch_config, write_hum

from swashtwin.diagnosis import Diagnosis, measure_library
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
from swashtwin.monitoring.service.alarm_messages import AlarmPoster, Occasion
from swashtwin.pump import load_pump
from swashtwin.recordings import Recording, write_recording

POINT = OperatingPoint(157.08, None)


def at_speed(seed: int, gain: float = 1.0) -> Recording:
    return hum(seed, gain=gain).replace(attributes={"speed": "1500 rpm"})


def learned(pistons: int | None = PISTONS, count: int = 6) -> OperatingPointState:
    monitor = OperatingPointMonitor("pump-1", baseline_recordings=5, pistons=pistons)
    state = None
    for seed in range(count):
        state = monitor.judge(at_speed(seed), state).state
    assert state is not None
    return state


def name_suspect(
    machine: Machine,
    recording: Recording,
    state: OperatingPointState,
    point: OperatingPoint = POINT,
) -> Suspect:
    suspects = Suspects()
    try:
        return suspects.name(machine, point, state.baseline, recording)
    except PriorNotAdaptedError as error:
        suspects.adapt(error.request)
        return suspects.name(machine, point, state.baseline, recording)


def test_an_alarm_names_its_suspect_its_severity_and_the_reported_finding(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_prior(tmp_path / "prior.safetensors", at_speed(98), at_speed(99, 6.0))
    (tmp_path / "damaged.json").write_text("{}", encoding="utf-8")
    facts = f'pistons = {PISTONS}\nprior = "prior.safetensors"\ncalibration = "damaged.json"'
    config = watch_config(tmp_path, '[[channel]]\nkind = "log"', machine=facts)

    for number in range(LEARNING + 10):
        gain = 1.0 if number < LEARNING else 6.0
        write_hum(tmp_path / "incoming" / f"{number:03}.h5", number, number, gain=gain)

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
    assert alarm.state == "closed"
    assert alarm.evidence["found"]["text"] == "piston 3, 30 um"

    suspect = alarm.evidence["suspect"]
    assert suspect["certainty"] == "sure"
    assert suspect["label"] == "piston"
    assert suspect["recording"] == history.reader.recordings("pump-1", limit=1)[0].id

    severity = alarm.evidence["severity"]
    assert severity["label"] == "piston"
    assert severity["recording"] == suspect["recording"]

    suspect_by_state = {
        row.state: row.reasons["suspect"] for row in history.reader.recordings("pump-1")
    }
    assert suspect_by_state["alarm"]["probabilities"].keys() == {
        "normal",
        "piston",
        "cylinder_block",
        "other",
    }
    assert suspect_by_state["learning"] is None

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
    """Check how often a restarted watch measures the severity, although it looks twice."""
    requests = []

    def measure_severity(question: SeverityRequest, *_: object) -> dict[str, Any]:
        requests.append(question)
        return {"label": question.label, "sentence": sentence, "notes": [], **answer}

    monkeypatch.setattr(severities, "measure_severity", measure_severity)
    history = History.open("", config.folder)
    measurer = severities.SeverityMeasurer(config, history)
    measurer.measure_all(threading.Event())
    measurer.measure_all(threading.Event())
    history.close()

    assert len(requests) == times


@pytest.mark.nightly
def test_a_severity_is_measured_anew_as_the_fault_grows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "any.json").write_text("{}", encoding="utf-8")
    write_prior(tmp_path / "prior.safetensors", at_speed(98), at_speed(99, 6.0))
    facts = f'pistons = {PISTONS}\nprior = "prior.safetensors"\ncalibration = "any.json"'
    config = watch_config(tmp_path, '[[channel]]\nkind = "log"', machine=facts)
    measured_values = []

    def record_at(minute: float, severity: float | None, gain: float = 6.0) -> None:
        """Judge a recording; the twin measures this severity, or fails without one."""

        def measure_severity(request: SeverityRequest, *_: object) -> dict[str, Any]:
            measured_values.append(severity)
            answer = {"label": request.label, "notes": [], "sentence": "Severity is not measured."}
            if severity is not None:
                answer["sentence"] = f"Severity: {severity} um."
                answer |= {"verdict": "identified", "value": severity}
                answer["interval"] = [0.9 * severity, 1.1 * severity]
            return answer

        monkeypatch.setattr(severities, "measure_severity", measure_severity)
        number = len(list(tmp_path.glob("incoming/*.h5")))
        write_hum(tmp_path / "incoming" / f"{number:03}.h5", number, minute, gain=gain)
        run_watch(config, once=True)

    for number in range(LEARNING + 6):
        gain = 1.0 if number < LEARNING else 6.0
        write_hum(tmp_path / "incoming" / f"{number:03}.h5", number, number, gain=gain)

    record_at(100, 47.0)
    record_at(200, 48.0)
    day = 24 * 60
    record_at(100 + day, 50.0)
    record_at(100 + 10 * day, 120.0)
    record_at(101 + 10 * day, 150.0, gain=16.0)
    record_at(100 + 20 * day, None, gain=16.0)
    assert measured_values == [47.0, 50.0, 120.0, 150.0, None]

    history = History.open("", config.folder)
    (alarm,) = history.reader.alarms("pump-1")
    severity = alarm.evidence["severity"]
    assert severity["value"] == 150.0
    assert severity["time"] == (START + timedelta(minutes=101 + 10 * day)).isoformat()
    assert severity["not_measured"]["time"] == alarm.evidence["suspect"]["time"]

    # each line of the alarm has the date of its recording
    page = TestClient(build_watch_page(config, history), base_url="http://127.0.0.1:8642")
    text = re.sub("<[^>]*>", "", page.get("/alarms/1").text)
    newest, measured = (
        f"{START + timedelta(minutes=minute):%Y-%m-%d %H:%M:%S} UTC"
        for minute in (100 + 20 * day, 101 + 10 * day)
    )
    assert re.search(rf"{newest}\s+Suspect: piston", text)
    assert re.search(rf"{measured}\s+Severity: 150.0 um", text)
    assert re.search(rf"{newest}\s+Severity is not measured", text)
    assert f"Newest deviating recording, {newest}" in text
    raised = f"{alarm.opened:%Y-%m-%d %H:%M:%S} UTC"
    assert f"Recording that raised the alarm, {raised}" in text
    history.close()

    # a message only if the severity lies outside of the previous interval
    lines = (config.folder / "alarms.log").read_text(encoding="utf-8").splitlines()
    reported = [line for line in lines if "alarm measured (" in line]
    assert [sentence in line for sentence, line in zip(("47", "120", "150"), reported, strict=True)]


def test_a_message_dates_what_another_recording_showed(tmp_path: Path) -> None:
    config = watch_config(tmp_path, '[[channel]]\nkind = "log"')
    history = History.open("", config.folder)
    newest = judgment(24)
    facts = {
        "suspect": {"sentence": "Suspect: piston.", "time": newest.time.isoformat()},
        "severity": {"sentence": "Severity: 30 um.", "time": judgment(0).time.isoformat()},
    }
    with history.machine("pump-1") as transaction:
        transaction.add_recording(newest)
        alarm = transaction.open_alarm("pump", newest.point, newest.time, facts, newest.id)
        occasion = Occasion(newest.time, newest.received, newest.content)
        AlarmPoster(config).post(transaction, "measured", alarm, occasion, ())

    (message,) = history.outbox.claim(["log"])
    assert message.body["reasons"] == [
        "Suspect: piston.",
        "Recording of 2026-03-01 06:00 UTC: Severity: 30 um.",
    ]
    history.close()


@pytest.mark.nightly
def test_the_calibrated_twin_measures_the_severity_of_a_suspect(
    plant: Plant,
) -> None:
    machine = Machine(name="pump-1", pistons=PISTONS, calibration=plant.calibration)
    healthy = tuple(plant.worn.parent.glob("A_normal*"))

    # the fault of this pump is a recess, not worn pistons
    severity = SeverityRequest(machine, "piston", plant.worn, START, healthy).measure()
    assert severity["verdict"] == "not detected"
    assert severity["sentence"].startswith("Severity, if piston: clearance ")
    assert severity["sentence"].endswith(
        f"not detected; detection limit {severity['detection_limit']:.3g} µm."
    )
    assert severity["interval"][0] == 0 < severity["value"] < severity["interval"][1]
    assert any("calibration is in doubt" in note for note in severity["notes"])


def test_a_severity_is_refused_for_what_the_calibration_does_not_hold_for(
    plant: Plant, tmp_path: Path
) -> None:
    def measure(
        label: str = "piston", recording: Path | None = plant.worn, pistons: int = PISTONS
    ) -> None:
        machine = Machine(name="pump-1", pistons=pistons, calibration=plant.calibration)
        SeverityRequest(machine, label, recording, START).measure()

    with pytest.raises(DataError, match="no fault of the class 'other'"):
        measure(label="other")
    with pytest.raises(DataError, match="another pump, 25scy14-1b"):
        measure(pistons=9)
    with pytest.raises(DataError, match="were not kept"):
        measure(recording=None)

    at_10_mpa = at_speed(1).replace(condition=AT_15.replace(discharge_pressure=1e7))
    message = "is for 860 rpm, 15 MPa, but the recording is at 860 rpm, 10 MPa"
    with pytest.raises(DataError, match=message):
        measure(recording=write_recording(at_10_mpa, tmp_path / "a.h5"))


def test_severities_of_an_alarm_tell_how_long_the_pump_lasts() -> None:
    machine = Machine(
        name="pump-1",
        pistons=PISTONS,
        calibration=Path("any.json"),
        severity_limits={"piston": "200 um"},
    )
    course: tuple[dict[str, Any], ...] = ()
    for week in range(6):
        time = START + timedelta(days=7 * week)
        point = {
            "kind": "piston",
            "value": 40e-6 * 1.1**week,
            "interval": [36e-6 * 1.1**week, 44e-6 * 1.1**week],
            "verdict": "identified",
            "repeatability": 0.03,
        }
        request = SeverityRequest(machine, "piston", Path("x.h5"), time=time, course=course)
        answer = request._follow("Severity.", point)
        course = tuple(answer["course"])
        if week == 0:
            assert "not yet known: 4 severities" in answer["sentence"]

    assert len(course) == 6
    low, high = answer["remaining_life"]["interval"]
    # 40 um grows by 10 % in a week: 17 weeks to 200 um
    assert low < 7 * (np.log(5) / np.log(1.1) - 5) < high
    assert answer["sentence"].startswith("Severity. Remaining time until 200 um: ")

    # another kind of fault has no limit here, and does not end the course of this one
    leak = {**point, "kind": "scratched_valve_plate"}
    later = time + timedelta(days=7)
    request = SeverityRequest(machine, "valve_plate", Path("x.h5"), time=later, course=course)
    answer = request._follow("", leak)
    assert len(answer["course"]) == 7
    assert "remaining_life" not in answer

    # a recording that is measured again counts once
    again = SeverityRequest(machine, "piston", Path("x.h5"), time=time, course=course)
    assert len(again._follow("", point)["course"]) == 6


@pytest.mark.parametrize(
    ("before", "after", "is_confirmed"),
    [(None, None, True), (None, 30.0, False), (30.0, 28.0, True), (2.0, 0.0, False)],
)
def test_a_message_is_due_when_the_remaining_time_becomes_known_or_ends(
    before: float | None, after: float | None, is_confirmed: bool
) -> None:
    severity = {
        "label": "piston",
        "certainty": "sure",
        "verdict": "identified",
        "value": 204.0,
        "interval": [170.0, 225.0],
    }
    previous, newer = ({**severity, "remaining_life": {"days": days}} for days in (before, after))
    assert severities._is_confirmed(previous, newer) == is_confirmed


def test_a_finding_is_refused_if_the_machine_had_no_alarm(tmp_path: Path) -> None:
    config = watch_config(tmp_path)
    refusal = run("watch", "event", config.path, "pump-1", "--found", "air", code=3)
    assert "had no alarm" in refusal.stderr


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
    diagnosis = replace(Diagnosis("a", "prior", label="piston", p_value=0.2), **changes)

    suspect = Suspect.of(diagnosis)

    assert suspect.certainty == certainty
    assert sentence in suspect.sentence
    if certainty != "none":
        # The likeliest fault, although a healthy pump may be likelier.
        assert suspect.label == "piston"
        assert suspect.probabilities == diagnosis.probabilities
        assert suspect.p_value == 0.2


def test_the_reason_is_stated_if_no_suspect_can_be_named(
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
        suspect = name_suspect(machine, recording, known_state, point)
        assert suspect.certainty == "none"
        assert suspect.label is None
        assert sentence in suspect.sentence

    monkeypatch.setattr(sys, "executable", "/no/python")
    suspect = name_suspect(pump, loud, state)
    assert "could not be adapted (FileNotFoundError)" in suspect.sentence


def test_a_suspect_learns_from_measured_faults_of_other_machines(tmp_path: Path) -> None:
    # The faults of this prior are in the wrong direction; those of the library are right.
    write_prior(tmp_path / "prior.safetensors", at_speed(99, 6.0), at_speed(98))
    recordings = []
    for number, specimen in enumerate("ABC"):
        for label, gain in (("normal", 1.0), ("piston", 6.0)):
            for seed in range(3):
                member = at_speed(1000 + 100 * number + 10 * int(gain) + seed, gain)
                recordings.append(member.replace(label=label, specimen=specimen))
    library = measure_library(recordings, load_pump("25scy14-1b"))
    machine = Machine(
        name="pump-1",
        pistons=PISTONS,
        prior=tmp_path / "prior.safetensors",
        library=library.save(tmp_path / "pumps.safetensors"),
    )
    loud = at_speed(50, 6.0)
    with pytest.raises(PriorNotAdaptedError) as caught:
        Suspects().name(machine, POINT, learned().baseline, loud)
    model = caught.value.request.adapt()

    assert not model.taught
    assert "A" not in model.specimen
    assert model.diagnose(loud.replace(specimen="pump-1")).label == "piston"
    assert set(library.manifest) <= set(model.manifest)


def test_features_of_the_prior_come_only_from_recordings_kept_in_the_baseline(
    tmp_path: Path,
) -> None:
    monitor = OperatingPointMonitor("pump-1", pistons=PISTONS)
    state = None
    for seed in range(7):
        # one recording is an outlier that the baseline drops
        gain = 20.0 if seed == 2 else 1.0
        state = monitor.judge(at_speed(seed, gain), state).state

        # a restart of the watch stores and loads the baseline
        table = json.loads(json.dumps(to_table(state.baseline)).replace("NaN", "null"))
        state = replace(state, baseline=load_baseline(table))

    assert state is not None
    assert state.baseline.dropped == 1
    assert state.baseline.orders.shape == (6, 2 * 77)
    assert np.nanmax(np.ptp(state.baseline.orders, axis=0)) < 1
