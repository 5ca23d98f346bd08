"""Fixtures of the history's tests."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from swashtwin.monitoring.history.history import History


@pytest.fixture
def history(history_url: str, tmp_path: Path) -> Iterator[History]:
    """An empty history, in SQLite and in PostgreSQL."""
    history = History.open(history_url, tmp_path)
    yield history
    history.close()
