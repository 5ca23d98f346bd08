"""Requests of other programs, and recordings that they upload."""

from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from starlette.testclient import TestClient

from swashtwin.foundation import InputError
from swashtwin.monitoring.page.guard import MAX_UPLOAD_BYTES
from swashtwin.monitoring.page.watch_page import build_watch_page
from swashtwin.monitoring.sources.delivery import check_facts
from swashtwin.monitoring.status import WatchStatus

HOST = "http://127.0.0.1:8642"
UPLOAD = "/api/recordings"


class Spool:
    """Take uploads as the service does."""

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


def temporary_files(plant) -> list[Path]:
    """Return the uploads that are not in the spool, each of which would stay for ever."""
    return list((plant.config.folder / "uploads").iterdir())


def test_machines_come_with_state_newest_recording_and_alarms(reader: TestClient) -> None:
    machines = {machine["name"]: machine for machine in reader.get("/api/machines").json()}

    states = {name: machine["state"] for name, machine in machines.items()}
    assert states == {
        "pump-1": "alarm",
        "presse-4": "sensor",
        "pump-2": "normal",
        "pump-3": "learning",
    }
    assert machines["pump-1"]["last"]["label"] == "swash_plate"
    assert machines["pump-1"]["alarms"][0]["evidence"]["moved"]
    assert reader.get("/api/machines/pump-1").json() == machines["pump-1"]


def test_a_trend_of_the_machine_comes_oldest_first_in_utc(reader: TestClient) -> None:
    trend = reader.get("/api/machines/pump-1/trend", params={"indicator": "capital"}).json()

    assert len(trend["times"]) == len(trend["values"]) == len(trend["recordings"])
    assert trend["times"] == sorted(trend["times"])
    assert trend["times"][0].endswith("Z")
    # The pump is worn, so the newest evidence is that of an alarm.
    assert trend["values"][-1] > 100


def test_a_trend_of_a_channel_is_limited_to_the_number_asked_for(reader: TestClient) -> None:
    parameters = {"channel": "x", "indicator": "shaft order 7", "limit": 5}
    trend = reader.get("/api/machines/pump-1/trend", params=parameters).json()

    assert len(trend["values"]) == 5


def test_recordings_are_listed_by_machine_and_state_and_read_one_by_one(
    reader: TestClient,
) -> None:
    parameters = {"machine": "pump-1", "state": "alarm", "limit": 3}
    recordings = reader.get("/api/recordings", params=parameters).json()

    assert [recording["state"] for recording in recordings] == ["alarm"] * 3
    assert reader.get(f"/api/recordings/{recordings[0]['id']}").json() == recordings[0]


def test_indicators_events_rejections_and_the_sequence_are_listed(reader: TestClient) -> None:
    indicators = reader.get("/api/machines/pump-1/indicators").json()
    assert {"channel": "x", "name": "shaft order 7"} in indicators

    assert reader.get("/api/machines/pump-2/events").json()[0]["who"] == "Ada"
    assert reader.get("/api/rejections").json()[0]["reason"] == "machine"
    assert isinstance(reader.get("/api/sequence").json(), int)


@pytest.mark.parametrize(
    ("method", "address", "body"),
    [
        ("GET", "/api/machines/x", None),
        # more than the 64 bits of a row's number in a database
        ("GET", "/api/recordings?before=99999999999999999999", None),
        ("GET", "/api/recordings?since=yesterday", None),
        # in UTC these two times lie before the first and after the last year of datetime
        ("GET", "/api/recordings?since=0001-01-01T00:00:00%2B14:00", None),
        ("GET", "/api/recordings?until=9999-12-31T23:59:59-14:00", None),
        ("GET", "/api/machines/pump-1/trend", None),
        ("POST", "/api/machines/pump-1/silence", {"hours": -1}),
        ("POST", "/api/machines/pump-1/events", {"kind": "x"}),
        ("POST", "/api/alarms/99/acknowledge", {}),
    ],
)
def test_an_invalid_request_is_refused_in_json(
    reader: TestClient, method: str, address: str, body: dict[str, object] | None
) -> None:
    answer = reader.request(method, address, data=body)

    assert answer.status_code in (404, 422)
    assert isinstance(answer.json()["detail"], str)


def test_a_form_with_a_file_is_handed_on_with_its_facts(
    sender: TestClient, spool: Spool, plant
) -> None:
    facts = {"speed": "1500 rpm", "temperature": "313 K"}
    answer = sender.post(
        UPLOAD,
        data={"machine": "pump-1", **facts},
        # A browser sends a bare name; another program may send anything.
        files={"file": ("../../evil/a b.csv", b"1,2\n")},
    )

    assert answer.status_code == 202
    assert answer.json() == {"id": "c0ffee", "state": "accepted"}
    assert spool.deliveries == [(b"1,2\n", "a_b.csv", "pump-1", facts)]
    assert temporary_files(plant) == []


@pytest.mark.parametrize("part", ["data", "params"])
def test_a_fact_of_an_unknown_name_is_refused(sender: TestClient, spool: Spool, part: str) -> None:
    # A speed that is misspelled and ignored would put the recording at another operating point.
    facts = {part: {"sped": "1500 rpm"}}
    answer = sender.post(UPLOAD, files={"file": ("a.csv", b"1")}, **facts)

    assert answer.status_code == 422
    assert "Unknown fact 'sped'" in answer.json()["detail"]
    assert spool.deliveries == []


def test_what_a_kill_left_of_an_upload_is_removed_at_the_next_start(plant) -> None:
    partial_upload = plant.config.folder / "uploads" / "c0ffee"
    partial_upload.parent.mkdir(parents=True, exist_ok=True)
    partial_upload.write_bytes(b"half")

    build_watch_page(plant.config, plant.history)

    assert not partial_upload.exists()


@pytest.mark.parametrize(
    ("error", "code"),
    [
        pytest.param(InputError("speed (x) has no unit"), 422, id="invalid fact"),
        # 507, so that the sender knows to try again later
        pytest.param(OSError(28, "No space left on device"), 507, id="full disk"),
    ],
)
def test_what_the_spool_refuses_is_refused_with_a_code_and_leaves_no_file(
    sender: TestClient, spool: Spool, plant, error: Exception, code: int
) -> None:
    spool.error = error
    answer = sender.post(UPLOAD, files={"file": ("a.csv", b"x")})

    assert answer.status_code == code
    assert temporary_files(plant) == []


FILE = {"file": b"x"}


@pytest.mark.parametrize(
    ("address", "request_parts"),
    [
        pytest.param(UPLOAD, {"content": b""}, id="empty body"),
        pytest.param(
            UPLOAD, {"data": {"machine": "a"}, "files": {"other": ("a", b"x")}}, id="no file"
        ),
        pytest.param(UPLOAD, {"files": FILE, "params": {"speed": "9" * 300}}, id="long number"),
        pytest.param(
            f"{UPLOAD}?speed=1500%20rpm&speed=100%20rpm", {"files": FILE}, id="two speeds"
        ),
        pytest.param(UPLOAD, {"files": FILE, "params": {"rate": "1e9 GHz"}}, id="rate too high"),
        pytest.param(
            UPLOAD,
            {"content": b"x", "headers": {"content-type": "multipart/form-data"}},
            id="form without a boundary",
        ),
        pytest.param(
            UPLOAD,
            {"content": b"x", "headers": {"content-type": "multipart/form-data; boundary=a"}},
            id="body without the boundary",
        ),
        # more fields than there are facts
        pytest.param(
            UPLOAD,
            {"data": {f"f{number}": "x" for number in range(50)}, "files": FILE},
            id="too many fields",
        ),
    ],
)
def test_a_request_without_a_valid_recording_is_refused(
    sender: TestClient, spool: Spool, plant, address: str, request_parts: dict[str, Any]
) -> None:
    answer = sender.post(address, **request_parts)

    assert answer.status_code in (400, 422)
    assert spool.deliveries == []
    assert temporary_files(plant) == []


def test_a_recording_that_is_too_large_is_refused_before_it_fills_the_disk(
    sender: TestClient, spool: Spool, plant
):
    # In pieces, so that no header states the length beforehand.
    def pieces() -> Iterator[bytes]:
        for _ in range(MAX_UPLOAD_BYTES // (1 << 20) + 2):
            yield bytes(1 << 20)

    answer = sender.post(
        UPLOAD,
        content=pieces(),
        headers={"content-type": "multipart/form-data; boundary=a"},
    )

    assert answer.status_code in (400, 413)
    assert spool.deliveries == []
    assert temporary_files(plant) == []


def test_a_watch_without_a_source_of_this_kind_takes_no_recordings(reader: TestClient) -> None:
    assert reader.post(UPLOAD, content=b"x").status_code == 404


@pytest.mark.parametrize(
    "line",
    [
        'swashtwin_machine_state{machine="pump-1",state="alarm"} 1.0',
        'swashtwin_alarms{kind="sensor",machine="presse-4",state="open"} 1.0',
        # the beginning alone: how many are learned from is a setting
        'swashtwin_recordings_total{machine="pump-2",state="learning"}',
        'swashtwin_rejections_total{reason="machine"} 1.0',
        'swashtwin_source_connected{kind="http",source="http"} 1.0',
        "swashtwin_watch_judged_total 90.0",
        "swashtwin_process_resident_memory_bytes",
        "swashtwin_history_up 1.0",
    ],
)
def test_metrics_state_machines_alarms_counts_and_health(reader: TestClient, line: str) -> None:
    assert line in reader.get("/metrics").text


def test_health_fails_while_the_watch_has_a_problem(plant) -> None:
    status = WatchStatus(
        datetime.now(UTC),
        0,
        0,
        (),
        1,
        {},
        ("m is not reached",),
    )
    application = build_watch_page(plant.config, plant.history, status=lambda: status)
    client = TestClient(application, base_url=HOST)

    # A monitor of services looks at the code alone, a person at the sentence.
    answer = client.get("/health")
    assert answer.status_code == 503
    assert answer.json()["problems"] == ["m is not reached"]
    assert "m is not reached" in client.get("/").text
