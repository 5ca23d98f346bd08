"""The command line explains itself, and answers a wrong word in one line."""

import importlib.metadata
import importlib.util
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from commandline import AT_15, one_line, run
from typer.main import get_command
from typer.testing import CliRunner

import swashtwin
from swashtwin.cli import app, application, console

HEAVY = ("torch", "numpy", "scipy", "sklearn", "matplotlib", "h5py", "polars", "pint", "joblib")


@pytest.mark.parametrize(
    "words",
    [
        ("trian",),
        ("bench", "rig"),
        ("calibrate", "x", *AT_15, "--method", "guess"),
        ("calibrate", "x", *AT_15, "--method", "gauss-newton", "--set", "epochs=5"),
        ("bench", "study", "case1", "x", "--seeds", "a,b"),
        ("demo", "--seed", "0"),
    ],
)
def test_a_wrong_command_line_ends_with_code_2(
    words: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = run(*words, code=2)
    assert not result.stdout
    assert "Usage" in result.stderr
    assert words[0] != "trian" or "train" in result.stderr


def test_an_unexpected_error_asks_for_a_report_and_shows_its_traceback_on_request(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("swashtwin.pump.load_pump", lambda name: 1 / 0)
    assert "ZeroDivisionError" in one_line(run("twin", "pump", "show", code=1))
    assert "Traceback" in run("--debug", "twin", "pump", "show", code=1).stderr


def test_help_loads_few_modules_and_none_that_is_heavy() -> None:
    code = (
        "import sys; sys.argv = ['swashtwin', '--help']\n"
        "from swashtwin.cli import main\n"
        "try: main()\n"
        "except SystemExit: print(*sys.modules, file=sys.stderr)"
    )
    process = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    modules = process.stderr.split()
    assert "calibrate" in process.stdout
    assert not set(HEAVY) & set(modules)
    assert len(modules) <= 450


def _paths(command: Any, *names: str) -> list[tuple[str, ...]]:
    inner = getattr(command, "commands", None)
    return (
        [names]
        if inner is None
        else [path for name in inner for path in _paths(inner[name], *names, name)]
    )


@pytest.mark.parametrize("path", _paths(get_command(app)), ids=" ".join)
def test_every_command_explains_itself_and_can_print_json(path: tuple[str, ...]) -> None:
    said = run(*path, "--help").stdout
    assert "--json" in said or path == ("explore",)  # which serves a page until it is ended


def test_without_a_terminal_progress_is_a_line_now_and_then(
    monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    moment = iter([0.0, 5.0, 25.0, 25.0, 30.0])
    monkeypatch.setattr(console.time, "monotonic", lambda: next(moment))
    with console.progress("slow") as bar:
        for count in range(3):
            bar(count, 3)
    assert capsys.readouterr().err == "slow: 1 of 3\n"


@pytest.mark.parametrize(
    "words", [("bench", "study", "case1"), ("demo",), ("watch", "demo", "--end")]
)
def test_without_the_bench_its_commands_say_the_line_that_installs_it(
    words: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        importlib.metadata, "entry_points", lambda **_: importlib.metadata.EntryPoints()
    )
    spec = importlib.util.spec_from_file_location("application_alone", application.__file__)
    assert spec is not None
    assert spec.loader is not None
    alone = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(alone)
    result = CliRunner().invoke(alone.app, words)
    assert isinstance(result.exception, SystemExit)
    assert "pip install swashtwin-bench" in " ".join(result.output.split())


PACKAGE = Path(swashtwin.__file__).parent


def options_of(command: Any) -> set[str]:
    """Every option of a command and of the commands within it."""
    options = {
        option
        for parameter in command.params
        for option in (*parameter.opts, *parameter.secondary_opts)
    }
    return options.union(*map(options_of, getattr(command, "commands", {}).values()))


def test_every_option_that_the_package_names_exists() -> None:
    known = options_of(get_command(app)) | {"--help", "--nthreads"}  # the second of dask worker
    texts = {path.name: path.read_text(encoding="utf-8") for path in PACKAGE.rglob("*.py")}
    named = {
        (name, option)
        for name, text in texts.items()
        for option in re.findall(r"(?<![\w-])--[a-z][a-z-]*", text)
    }
    assert len(named) > 50
    assert [(name, option) for name, option in named if option not in known] == []


def test_an_error_names_the_option_of_the_argument_that_it_is_about(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("cover_z\n" + "\n".join(str(i % 7) for i in range(4000)))
    facts = ("--sample-rate", "2 kHz", "--unit", "g", *AT_15, "--channels", "cover_z")
    line = one_line(run("calibrate", tmp_path / "a.csv", *facts, "--band", "0-90 kHz", code=3))
    assert line.endswith("end it at 980 Hz. (--band)"), line
