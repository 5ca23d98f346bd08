"""A real MQTT broker on a free port, which can be stopped and started again with the sessions it
keeps.
"""

import os
import shutil
import socket
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import pytest


class Broker:
    """Mosquitto with its files in a folder."""

    host = "127.0.0.1"

    def __init__(self, folder: Path) -> None:
        program = shutil.which("mosquitto", path=f"{os.environ.get('PATH', '')}:/usr/sbin")
        if program is None:
            pytest.skip("mosquitto is not installed")
        self._program = program
        self.port = free_port()
        self._config = folder / "mosquitto.conf"
        user = f"user {os.environ.get('USER') or 'root'}\n" if os.geteuid() == 0 else ""
        self._config.write_text(
            f"listener {self.port} {self.host}\nallow_anonymous true\npersistence true\n"
            f"persistence_location {folder}/\nautosave_interval 1\nmax_queued_messages 0\n{user}",
            encoding="utf-8",
        )
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        """Start it, and wait until it listens."""
        self._process = subprocess.Popen(
            [self._program, "-c", str(self._config)],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        end = time.monotonic() + 10

        while time.monotonic() < end:
            try:
                socket.create_connection((self.host, self.port), 1).close()
            except OSError:
                time.sleep(0.02)
            else:
                return

        raise RuntimeError("mosquitto does not listen")

    def stop(self) -> None:
        """End it; it keeps its sessions in its file."""
        if self._process is not None:
            self._process.terminate()
            self._process.wait(10)
            self._process = None

    def publish(self, topic: str, payload: bytes, *, retain: bool = False) -> None:
        """Publish one message, which the broker has when this returns."""
        from paho.mqtt.publish import single

        single(topic, payload, qos=1, retain=retain, hostname=self.host, port=self.port)


def free_port() -> int:
    """A port of this computer that nothing listens at."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        return int(server.getsockname()[1])


def wait_for(condition: Callable[[], object], seconds: float = 60) -> None:
    """Wait until a condition holds, and fail if it does not in time."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "did not happen in time"
        time.sleep(0.02)
