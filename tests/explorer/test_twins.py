"""The twin's room: lines over measured ones, a calibration that is stopped, saved and used."""

import time
from pathlib import Path

import numpy as np
import pytest
from explored import HEALTHY, WORN, send

from swashtwin.calibration import load_calibration

SETTING = {"start": "25scy14-1b", "recording": HEALTHY}


def lines(client, **changes) -> dict:
    answer = send(client, "/api/twin_lines", {**SETTING, **changes})
    assert answer.status_code == 200, answer.text
    return answer.json()


def test_starts_are_pumps_and_calibrations_beside_the_recordings(client, folder: Path) -> None:
    (folder / "mine.json").write_text('{"format": "swashtwin calibration 7"}')
    (folder / "other.json").write_text("{}")
    starts = client.get("/api/twin_starts").json()
    assert starts["starts"][0] == "mine.json"
    assert "25scy14-1b" in starts["starts"]
    assert "other.json" not in starts["starts"]
    assert {"swash_plate", "piston"} <= {fault["kind"] for fault in starts["faults"]}


def test_a_stiffer_film_moves_lines_and_misfit(client) -> None:
    before = lines(client)
    values = before["values"]
    values[3] *= 2
    after = lines(client, values=values)
    assert before["measured"]["orders"] == [
        7 * k for k in range(1, len(before["measured"]["orders"]) + 1)
    ]
    assert not np.allclose(before["amplitude"], after["amplitude"], rtol=0.01)
    assert before["measured"]["error"] != after["measured"]["error"]
    assert lines(client, mpa=20.0)["mpa"] == pytest.approx(20)


def test_a_fault_brings_its_lines_and_its_drawing(client) -> None:
    worn = lines(client, recording=WORN, fault="piston", dimensions={"clearance": 60e-6})
    assert 1 in np.diff(worn["measured"]["orders"])
    drawing = client.get(
        "/api/twin_cutaway", params={"label": "piston", "pistons": 7, "shaft": 14.3}
    ).json()["html"]
    assert "marked: piston" in drawing
    refused = send(
        client, "/api/twin_lines", {**SETTING, "fault": "piston", "dimensions": {"size": 1.0}}
    )
    assert "no dimension 'size'" in refused.json()["detail"]


@pytest.mark.parametrize("start", ["../x.json", "/etc/passwd", "recordings.toml", "result"])
def test_no_start_leads_out_of_the_folder(client, start: str) -> None:
    answer = send(client, "/api/twin_lines", {"start": start})
    assert "There is no pump or calibration" in answer.json()["detail"]


def test_a_new_pump_of_a_nameplate_is_a_start(client, folder: Path) -> None:
    plate = {
        "displacement": "45 cm3/rev",
        "pistons": "9",
        "speed": "1500 rpm",
        "pressure": "280 bar",
    }
    made = send(client, "/api/twin_pump", {"name": "a45", "plate": plate}).json()
    assert made["start"] in made["starts"]
    assert lines(client, start="a45.toml", recording="")["pistons"] == 9
    assert (
        "already exists"
        in send(client, "/api/twin_pump", {"name": "a45", "plate": plate}).json()["detail"]
    )
    assert send(client, "/api/twin_pump", {"name": "../b", "plate": plate}).status_code == 422
    assert [path.name for path in folder.glob("*.toml")].count("a45.toml") == 1


def finished(client) -> dict:
    end = time.monotonic() + 200
    while (job := client.get("/api/twin_job").json())[
        "state"
    ] == "running" and time.monotonic() < end:
        time.sleep(0.05)
    return job


@pytest.mark.nightly
def test_a_calibration_is_stopped_then_finished_saved_and_used(client, folder: Path) -> None:
    assert (
        send(client, "/api/twin_calibrate", {"setting": SETTING, "comparable": False}).json()[
            "state"
        ]
        == "running"
    )
    assert send(client, "/api/twin_calibrate", {"setting": SETTING}).status_code == 422
    send(client, "/api/twin_stop", {})
    assert finished(client)["state"] == "stopped"
    send(client, "/api/twin_calibrate", {"setting": SETTING, "comparable": True})
    assert finished(client)["state"] == "done"
    shown = lines(client, start="result")
    assert len(shown["estimates"]) == 6
    assert shown["measured"]["error"] < lines(client)["measured"]["error"]
    assert send(client, "/api/twin_save", {"name": "mine"}).json() == {"file": "mine.json"}
    assert len(load_calibration(folder / "mine.json").recording_ids) == 2
    assert "already exists" in send(client, "/api/twin_save", {"name": "mine"}).json()["detail"]
    made = {
        "setting": {**SETTING, "start": "mine.json", "fault": "piston"},
        "name": "worn",
        "count": 3,
    }
    assert send(client, "/api/twin_windows", made).json()["label"] == "piston"
    assert (folder / "worn.safetensors").is_file()
