"""A broker for watches that run."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from mqtt_broker import Broker


@pytest.fixture
def broker(tmp_path: Path) -> Iterator[Broker]:
    """A running broker; the test is skipped where mosquitto is not installed."""
    folder = tmp_path / "broker"
    folder.mkdir()
    server = Broker(folder)
    server.start()
    yield server
    server.stop()
