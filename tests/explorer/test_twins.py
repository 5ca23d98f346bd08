"""The twin's room: lines over measured ones, a calibration that is stopped, saved and used."""

import base64
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from explored import HEALTHY, WORN, open_explorer, read_workspace, send
from starlette.testclient import TestClient

from swashtwin.calibration import load_calibration

SETTING = {"start": "25scy14-1b", "recording": HEALTHY}


def request_lines(client: TestClient, **changes: object) -> dict[str, Any]:
    """Return the twin's lines at the healthy recording, with some settings changed."""
    answer = send(client, "/api/twin_lines", {**SETTING, **changes})
    assert answer.status_code == 200, answer.text
    return answer.json()


def test_a_twin_starts_from_a_shipped_pump_or_a_calibration_in_the_folder(
    client: TestClient, folder: Path
) -> None:
    (folder / "mine.json").write_text('{"format": "swashtwin calibration 7"}')
    (folder / "other.json").write_text("{}")

    answer = client.get("/api/twin_starts").json()

    # the user's own files come first
    assert answer["starts"][0] == "mine.json"
    assert "25scy14-1b" in answer["starts"]
    # which is no calibration
    assert "other.json" not in answer["starts"]
    assert {"swash_plate", "piston"} <= {fault["kind"] for fault in answer["faults"]}


def test_a_stiffer_film_changes_the_lines_and_the_misfit(client: TestClient) -> None:
    nominal = request_lines(client)
    values = nominal["values"]
    assert values == nominal["nominal"]
    # stiffness between block and valve plate
    values[3] *= 2

    stiffer = request_lines(client, values=values)

    assert not np.allclose(nominal["amplitude"], stiffer["amplitude"], rtol=0.01)
    assert nominal["measured"]["error"] != stiffer["measured"]["error"]


def test_a_healthy_pump_is_compared_at_the_multiples_of_its_pistons(client: TestClient) -> None:
    orders = request_lines(client)["measured"]["orders"]
    assert orders == [7 * multiple for multiple in range(1, len(orders) + 1)]


def test_the_pressure_of_the_twin_can_be_changed(client: TestClient) -> None:
    assert request_lines(client, mpa=20.0)["mpa"] == pytest.approx(20)


def test_a_fault_of_one_piston_is_compared_at_every_order(client: TestClient) -> None:
    worn = request_lines(client, recording=WORN, fault="piston", dimensions={"clearance": 60e-6})
    assert 1 in np.diff(worn["measured"]["orders"])


def test_the_drawing_marks_the_faulty_part(client: TestClient) -> None:
    request = {"label": "piston", "pistons": 7, "shaft": 14.3}
    drawing = client.get("/api/twin_cutaway", params=request).json()["html"]
    assert "marked: piston" in drawing


def test_the_pump_turns_with_the_fault_of_the_sliders(client: TestClient) -> None:
    worn = request_lines(client, fault="piston", dimensions={"clearance": 60e-6})["turn"]

    assert worn["fault"]["piston"] == 0
    assert "60 µm" in worn["fault"]["sentence"]
    assert worn["chamber"] != request_lines(client)["turn"]["chamber"]


def test_a_dimension_that_the_fault_lacks_is_refused(client: TestClient) -> None:
    setting = {**SETTING, "fault": "piston", "dimensions": {"size": 1.0}}
    answer = send(client, "/api/twin_lines", setting)
    assert "no dimension 'size'" in answer.json()["detail"]


@pytest.mark.parametrize(
    "start",
    [
        pytest.param("../x.json", id="parent folder"),
        pytest.param("/etc/passwd", id="absolute path"),
        pytest.param("recordings.toml", id="index"),
        pytest.param("result", id="result of no calibration"),
    ],
)
def test_only_a_pump_or_a_calibration_can_be_a_start(client: TestClient, start: str) -> None:
    answer = send(client, "/api/twin_lines", {"start": start})
    assert "There is no pump or calibration" in answer.json()["detail"]


NAMEPLATE = {
    "displacement": "45 cm3/rev",
    "pistons": "9",
    "speed": "1500 rpm",
    "pressure": "280 bar",
}


def test_a_pump_made_from_a_nameplate_is_a_start(client: TestClient, folder: Path) -> None:
    answer = send(client, "/api/twin_pump", {"name": "a45", "plate": NAMEPLATE}).json()

    assert answer["start"] in answer["starts"]
    assert (folder / "a45.toml").is_file()
    assert request_lines(client, start="a45.toml", recording="")["pistons"] == 9


def test_a_new_pump_neither_replaces_a_file_nor_leaves_the_folder(
    client: TestClient, folder: Path
) -> None:
    send(client, "/api/twin_pump", {"name": "a45", "plate": NAMEPLATE})
    original_pump = (folder / "a45.toml").read_bytes()

    again = send(client, "/api/twin_pump", {"name": "a45", "plate": NAMEPLATE})
    assert "already exists" in again.json()["detail"]
    assert (folder / "a45.toml").read_bytes() == original_pump

    outside = send(client, "/api/twin_pump", {"name": "../b", "plate": NAMEPLATE})
    assert outside.status_code == 422
    assert not (folder.parent / "b.toml").exists()


def wait_for_calibration(client: TestClient) -> str:
    """Return the state in which a calibration ends, or `running` after 200 s."""
    deadline = time.monotonic() + 200
    state = "running"
    while state == "running" and time.monotonic() < deadline:
        time.sleep(0.05)
        state = client.get("/api/twin_job").json()["state"]
    return state


@pytest.mark.nightly
def test_one_calibration_at_a_time_runs_until_it_is_stopped(client: TestClient) -> None:
    first = send(client, "/api/twin_calibrate", {"setting": SETTING, "comparable": False})
    assert first.json()["state"] == "running"

    second = send(client, "/api/twin_calibrate", {"setting": SETTING})
    assert second.status_code == 422

    send(client, "/api/twin_stop", {})
    assert wait_for_calibration(client) == "stopped"


@pytest.mark.nightly
def test_a_calibration_is_saved_and_makes_windows(client: TestClient, folder: Path) -> None:
    # after one that was stopped
    send(client, "/api/twin_calibrate", {"setting": SETTING, "comparable": False})
    send(client, "/api/twin_stop", {})
    assert wait_for_calibration(client) == "stopped"

    send(client, "/api/twin_calibrate", {"setting": SETTING, "comparable": True})
    assert wait_for_calibration(client) == "done"
    result = request_lines(client, start="result")
    assert len(result["estimates"]) == 6
    assert result["measured"]["error"] < request_lines(client)["measured"]["error"]

    saved = send(client, "/api/twin_save", {"name": "mine"})
    assert saved.json() == {"file": "mine.json"}
    # the comparable recording is used too
    assert len(load_calibration(folder / "mine.json").recording_ids) == 2
    again = send(client, "/api/twin_save", {"name": "mine"})
    assert "already exists" in again.json()["detail"]

    worn = {**SETTING, "start": "mine.json", "fault": "piston"}
    request = {"setting": worn, "name": "worn", "count": 3}
    assert send(client, "/api/twin_windows", request).json()["label"] == "piston"
    assert (folder / "worn.safetensors").is_file()


def unpacked(packed: dict[str, Any]) -> np.ndarray:
    """Return the rows of packed numbers, as the script does."""
    integers = np.frombuffer(base64.b64decode(packed["integers"]), "<i2")
    return packed["factor"] * integers.reshape(packed["rows"], -1)


def test_the_measured_turn_lies_at_the_shaft_angle_of_the_twin(client: TestClient) -> None:
    answer = request_lines(client)
    twin = unpacked(answer["turn"]["waveform"])
    measured = unpacked(answer["turn"]["measured"]["waveform"])

    assert answer["turn"]["measured"]["channels"] == answer["channels"]
    at_twin_angles = np.stack(
        [
            np.interp(
                np.linspace(0, 1, twin.shape[1], endpoint=False),
                np.linspace(0, 1, measured.shape[1], endpoint=False),
                row,
                period=1.0,
            )
            for row in measured
        ]
    )
    # no other angle of the shaft fits better
    correlations = [
        float((np.roll(at_twin_angles, shift, axis=1) * twin).sum())
        for shift in range(twin.shape[1])
    ]
    assert correlations[0] == pytest.approx(max(correlations), rel=1e-3)
    assert "mean of " in answer["turn_source"]
    assert "correlation 0." in answer["turn_source"]


def test_without_a_recording_only_the_twin_has_a_waveform(client: TestClient) -> None:
    answer = request_lines(client, recording="")
    assert answer["turn"]["measured"] is None
    assert answer["turn_source"] == ""


def test_pressures_are_shown_in_the_unit_of_the_explorer(folder: Path) -> None:
    client = open_explorer(read_workspace(folder), pressure_unit="bar")
    in_mpa = open_explorer(read_workspace(folder))

    assert 'data-pressure-unit="bar"' in client.get("/").text
    in_bar = unpacked(request_lines(client)["turn"]["discharge"])
    assert in_bar == pytest.approx(10 * unpacked(request_lines(in_mpa)["turn"]["discharge"]))
    # a setting, and so a link to the page, keeps its unit
    assert request_lines(client, mpa=20.0)["mpa"] == pytest.approx(20)
