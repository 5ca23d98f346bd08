"""What the explorer's script asks for, and what is refused."""

import base64
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from explored import HEALTHY, WORN, send
from mqtt_broker import free_port
from starlette.testclient import TestClient

from swashtwin.explorer import Workspace, build_explorer


def numbers(text: str) -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), "<f4")


def change(fact: str, previous: str | None, value: str | None, entry: str = HEALTHY) -> dict:
    return {"entry": entry, "fact": fact, "previous": previous, "value": value}


def test_the_table_shows_facts_levels_and_why_a_file_is_broken(client: TestClient) -> None:
    table = client.get("/api/rows").json()
    rows = {row["name"]: row for row in table["rows"]}
    assert table["waiting"] == 0
    assert rows[HEALTHY]["label"] == "normal"
    assert rows[HEALTHY]["rpm"] == pytest.approx(860)
    assert len(rows[HEALTHY]["rms"]) == 40
    assert rows["recordings/broken.h5"]["state"] == "broken"
    assert "broken.h5" in rows["recordings/broken.h5"]["findings"][0]["message"]
    assert client.get(f"/api/rows?since={table['revision']}").json()["rows"] == []


@pytest.mark.parametrize("width", [1, 4, 64, 1024])
def test_extremes_are_those_of_the_samples(
    client: TestClient, workspace: Workspace, width: int
) -> None:
    signal = workspace.recording(HEALTHY).signal
    content = client.get(
        "/api/samples", params={"name": HEALTHY, "width": width, "start": 3, "count": 9}
    ).content
    extremes = np.frombuffer(content, "<f4").reshape(len(signal), 9, 2)
    parts = signal[:, 3 * width : 12 * width].reshape(len(signal), 9, width)
    np.testing.assert_allclose(extremes[..., 0], parts.min(axis=2), rtol=1e-6)
    np.testing.assert_allclose(extremes[..., 1], parts.max(axis=2), rtol=1e-6)


@pytest.mark.parametrize("kind", ["amplitude", "order"])
def test_a_spectrum_has_its_lines_where_the_marks_say_and_its_healthy_range(
    client: TestClient, kind: str
) -> None:
    asked = {"name": WORN, "kind": kind, "pistons": 7, "healthy": True, "bodies": 9, "ratio": 0.2}
    spectrum = client.get("/api/spectrum", params=asked).json()
    amplitude = numbers(spectrum["amplitude"]).reshape(len(spectrum["channels"]), -1)
    at = next(mark[0] for mark in spectrum["marks"] if mark[1] == "7×")
    line = round(at / spectrum["step"])
    near = amplitude[:, line - 5 : line + 6].max(axis=1)
    assert (near > 5 * np.median(amplitude, axis=1)).any()
    assert {"BPFI", "2 FTF", "1×"} <= {mark[1] for mark in spectrum["marks"]}
    assert len(spectrum["healthy"]) == 2
    assert numbers(spectrum["high"]).shape == numbers(spectrum["amplitude"]).shape


def test_a_map_and_the_level_over_time_are_drawn(client: TestClient) -> None:
    for orders in (False, True):
        waterfall = client.get("/api/waterfall", params={"name": WORN, "orders": orders}).json()
        assert (
            len(base64.b64decode(waterfall["shades"])) == waterfall["frames"] * waterfall["bands"]
        )
    assert client.get("/api/rms", params={"name": WORN}).json()["lines"] == 120


def test_the_lines_show_the_speed(client: TestClient) -> None:
    assert client.get("/api/speed", params={"name": HEALTHY, "pistons": 7}).json()[
        "rpm"
    ] == pytest.approx(860, rel=0.02)


def test_a_fact_is_written_and_another_window_that_saw_the_old_one_is_told(
    client: TestClient, folder: Path
) -> None:
    assert (
        send(client, "/api/facts", {"changes": [change("label", "normal", "piston")]}).status_code
        == 200
    )
    refused = send(client, "/api/facts", {"changes": [change("label", "normal", "valve_plate")]})
    assert refused.status_code == 422
    assert "is 'piston' now" in refused.json()["detail"]
    undone = send(
        client, "/api/facts", {"changes": [change("label", "piston", "normal")], "undo": True}
    )
    row = next(row for row in undone.json()["rows"] if row["name"] == HEALTHY)
    assert row["specified"]["label"] == "normal"
    assert send(client, "/api/facts", {"changes": [change("sha256", None, "0")]}).status_code == 422


def test_a_folder_without_an_index_is_asked_about_and_written_with_the_first_fact(
    tmp_path: Path,
) -> None:
    for name in ("normal_1", "normal_2", "piston_1"):
        np.savetxt(
            tmp_path / f"{name}.csv",
            np.random.default_rng(0).normal(size=(4000, 2)),
            delimiter=",",
            header="x,y",
            comments="",
        )
    client = TestClient(build_explorer(Workspace(tmp_path)), base_url="http://127.0.0.1")
    assert {"sample_rate", "unit"} <= client.get("/api/rows").json()["questions"].keys()
    table = send(client, "/api/answers", {"sample_rate": "10 kHz", "unit": "g"}).json()
    assert table["questions"] == {}
    assert table["unwritten"]
    assert not (tmp_path / "recordings.toml").exists()
    edit = {"changes": [change("specimen", None, "A", "normal_1.csv")]}
    assert not send(client, "/api/facts", edit).json()["unwritten"]
    assert 'specimen = "A"' in (tmp_path / "recordings.toml").read_text()


@pytest.mark.parametrize(
    ("headers", "code"),
    [
        ({"host": "evil.example"}, 421),
        ({"origin": "http://evil.example"}, 403),
        ({"sec-fetch-site": "cross-site"}, 403),
        ({}, 403),
        ({"x-explorer": "guessed"}, 403),
    ],
)
def test_strangers_change_nothing(
    client: TestClient, folder: Path, headers: dict[str, str], code: int
) -> None:
    before = (folder / "recordings.toml").read_text()
    edit = {"changes": [change("label", "normal", "piston")]}
    assert client.post("/api/facts", json=edit, headers=headers).status_code == code
    assert (folder / "recordings.toml").read_text() == before


@pytest.mark.parametrize(
    "name", ["/etc/passwd", "../recordings.toml", "recordings/broken.h5", "", "x\0", "a" * 2000]
)
def test_no_name_leads_out_of_the_index(client: TestClient, name: str) -> None:
    for path in ("/api/samples", "/api/spectrum", "/api/waterfall", "/api/rms"):
        answer = client.get(path, params={"name": name, "start": 0, "count": 10})
        assert answer.status_code == 422
        assert "root:" not in answer.text
    assert client.get("/static/%2e%2e/%2e%2e/explorer_page.py").status_code == 404


def test_the_page_loads_nothing_from_elsewhere(client: TestClient) -> None:
    page = client.get("/")
    assert "default-src 'none'" in page.headers["content-security-policy"]
    assert not re.search(r"https?://", page.text)
    for name in re.findall(r'(?:src|href)="(/static/[^"?]+)', page.text):
        assert client.get(name).status_code == 200


@pytest.mark.nightly
def test_the_command_serves_until_it_is_ended(folder: Path) -> None:
    port = str(free_port())
    command = [sys.executable, "-m", "swashtwin", "explore", str(folder), "--port", port]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        assert f"http://127.0.0.1:{port}/" in process.stderr.readline()
        process.terminate()
        assert process.wait(60) == 0
