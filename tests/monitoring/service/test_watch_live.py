"""A running watch: its sources, its page, and its end."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx2
import pytest
from mqtt_broker import Broker, free_port, wait_for
from watched_pumps import RATE, hum, watch_config, write_hum

from swashtwin.monitoring import History, Outcome, run_watch
from swashtwin.monitoring.config.settings import WatchConfig
from swashtwin.recordings import write_recording

pytestmark = pytest.mark.nightly


def page_on_free_port() -> str:
    return f"[page]\nport = {free_port()}\n"


def mqtt_source(broker: Broker, group: str = "") -> str:
    lines = [
        "[[source]]",
        'kind = "mqtt"',
        f'host = "{broker.host}"',
        f"port = {broker.port}",
        'topic = "plant/+/raw"',
    ]
    if group:
        lines.append(f'group = "{group}"')
    return "\n".join([*lines, ""])


def message(seed: int) -> bytes:
    header = {
        "rate": f"{RATE} Hz",
        "unit": "m/s^2",
        "channels": ["x", "y"],
        "type": "float32",
    }
    samples = hum(seed).signal.T.astype("<f4")
    return json.dumps(header).encode() + b"\n" + samples.tobytes()


@contextmanager
def watching(config: WatchConfig) -> Iterator[tuple[str, list[Outcome]]]:
    """Run a watch, and yield the address of its page and the outcomes so far."""
    stop = threading.Event()
    started = threading.Event()
    errors = []
    outcomes: list[Outcome] = []
    addresses: list[str | None] = []

    def start(address: str | None) -> None:
        addresses.append(address)
        started.set()

    def work() -> None:
        try:
            run_watch(config, stop=stop, started=start, progress=outcomes.append)
        # An error in a thread would only be printed, and the wait below would time out.
        except BaseException as cause:
            errors.append(cause)
            started.set()

    thread = threading.Thread(target=work)
    thread.start()

    try:
        assert started.wait(60)
        assert not errors, errors
        yield str(addresses[0]), outcomes
    finally:
        stop.set()
        thread.join(60)

    assert not thread.is_alive()
    assert not errors, errors


def stored_contents(config: WatchConfig) -> list[str]:
    history = History.open(config.history_url, config.folder)
    try:
        return [row.content for row in history.reader.recordings(limit=10_000)]
    finally:
        history.close()


def test_a_file_a_message_and_an_upload_are_judged(tmp_path: Path, broker: Broker) -> None:
    sources = f'{mqtt_source(broker)}\n[[source]]\nkind = "http"\n'
    config = watch_config(tmp_path, sources + page_on_free_port())

    with watching(config) as (address, outcomes):
        write_hum(tmp_path / "incoming" / "a.h5", 1)
        wait_for(lambda: outcomes)

        broker.publish("plant/pump-1/raw", message(2))
        wait_for(lambda: len(outcomes) == 2)

        content = write_recording(hum(3), tmp_path / "c.h5").read_bytes()
        answer = httpx2.post(
            f"{address}/api/recordings",
            files={"file": ("c.h5", content)},
            data={"machine": "pump-1"},
        )
        assert answer.status_code == 202, answer.text
        wait_for(lambda: len(outcomes) == 3)

        health = httpx2.get(f"{address}/health")
        assert health.status_code == 200, health.text

    assert [outcome.state for outcome in outcomes] == ["learning"] * 3


def test_watches_of_one_history_and_one_broker_share_the_work(
    tmp_path: Path, broker: Broker, postgresql_url: str
) -> None:
    configs = [
        watch_config(
            tmp_path / name,
            mqtt_source(broker, "plant") + page_on_free_port(),
            history=postgresql_url,
        )
        for name in ("a", "b")
    ]

    with watching(configs[0]) as (_, first), watching(configs[1]) as (_, second):
        for seed in range(12):
            broker.publish("plant/pump-1/raw", message(seed))
        wait_for(lambda: len(first) + len(second) == 12)
        # A message that both had taken would be judged a little later.
        time.sleep(0.3)

    assert first
    assert second
    assert {outcome.state for outcome in (*first, *second)} == {"learning"}
    contents = stored_contents(configs[0])
    assert len(contents) == 12
    assert len(set(contents)) == 12


def test_the_command_ends_well_if_the_system_terminates_it(tmp_path: Path) -> None:
    watch_config(tmp_path, page_on_free_port())
    write_hum(tmp_path / "incoming" / "a.h5", 1)

    # A process of its own, since the signal is for a whole process. Unbuffered, since the test
    # waits for its first line.
    process = subprocess.Popen(
        [sys.executable, "-m", "swashtwin", "watch", str(tmp_path / "watch.toml")],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "PYTHONUNBUFFERED": "1"},
        text=True,
    )
    try:
        assert process.stdout is not None
        assert "learning 1/20" in process.stdout.readline()
        # the signal of `kill` and of a shutdown
        process.send_signal(signal.SIGTERM)
        out, error = process.communicate(timeout=60)
    finally:
        process.kill()

    assert process.returncode == 0, error
    assert "1 judged, 0 rejected, 0 waiting." in out
    assert "page at http://127.0.0.1:" in error
