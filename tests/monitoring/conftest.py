"""A PostgreSQL server, an empty history in each of both databases, a broker and a machine."""

import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from itertools import count
from pathlib import Path

import pytest
from mqtt_broker import Broker, free_port
from small_machine import Machine

from swashtwin.monitoring.history.history import History

_NUMBERS = count()


class PostgresServer:
    """A PostgreSQL server in a temporary folder."""

    def __init__(self, programs: Path) -> None:
        self._programs = programs
        # PostgreSQL refuses to run as root.
        self._user = "postgres" if os.getuid() == 0 else None
        self.folder = Path(tempfile.mkdtemp(prefix="swashtwin-postgres-"))
        self.port = free_port()
        if self._user:
            shutil.chown(self.folder, self._user)
        self._run(
            "initdb", "-D", "data", "-U", "swashtwin", "-A", "trust", "--no-sync", "-E", "UTF8"
        )

    @property
    def url(self) -> str:
        """URL of its first database, from which others are created."""
        return f"postgresql://swashtwin@127.0.0.1:{self.port}/postgres"

    def start(self) -> None:
        """Start it, and wait until it answers."""
        # No test cuts the power of the disk, so fsync would only take time. The path of a socket
        # may be too long in a temporary folder.
        settings = (
            f"-p {self.port} -c listen_addresses=127.0.0.1 -c unix_socket_directories= -c fsync=off"
        )
        self._run("pg_ctl", "-D", "data", "-w", "-t", "60", "-l", "log", "-o", settings, "start")

    def stop(self) -> None:
        """Stop it at once, as a power failure does."""
        self._run("pg_ctl", "-D", "data", "-w", "-m", "immediate", "stop")

    def remove(self) -> None:
        """Stop it and remove its folder."""
        self.stop()
        shutil.rmtree(self.folder, ignore_errors=True)

    def new_database(self) -> str:
        """Create an empty database, and return its URL."""
        import psycopg

        name = f"test_{next(_NUMBERS)}"
        with psycopg.connect(self.url, autocommit=True) as connection:
            connection.execute(f"CREATE DATABASE {name}")
        return self.url.rpartition("/")[0] + f"/{name}"

    def _run(self, program: str, *arguments: str) -> None:
        command = [str(self._programs / program), *arguments]
        # A file and not a pipe, which the server would inherit and keep open.
        with (self.folder / f"{program}.txt").open("w+", encoding="utf-8") as output:
            process = subprocess.run(
                command,
                cwd=self.folder,
                user=self._user,
                stdout=output,
                stderr=output,
                timeout=120,
                check=False,
            )
            output.seek(0)
            assert process.returncode == 0, output.read()


@pytest.fixture(scope="session")
def postgres_server() -> Iterator[PostgresServer]:
    """A running PostgreSQL server; the test is skipped if it is not installed."""
    pytest.importorskip("psycopg", reason="psycopg is not installed")
    # Debian installs each version in a folder that is not on the path.
    programs = sorted(
        Path("/usr/lib/postgresql").glob("*/bin/initdb"), key=lambda path: int(path.parts[-3])
    )
    program_on_path = shutil.which("initdb")
    if programs:
        newest_program = programs[-1]
    elif program_on_path:
        newest_program = Path(program_on_path)
    else:
        pytest.skip("PostgreSQL is not installed")

    server = PostgresServer(newest_program.parent)
    server.start()
    try:
        yield server
    finally:
        server.remove()


@pytest.fixture
def postgresql_url(postgres_server: PostgresServer) -> str:
    """URL of an empty PostgreSQL database."""
    return postgres_server.new_database()


@pytest.fixture(params=["sqlite", "postgresql"])
def history_url(request: pytest.FixtureRequest) -> str:
    """URL of an empty database: SQLite (an empty URL), then PostgreSQL."""
    if request.param == "sqlite":
        return ""
    # Asked for here, so that SQLite is tested without a server.
    return str(request.getfixturevalue("postgresql_url"))


@pytest.fixture
def history(history_url: str, tmp_path: Path) -> Iterator[History]:
    """An empty history, in SQLite and in PostgreSQL."""
    history = History.open(history_url, tmp_path)
    yield history
    history.close()


@pytest.fixture
def broker(tmp_path: Path) -> Iterator[Broker]:
    """A running broker; the test is skipped if mosquitto is not installed."""
    folder = tmp_path / "broker"
    folder.mkdir()
    server = Broker(folder)

    server.start()
    yield server
    server.stop()


@pytest.fixture(scope="session")
def machine() -> Machine:
    """The machine that is watched."""
    return Machine()
