"""What the explorer's script asks for, and what is refused."""

import base64
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import httpx2
import numpy as np
import pytest
from explored import ADDRESS_TOKEN, HEALTHY, WORN, open_explorer, send
from mqtt_broker import free_port
from starlette.testclient import TestClient

from swashtwin.explorer import Workspace, build_explorer


def decode_numbers(text: str) -> np.ndarray:
    """Return the little-endian single-precision numbers of a text in base 64."""
    return np.frombuffer(base64.b64decode(text), "<f4")


def change(
    fact: str, previous: str | None, value: str | None, entry: str = HEALTHY
) -> dict[str, str | None]:
    return {"entry": entry, "fact": fact, "previous": previous, "value": value}


def test_the_table_shows_the_facts_and_the_waveform_of_a_recording(reader: TestClient) -> None:
    table = reader.get("/api/rows").json()
    rows = {row["name"]: row for row in table["rows"]}

    assert table["waiting"] == 0
    assert rows[HEALTHY]["label"] == "normal"
    assert rows[HEALTHY]["rpm"] == pytest.approx(860)
    # points of the small curve in the row
    assert len(rows[HEALTHY]["rms"]) == 40


def test_the_table_shows_why_a_file_is_unreadable(reader: TestClient) -> None:
    rows = {row["name"]: row for row in reader.get("/api/rows").json()["rows"]}

    broken = rows["recordings/broken.h5"]
    assert broken["state"] == "broken"
    assert "broken.h5" in broken["findings"][0]["message"]


def test_rows_that_have_not_changed_are_not_sent_again(reader: TestClient) -> None:
    revision = reader.get("/api/rows").json()["revision"]
    assert reader.get(f"/api/rows?since={revision}").json()["rows"] == []


# extremes of 64 samples are kept; smaller bins are read from the file, larger ones merged
@pytest.mark.parametrize("width", [1, 4, 64, 1024])
def test_the_waveform_spans_the_extremes_of_the_samples(
    reader: TestClient, shown: Workspace, width: int
) -> None:
    signal = shown.recording(HEALTHY).signal
    # nine points of `width` samples each, from the fourth on
    request = {"name": HEALTHY, "width": width, "start": 3, "count": 9}

    content = reader.get("/api/samples", params=request).content

    extremes = np.frombuffer(content, "<f4").reshape(len(signal), 9, 2)
    samples = signal[:, 3 * width : 12 * width].reshape(len(signal), 9, width)
    np.testing.assert_allclose(extremes[..., 0], samples.min(axis=2), rtol=1e-6)
    np.testing.assert_allclose(extremes[..., 1], samples.max(axis=2), rtol=1e-6)


# `bodies` and `ratio` describe a rolling bearing.
SPECTRUM = {"name": WORN, "pistons": 7, "healthy": True, "bodies": 9, "ratio": 0.2}


@pytest.mark.parametrize("kind", ["amplitude", "order"])
def test_the_mark_of_the_pistons_stands_at_a_line_of_the_spectrum(
    reader: TestClient, kind: str
) -> None:
    spectrum = reader.get("/api/spectrum", params={**SPECTRUM, "kind": kind}).json()

    amplitude = decode_numbers(spectrum["amplitude"]).reshape(len(spectrum["channels"]), -1)
    position = next(position for position, name, *_ in spectrum["marks"] if name == "7×")
    index = round(position / spectrum["step"])
    # the measured speed is not exactly the nominal one
    piston_line = amplitude[:, index - 5 : index + 6].max(axis=1)
    assert (piston_line > 5 * np.median(amplitude, axis=1)).any()


def test_only_a_specified_number_of_pistons_is_marked(reader: TestClient, shown: Workspace) -> None:
    marks = reader.get("/api/spectrum", params={"name": WORN}).json()["marks"]
    assert not any(of_pistons for _, _, of_pistons in marks)

    row = shown.rows[WORN]
    assert row.recording is not None
    assert row.to_dict()["pistons"] is None
    nine_pistons = row.recording.replace(attributes={"pistons": "9"})
    assert replace(row, recording=nine_pistons).to_dict()["pistons"] == 9


@pytest.mark.parametrize("kind", ["amplitude", "order"])
def test_a_spectrum_has_the_lines_of_a_bearing_and_the_healthy_range(
    reader: TestClient, kind: str
) -> None:
    spectrum = reader.get("/api/spectrum", params={**SPECTRUM, "kind": kind}).json()

    names = {name for _, name, *_ in spectrum["marks"]}
    assert {"BPFI", "2 FTF", "1×"} <= names
    # the two healthy recordings of the same pump
    assert len(spectrum["healthy"]) == 2
    upper_edge = decode_numbers(spectrum["high"])
    assert upper_edge.shape == decode_numbers(spectrum["amplitude"]).shape


@pytest.mark.parametrize("orders", [False, True], ids=["frequencies", "orders"])
def test_a_waterfall_has_one_shade_for_each_frame_and_band(
    reader: TestClient, orders: bool
) -> None:
    waterfall = reader.get("/api/waterfall", params={"name": WORN, "orders": orders}).json()

    # one byte each
    shades = base64.b64decode(waterfall["shades"])
    assert len(shades) == waterfall["frames"] * waterfall["bands"]


def test_the_level_over_time_has_120_points(reader: TestClient) -> None:
    assert reader.get("/api/rms", params={"name": WORN}).json()["lines"] == 120


def test_the_speed_is_estimated_from_the_lines(reader: TestClient) -> None:
    answer = reader.get("/api/speed", params={"name": HEALTHY, "pistons": 7}).json()
    assert answer["rpm"] == pytest.approx(860, rel=0.02)


def test_a_fact_is_written_and_undone(client: TestClient) -> None:
    written = send(client, "/api/facts", {"changes": [change("label", "normal", "piston")]})
    assert written.status_code == 200

    undo = {"changes": [change("label", "piston", "normal")], "undo": True}
    rows = send(client, "/api/facts", undo).json()["rows"]
    row = next(row for row in rows if row["name"] == HEALTHY)
    assert row["specified"]["label"] == "normal"


def test_a_window_that_shows_an_outdated_fact_cannot_overwrite_it(client: TestClient) -> None:
    send(client, "/api/facts", {"changes": [change("label", "normal", "piston")]})

    # a second window still shows `normal`
    refusal = send(client, "/api/facts", {"changes": [change("label", "normal", "valve_plate")]})

    assert refusal.status_code == 422
    assert "is 'piston' now" in refusal.json()["detail"]


def test_a_checksum_is_no_fact_to_edit(client: TestClient) -> None:
    answer = send(client, "/api/facts", {"changes": [change("sha256", None, "0")]})
    assert answer.status_code == 422


def test_an_index_is_written_with_the_first_fact_and_not_before(tmp_path: Path) -> None:
    for name in ("normal_1", "normal_2", "piston_1"):
        samples = np.random.default_rng(0).normal(size=(4000, 2))
        file = tmp_path / f"{name}.csv"
        np.savetxt(file, samples, delimiter=",", header="x,y", comments="")
    client = open_explorer(Workspace(tmp_path))

    # a table states neither its rate nor its unit
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
        pytest.param({"host": "evil.example"}, 421, id="rebound name"),
        pytest.param({"origin": "http://evil.example"}, 403, id="other origin"),
        pytest.param({"sec-fetch-site": "cross-site"}, 403, id="other site"),
        pytest.param({}, 403, id="no token"),
        pytest.param({"x-explorer": "guessed"}, 403, id="guessed token"),
    ],
)
def test_another_site_cannot_change_a_fact(
    client: TestClient, folder: Path, headers: dict[str, str], code: int
) -> None:
    original_index = (folder / "recordings.toml").read_text()
    edit = {"changes": [change("label", "normal", "piston")]}

    answer = client.post("/api/facts", json=edit, headers=headers)

    assert answer.status_code == code
    assert (folder / "recordings.toml").read_text() == original_index


@pytest.fixture
def stranger(shown: Workspace) -> TestClient:
    """A browser of another user of the computer, who does not know the token."""
    explorer = build_explorer(shown, address_token=ADDRESS_TOKEN)
    return TestClient(explorer, base_url="http://127.0.0.1:8643")


STRANGE_REQUESTS = [
    pytest.param("", {}, id="nothing"),
    pytest.param("?token=", {}, id="empty"),
    pytest.param("?token=guessed", {}, id="guessed"),
    pytest.param(f"?token={ADDRESS_TOKEN[:-1]}", {}, id="too short"),
    pytest.param(f"?token={ADDRESS_TOKEN}x", {}, id="too long"),
    pytest.param("?token=%ff%00\u00e4", {}, id="not ASCII"),
    pytest.param(f"?Token={ADDRESS_TOKEN}", {}, id="other parameter"),
    pytest.param("", {"cookie": "swashtwin_explorer_8643=guessed"}, id="guessed cookie"),
    pytest.param("", {"cookie": f"swashtwin_explorer_8644={ADDRESS_TOKEN}"}, id="other port"),
    pytest.param("", {"cookie": f"swashtwin_visit={ADDRESS_TOKEN}"}, id="cookie of the watch"),
    pytest.param("", {"connection": "upgrade", "upgrade": "websocket"}, id="web socket"),
]


@pytest.mark.parametrize(("query", "headers"), STRANGE_REQUESTS)
def test_another_user_of_the_computer_reads_nothing(
    stranger: TestClient, query: str, headers: dict[str, str]
) -> None:
    for path in ("/", "/api/rows", "/api/samples", "/static/explorer.js", "/nowhere"):
        answer = stranger.get(path + query, headers=headers)
        assert answer.status_code == 403
        # the sentence says how to get in, and the token is not in it
        assert "`swashtwin explore` printed" in answer.text
        assert ADDRESS_TOKEN not in answer.text + str(answer.headers)
    for method in ("HEAD", "OPTIONS", "POST", "PUT", "DELETE"):
        assert stranger.request(method, f"/api/facts{query}", headers=headers).status_code == 403


def test_the_token_of_the_address_becomes_a_cookie(stranger: TestClient) -> None:
    answer = stranger.get("/", params={"token": ADDRESS_TOKEN})

    cookie = answer.headers["set-cookie"]
    assert cookie.startswith("swashtwin_explorer_8643=")
    assert {"HttpOnly", "SameSite=strict", "Path=/"} <= set(cookie.split("; "))
    assert answer.headers["cache-control"] == "no-store"

    # from now on without the token in the address, which is in no answer
    assert ADDRESS_TOKEN not in answer.text
    assert stranger.get("/api/rows").status_code == 200
    assert "set-cookie" not in stranger.get("/").headers


def test_a_program_sends_the_token_with_its_request(stranger: TestClient) -> None:
    assert stranger.get("/api/rows", params={"token": ADDRESS_TOKEN}).status_code == 200


@pytest.mark.parametrize("room", ["samples", "spectrum", "waterfall", "rms"])
@pytest.mark.parametrize(
    "name",
    [
        pytest.param("/etc/passwd", id="absolute path"),
        pytest.param("../recordings.toml", id="parent folder"),
        pytest.param("recordings/broken.h5", id="unreadable recording"),
        pytest.param("", id="empty"),
        pytest.param("x\0", id="null character"),
        pytest.param("a" * 2000, id="long"),
    ],
)
def test_only_a_readable_recording_of_the_index_is_sent(
    reader: TestClient, name: str, room: str
) -> None:
    answer = reader.get(f"/api/{room}", params={"name": name, "start": 0, "count": 10})

    assert answer.status_code == 422
    # the first entry of /etc/passwd
    assert "root:" not in answer.text


def test_no_static_path_leads_out_of_its_folder(reader: TestClient) -> None:
    assert reader.get("/static/%2e%2e/%2e%2e/explorer_page.py").status_code == 404


def test_the_page_loads_nothing_from_other_hosts(reader: TestClient) -> None:
    page = reader.get("/")

    assert "default-src 'none'" in page.headers["content-security-policy"]
    assert not re.search(r"https?://", page.text)
    for address in re.findall(r'(?:src|href)="(/static/[^"?]+)', page.text):
        assert reader.get(address).status_code == 200


@pytest.mark.nightly
def test_the_explore_command_serves_until_it_is_ended(folder: Path) -> None:
    port = str(free_port())
    command = [sys.executable, "-m", "swashtwin", "explore", str(folder), "--port", port]

    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stderr is not None
        line = process.stderr.readline()
        assert f"http://127.0.0.1:{port}/" in line

        # the printed address answers, and nothing else does
        match = re.search(r"http://\S+\?token=([\w-]{43})", line)
        assert match
        assert httpx2.get(match[0]).status_code == 200
        assert httpx2.get(f"http://127.0.0.1:{port}/").status_code == 403
        assert httpx2.get(f"http://127.0.0.1:{port}/?token=wrong").status_code == 403

        process.terminate()
        output, errors = process.communicate(timeout=60)
        assert process.returncode == 0
        assert match[1] not in output + errors
