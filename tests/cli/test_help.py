"""The command line explains itself, and answers a wrong word in one line."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from commandline import AT_15, one_line, run
from typer.main import get_command

import swashtwin
from swashtwin.cli import app

HEAVY = ("torch", "numpy", "scipy", "sklearn", "matplotlib", "h5py", "polars", "pint", "joblib")


@pytest.mark.parametrize(
    "words",
    [
        ("trian",),
        ("bench", "rig"),
        ("calibrate", "x", *AT_15, "--method", "guess"),
        ("calibrate", "x", *AT_15, "--method", "gauss-newton", "--set", "epochs=5"),
        ("bench", "case1", "x", "--seeds", "a,b"),
        ("demo", "--jobs", "0"),
    ],
)
def test_a_wrong_command_line_ends_with_code_2(
    words: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = run(*words, code=2)
    assert not result.stdout
    assert "Usage" in result.stderr


def test_a_wrong_command_is_answered_with_the_nearest() -> None:
    assert "train" in run("trian", code=2).stderr


def test_an_unexpected_error_asks_for_a_report_and_shows_its_traceback_on_request(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def broken(name: str) -> None:
        raise ZeroDivisionError("division by zero")

    monkeypatch.setattr("swashtwin.pump.load_pump", broken)
    assert "ZeroDivisionError" in one_line(run("twin", "pump", "show", code=1))
    assert "Traceback" in run("--debug", "twin", "pump", "show", code=1).stderr


def test_help_answers_at_once_and_loads_nothing_heavy() -> None:
    code = (
        "import sys, time; sys.argv = ['swashtwin', '--help']\n"
        "from swashtwin.cli import main\n"
        "try: main()\n"
        "except SystemExit: print(time.process_time(), *sys.modules, file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    seconds, *modules = done.stderr.split()
    assert "calibrate" in done.stdout
    assert float(seconds) < 1.0
    assert not set(HEAVY) & set(modules)


def _paths(command: Any, *names: str) -> list[tuple[str, ...]]:
    inner = getattr(command, "commands", None)
    return [names] if inner is None else [path for name in inner for path in _paths(inner[name], *names, name)]


@pytest.mark.parametrize("path", _paths(get_command(app)), ids=" ".join)
def test_every_command_explains_itself_and_can_print_json(path: tuple[str, ...]) -> None:
    said = run(*path, "--help").stdout
    assert "--json" in said


def test_the_version_is_the_package_s() -> None:
    assert run("--version").stdout.strip() == swashtwin.VERSION


def test_python_m_is_the_same_command() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "swashtwin", "twin", "pump"], capture_output=True, text=True, check=False
    )
    assert "show" in done.stdout + done.stderr
