"""The history as tables of other programs."""

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


@pytest.fixture
def filled(history: History) -> History:
    """A history with a row in each table, and texts that a spreadsheet takes for formulas."""
    with history.machine("=pump") as transaction:
        for number in range(3):
            values = {("x", "rms"): number / 3, ("=y", "rms"): 1.0}
            if number == 2:
                values = {("x", "kurtosis"): 3.0, ("x", "rms"): 2.0}
            transaction.add_recording(judgment(number, label="=1+1", reasons={"a": [1]}), values)
        transaction.open_alarm("pump", None, START, {"rise": 9.0}, 1)
        transaction.silence(START, "-operator", "@home")
        transaction.add_event("maintenance", "+fitter", "new slippers")
        transaction.post("log", {"text": "=cmd"})
    with history.machine("pump-2") as transaction:
        transaction.add_event("note", "me")
    history.reject(rejection("=a.wav", "c"))
    return history


COUNTS = {
    "recordings": 3,
    "alarms": 1,
    "silences": 1,
    "events": 2,
    "rejections": 1,
    "outbox": 1,
    "indicators/_pump": 3,
    "indicators/pump-2": 0,
}


def test_csv_holds_every_row_and_no_formula(filled: History, tmp_path: Path) -> None:
    assert filled.export(tmp_path / "out") == COUNTS
    tables = {}
    for name in COUNTS:
        with (tmp_path / "out" / f"{name}.csv").open(encoding="utf-8", newline="") as file:
            header, *lines = csv.reader(file)
        assert not [
            cell for line in (header, *lines) for cell in line if cell[:1] in ("=", "+", "@")
        ]
        tables[name] = [dict(zip(header, line, strict=True)) for line in lines]
    assert tables["recordings"][0]["machine"] == "'=pump"
    assert tables["recordings"][0]["time"] == "2026-03-01T06:00:00Z"
    assert json.loads(tables["recordings"][0]["reasons"]) == {"a": [1]}
    assert tables["silences"][0]["who"] == "'-operator"
    assert [line["x rms"] for line in tables["indicators/_pump"]][2] == "2.0"
    assert [line["x kurtosis"] for line in tables["indicators/_pump"]] == ["", "", "3.0"]


def test_the_command_exports_what_a_configuration_or_a_url_names_and_makes_no_database(
    tmp_path: Path, postgresql_url: str
) -> None:
    config, out, url = (
        tmp_path / "watch.toml",
        tmp_path / "tables",
        f"sqlite:///{tmp_path}/data/history.sqlite",
    )
    config.write_text(
        'folder = "data"\n[[machine]]\nname = "pump-1"\n[[source]]\nkind = "http"\n',
        encoding="utf-8",
    )
    for nowhere, message in ((url, "does not exist"), (postgresql_url, "has no history yet")):
        assert message in run("history", "export", nowhere, "--out", str(out), code=3).stderr
    assert not (tmp_path / "data").exists()
    history = History.open("", tmp_path / "data")
    with history.machine("pump-1") as transaction:
        transaction.add_recording(judgment(1))
    history.close()
    answer = json.loads(run("history", "export", str(config), "--out", str(out), "--json").stdout)
    assert answer["rows"]["recordings"] == 1
    assert (out / "recordings.csv").is_file()
    assert "--force" in run("history", "export", url, "--out", str(out), code=3).stderr
    assert "recordings.csv" in run("history", "export", url, "--out", str(out), "--force").stdout


def test_without_its_extra_a_watch_says_what_to_install(tmp_path: Path) -> None:
    write_example(tmp_path / "watch.toml")
    program = "import sys; sys.modules['sqlalchemy'] = None; from swashtwin.cli import main; main()"
    for arguments in (
        ("history", "export", "watch.toml", "--out", "out"),
        ("watch", "run", "watch.toml", "--once"),
    ):
        command = [sys.executable, "-c", program, *arguments]
        process = subprocess.run(
            command, cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False
        )
        assert process.returncode == 3
        error_text = process.stderr.replace("'", '"')
        assert (
            'needs sqlalchemy, which is not installed: pip install "swashtwin[monitor]"'
            in error_text
        )
