"""Deliveries that cannot be used are on the pages, and the watch is not healthy."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from starlette.testclient import TestClient
from watched_pumps import watch_config, write_hum

from swashtwin.monitoring import History, run_watch
from swashtwin.monitoring.page.watch_page import build_watch_page
from swashtwin.monitoring.service.deliveries import N_IN_A_ROW


@pytest.fixture
def blind_page(tmp_path: Path) -> Iterator[TestClient]:
    """Return the page of a watch whose last deliveries lost a channel."""
    config = watch_config(tmp_path)
    inbox = tmp_path / "incoming"
    write_hum(inbox / "a.h5", 1, 0)
    for number in range(N_IN_A_ROW):
        write_hum(inbox / f"b{number}.h5", 2 + number, 10 + number, channels=("x",))
    status = run_watch(config, once=True)

    history = History.open("", config.folder)
    page = build_watch_page(config, history, status=lambda: status)
    yield TestClient(page, base_url="http://127.0.0.1:8642")
    history.close()


def test_the_machine_is_not_normal_and_the_pages_say_why(blind_page: TestClient) -> None:
    overview = blind_page.get("/").text
    assert "1 Deliveries not usable" in overview
    assert "state-delivery" in overview
    assert "3 deliveries in a row have a problem" in overview

    machine = blind_page.get("/machines/pump-1").text
    assert "Deliveries not usable" in machine
    assert "does not fit the baseline" in machine
    assert "b2.h5" in blind_page.get("/alarms/1").text
    assert blind_page.get("/api/machines").json()[0]["state"] == "delivery"


def test_health_and_metrics_report_it(blind_page: TestClient) -> None:
    answer = blind_page.get("/health")
    assert answer.status_code == 503
    assert "does not fit the baseline" in answer.json()["problems"][0]

    metrics = blind_page.get("/metrics").text
    assert 'swashtwin_alarms{kind="delivery",machine="pump-1",state="open"} 1.0' in metrics
    assert "swashtwin_problems 1.0" in metrics
