"""A history of an earlier version gets the tables that it lacks."""

from pathlib import Path

from sqlalchemy import text

from swashtwin.monitoring.history.database import SCHEMA_VERSION, _open_engine
from swashtwin.monitoring.history.history import History


def test_a_history_without_deliveries_gets_their_table(history_url: str, tmp_path: Path) -> None:
    History.open(history_url, tmp_path).close()
    engine = _open_engine(history_url, tmp_path, is_new=False)
    with engine.begin() as connection:
        connection.execute(text("DROP TABLE deliveries"))
        connection.execute(text("UPDATE swashtwin_history SET version = 2"))

    history = History.open(history_url, tmp_path)
    with history.machine("pump-1") as transaction:
        assert transaction.delivery_state() is None
        transaction.save_delivery_state({"n_findings": 1})
    history.close()

    with engine.begin() as connection:
        version = connection.execute(text("SELECT version FROM swashtwin_history")).scalar()
    engine.dispose()
    assert version == SCHEMA_VERSION
