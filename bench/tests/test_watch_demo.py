"""The watch of a wearing pump, from the rig's course to the history."""

import json
import socket
from pathlib import Path

import pytest
from commandline import run
from mqtt_broker import free_port

from swashtwin.monitoring import History
from swashtwin_bench.cli import watch_demo


def test_a_port_in_use_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        result = run("watch", "demo", "--out", tmp_path, "--port", port, code=3)

    assert f"Cannot serve at 127.0.0.1:{port}" in result.stderr
    assert not list(tmp_path.iterdir())


def test_the_demo_ends_with_a_history_of_all_recordings(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(watch_demo, "RECORDINGS", 4)
    monkeypatch.setattr(watch_demo, "ONSET", 2)

    arguments = ("watch", "demo", "--out", tmp_path, "--port", free_port(), "--end", "--json")
    answer = json.loads(run(*arguments).stdout)
    # four recordings are fewer than the watch learns its baseline from
    assert (answer["judged"], answer["alarm"]) == (4, None)

    history = History.open("", tmp_path / "watch-data")
    (machine,) = history.reader.machines()
    history.close()
    assert (machine.name, machine.recordings) == ("rig-pump", 4)
