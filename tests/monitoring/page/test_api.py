"""What other programs ask, and recordings that they send."""

from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path

import pytest
from starlette.testclient import TestClient

from swashtwin.foundation import InputError
from swashtwin.monitoring.page.guard import MAX_UPLOAD_BYTES
from swashtwin.monitoring.page.watch_page import build_watch_page
from swashtwin.monitoring.sources.delivery import check_facts
from swashtwin.monitoring.status import WatchStatus

HOST = "http://127.0.0.1:8642"


class Spool:
    """Takes uploads as the service does."""

    def __init__(self) -> None:
        self.deliveries: list[tuple[bytes, str, str | None, dict[str, str]]] = []
        self.error: Exception | None = None

    def __call__(self, path: Path, name: str, machine: str | None, facts: Mapping[str, str]) -> str:
        if self.error is not None:
            raise self.error
        self.deliveries.append((path.read_bytes(), name, machine, check_facts(facts)))
        return "c0ffee"


@pytest.fixture
def spool() -> Spool:
    """Where uploads go."""
    return Spool()


@pytest.fixture
def sender(plant, spool: Spool) -> TestClient:
    """A program that sends recordings."""
    return TestClient(build_watch_page(plant.config, plant.history, upload=spool), base_url=HOST)


def test_machines_come_with_state_newest_recording_and_alarms(reader: TestClient) -> None:
    machines = {machine["name"]: machine for machine in reader.get("/api/machines").json()}
    assert {name: machine["state"] for name, machine in machines.items()} == {
        "pump-1": "alarm", "presse-4": "sensor", "pump-2": "normal", "pump-3": "learning"
    }  # fmt: skip
    assert machines["pump-1"]["last"]["label"] == "swash_plate"
    assert machines["pump-1"]["alarms"][0]["evidence"]["moved"]
    assert reader.get("/api/machines/pump-1").json() == machines["pump-1"]


def test_a_trend_comes_oldest_first_with_nulls_for_no_number(reader: TestClient) -> None:
    trend = reader.get("/api/machines/pump-1/trend", params={"indicator": "capital"}).json()
    assert len(trend["times"]) == len(trend["values"]) == len(trend["recordings"])
    assert trend["times"] == sorted(trend["times"])
    assert trend["times"][0].endswith("Z")
    assert trend["values"][-1] > 100
    level = {"channel": "x", "indicator": "shaft order 7", "limit": 5}
    assert len(reader.get("/api/machines/pump-1/trend", params=level).json()["values"]) == 5


def test_levels_recordings_events_and_rejections_are_listed(reader: TestClient) -> None:
    assert {"channel": "x", "name": "shaft order 7"} in reader.get(
        "/api/machines/pump-1/indicators"
    ).json()
    recordings = reader.get(
        "/api/recordings", params={"machine": "pump-1", "state": "alarm", "limit": 3}
    ).json()
    assert [recording["state"] for recording in recordings] == ["alarm"] * 3
    assert reader.get(f"/api/recordings/{recordings[0]['id']}").json() == recordings[0]
    assert reader.get("/api/machines/pump-2/events").json()[0]["who"] == "Ada"
    assert reader.get("/api/rejections").json()[0]["reason"] == "machine"
    assert isinstance(reader.get("/api/sequence").json(), int)


@pytest.mark.parametrize(
    ("method", "address", "body"),
    [
        ("GET", "/api/machines/x", None),
        ("GET", "/api/recordings?before=99999999999999999999", None),
        ("GET", "/api/recordings?since=yesterday", None),
        ("GET", "/api/recordings?since=0001-01-01T00:00:00%2B14:00", None),
        ("GET", "/api/recordings?until=9999-12-31T23:59:59-14:00", None),
        ("GET", "/api/machines/pump-1/trend", None),
        ("POST", "/api/machines/pump-1/silence", {"hours": -1}),
        ("POST", "/api/machines/pump-1/events", {"kind": "x"}),
        ("POST", "/api/alarms/99/acknowledge", {}),
    ],
)
def test_a_wrong_request_is_refused_in_json(
    reader: TestClient, method: str, address: str, body: dict[str, object] | None
) -> None:
    answer = reader.request(method, address, data=body)
    assert answer.status_code in (404, 422)
    assert isinstance(answer.json()["detail"], str)


def test_a_form_with_a_file_is_handed_on_with_its_facts(
    sender: TestClient, spool: Spool, plant
) -> None:
    facts = {"machine": "pump-1", "speed": "1500 rpm", "temperature": "313 K"}
    answer = sender.post(
        "/api/recordings", data=facts, files={"file": ("../../evil/a b.csv", b"1,2\n")}
    )
    assert answer.status_code == 202
    assert answer.json() == {"id": "c0ffee", "state": "accepted"}
    assert spool.deliveries == [
        (b"1,2\n", "a_b.csv", "pump-1", {"speed": "1500 rpm", "temperature": "313 K"})
    ]
    assert list((plant.config.folder / "uploads").iterdir()) == []


@pytest.mark.parametrize("part", ["data", "params"])
def test_a_fact_of_an_unknown_name_is_refused(sender: TestClient, spool: Spool, part: str) -> None:
    answer = sender.post(
        "/api/recordings", files={"file": ("a.csv", b"1")}, **{part: {"sped": "1500 rpm"}}
    )
    assert (
        answer.status_code,
        "Unknown fact 'sped'" in answer.json()["detail"],
        spool.deliveries,
    ) == (422, True, [])


def test_what_a_kill_left_of_an_upload_is_gone_at_the_next_start(plant) -> None:
    left = plant.config.folder / "uploads" / "c0ffee"
    left.parent.mkdir(parents=True, exist_ok=True)
    left.write_bytes(b"half")
    build_watch_page(plant.config, plant.history)
    assert not left.exists()


@pytest.mark.parametrize(
    ("error", "code"),
    [(InputError("speed (x) has no unit"), 422), (OSError(28, "No space left on device"), 507)],
)
def test_what_the_spool_refuses_is_told_in_one_line(
    sender: TestClient, spool: Spool, plant, error: Exception, code: int
) -> None:
    spool.error = error
    answer = sender.post("/api/recordings", files={"file": ("a.csv", b"x")})
    assert answer.status_code == code
    assert list((plant.config.folder / "uploads").iterdir()) == []


@pytest.mark.parametrize(
    "send",
    [
        lambda sender: sender.post("/api/recordings", content=b""),
        lambda sender: sender.post(
            "/api/recordings", data={"machine": "a"}, files={"other": ("a", b"x")}
        ),
        lambda sender: sender.post(
            "/api/recordings", files={"file": b"x"}, params={"speed": "9" * 300}
        ),
        lambda sender: sender.post(
            "/api/recordings?speed=1500%20rpm&speed=100%20rpm", files={"file": b"x"}
        ),
        lambda sender: sender.post(
            "/api/recordings", files={"file": b"x"}, params={"rate": "1e9 GHz"}
        ),
        lambda sender: sender.post(
            "/api/recordings", content=b"x", headers={"content-type": "multipart/form-data"}
        ),
        lambda sender: sender.post(
            "/api/recordings",
            content=b"x",
            headers={"content-type": "multipart/form-data; boundary=a"},
        ),
        lambda sender: sender.post(
            "/api/recordings", data={f"f{i}": "x" for i in range(50)}, files={"file": b"x"}
        ),
    ],
)
def test_a_request_without_a_recording_is_refused(
    sender: TestClient, spool: Spool, plant, send: Callable[[TestClient], object]
) -> None:
    assert send(sender).status_code in (400, 422)
    assert spool.deliveries == []
    assert list((plant.config.folder / "uploads").iterdir()) == []


def test_a_recording_that_is_too_large_is_refused_before_it_fills_the_disk(
    sender: TestClient, spool: Spool, plant
):
    def pieces():
        for _ in range(MAX_UPLOAD_BYTES // (1 << 20) + 2):
            yield bytes(1 << 20)

    assert sender.post(
        "/api/recordings",
        content=pieces(),
        headers={"content-type": "multipart/form-data; boundary=a"},
    ).status_code in (400, 413)
    assert spool.deliveries == []
    assert list((plant.config.folder / "uploads").iterdir()) == []


def test_a_watch_without_a_source_of_this_kind_takes_no_recordings(reader: TestClient) -> None:
    assert reader.post("/api/recordings", content=b"x").status_code == 404


def test_metrics_tell_state_evidence_counts_and_health(reader: TestClient) -> None:
    text = reader.get("/metrics").text
    assert 'swashtwin_machine_state{machine="pump-1",state="alarm"} 1.0' in text
    assert 'swashtwin_alarms{kind="sensor",machine="presse-4",state="open"} 1.0' in text
    assert 'swashtwin_recordings_total{machine="pump-2",state="learning"}' in text
    assert 'swashtwin_rejections_total{reason="machine"} 1.0' in text
    assert 'swashtwin_source_connected{kind="http",source="http"} 1.0' in text
    assert "swashtwin_watch_judged_total 90.0" in text
    assert "swashtwin_process_resident_memory_bytes" in text
    assert "swashtwin_history_up 1.0" in text


def test_health_fails_with_a_problem_of_the_watch(plant) -> None:
    status = WatchStatus(datetime.now(UTC), 0, 0, (), 1, {}, ("m is not reached",))
    client = TestClient(
        build_watch_page(plant.config, plant.history, status=lambda: status), base_url=HOST
    )
    answer = client.get("/health")
    assert answer.status_code == 503
    assert answer.json()["problems"] == ["m is not reached"]
    assert "m is not reached" in client.get("/").text
