"""The history as CSV files, which other programs read."""

import csv
import json
import subprocess
import sys
from pathlib import Path

import pytest
from commandline import run
from judgments import START, judgment, rejection

from swashtwin.monitoring.config.config_file import write_example
from swashtwin.monitoring.history.history import History

PROGRAM_WITHOUT_SQLALCHEMY = (
    "import sys; sys.modules['sqlalchemy'] = None; from swashtwin.cli import main; main()"
)
ROW_COUNTS = {
    "recordings": 3,
    "alarms": 1,
    "silences": 1,
    "events": 2,
    "rejections": 1,
    "outbox": 1,
    # The file is named by what a file system takes of the machine's name.
    "indicators/_pump": 3,
    "indicators/pump-2": 0,
}


@pytest.fixture
def filled(history: History) -> History:
    """A history with a row in each table, and texts that a spreadsheet takes for formulas."""
    with history.machine("=pump") as transaction:
        for number in range(3):
            indicators = {("x", "rms"): number / 3, ("=y", "rms"): 1.0}
            # The last recording has another layout, so the columns are those of both.
            if number == 2:
                indicators = {("x", "kurtosis"): 3.0, ("x", "rms"): 2.0}
            facts = judgment(number, label="=1+1", reasons={"a": [1]})
            transaction.add_recording(facts, indicators)

        transaction.open_alarm("pump", None, START, {"rise": 9.0}, 1)
        transaction.silence(START, "-operator", "@home")
        transaction.add_event("maintenance", "+fitter", "new slippers")
        transaction.post("log", {"text": "=cmd"})

    with history.machine("pump-2") as transaction:
        transaction.add_event("note", "me")
    history.reject(rejection("=a.wav", "c"))
    return history


def read_csv(path: Path) -> list[list[str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.reader(file))


def column(lines: list[list[str]], name: str) -> list[str]:
    """Return the cells below one name of the first line, which each line must have."""
    header, *rows = lines
    return [dict(zip(header, row, strict=True))[name] for row in rows]


def test_no_cell_of_an_exported_file_is_a_formula(filled: History, tmp_path: Path) -> None:
    filled.export(tmp_path / "out")

    for name in ROW_COUNTS:
        lines = read_csv(tmp_path / "out" / f"{name}.csv")
        for line in lines:
            assert len(line) == len(lines[0])
            # A minus begins numbers too; the next test has a text that begins with one.
            assert not [cell for cell in line if cell.startswith(("=", "+", "@"))]


def test_csv_files_hold_every_row_of_every_table(filled: History, tmp_path: Path) -> None:
    assert filled.export(tmp_path / "out") == ROW_COUNTS

    recordings = read_csv(tmp_path / "out" / "recordings.csv")
    # The quote keeps a spreadsheet from computing what follows.
    assert column(recordings, "machine")[0] == "'=pump"
    assert column(recordings, "time")[0] == "2026-03-01T06:00:00Z"
    assert json.loads(column(recordings, "reasons")[0]) == {"a": [1]}

    silences = read_csv(tmp_path / "out" / "silences.csv")
    assert column(silences, "who")[0] == "'-operator"

    indicators = read_csv(tmp_path / "out" / "indicators" / "_pump.csv")
    assert column(indicators, "x rms")[2] == "2.0"
    assert column(indicators, "x kurtosis") == ["", "", "3.0"]


def test_the_command_does_not_create_a_database_that_it_shall_export(
    tmp_path: Path, postgresql_url: str
) -> None:
    out = str(tmp_path / "tables")

    missing_file = f"sqlite:///{tmp_path}/data/history.sqlite"
    answer = run("history", "export", missing_file, "--out", out, code=3)
    assert "does not exist" in answer.stderr

    answer = run("history", "export", postgresql_url, "--out", out, code=3)
    assert "has no history yet" in answer.stderr

    # Opening a history creates what is missing; a mistyped name would make an empty one.
    assert not (tmp_path / "data").exists()


def test_the_command_exports_what_a_configuration_or_a_url_names(tmp_path: Path) -> None:
    out = tmp_path / "tables"
    config = tmp_path / "watch.toml"
    config.write_text(
        'folder = "data"\n[[machine]]\nname = "pump-1"\n[[source]]\nkind = "http"\n',
        encoding="utf-8",
    )
    history = History.open("", tmp_path / "data")
    with history.machine("pump-1") as transaction:
        transaction.add_recording(judgment(1))
    history.close()

    answer = run("history", "export", str(config), "--out", str(out), "--json")
    assert json.loads(answer.stdout)["rows"]["recordings"] == 1
    assert (out / "recordings.csv").is_file()

    url = f"sqlite:///{tmp_path}/data/history.sqlite"
    refused = run("history", "export", url, "--out", str(out), code=3)
    assert "--force" in refused.stderr
    forced = run("history", "export", url, "--out", str(out), "--force")
    assert "recordings.csv" in forced.stdout


@pytest.mark.parametrize(
    "arguments",
    [
        pytest.param(("history", "export", "watch.toml", "--out", "out"), id="export"),
        pytest.param(("watch", "run", "watch.toml", "--once"), id="watch"),
    ],
)
def test_without_its_extra_a_command_of_the_watch_reports_what_to_install(
    tmp_path: Path, arguments: tuple[str, ...]
) -> None:
    write_example(tmp_path / "watch.toml")

    # A process, since the modules of this one are imported already.
    process = subprocess.run(
        [sys.executable, "-c", PROGRAM_WITHOUT_SQLALCHEMY, *arguments],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )

    assert process.returncode == 3
    message = 'needs sqlalchemy, which is not installed: pip install "swashtwin[monitor]"'
    assert message in process.stderr
