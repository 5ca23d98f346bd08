"""The command line explains itself, and answers a wrong word in one line."""

import importlib.metadata
import importlib.util
import inspect
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, get_args

import pytest
from commandline import AT_15, one_line, run
from typer.main import get_command
from typer.testing import CliRunner

import swashtwin
from swashtwin.cli import app, application, console
from swashtwin.cli.application import FIRST, GROUPS, PUMPS
from swashtwin.cli.options import READING

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
    process = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    modules = process.stderr.split()
    assert "calibrate" in process.stdout
    assert not set(HEAVY) & set(modules)
    assert len(modules) <= 450


def _paths(command: Any, *names: str) -> list[tuple[str, ...]]:
    inner = getattr(command, "commands", None)
    return [names] if inner is None else [path for name in inner for path in _paths(inner[name], *names, name)]


@pytest.mark.parametrize("path", _paths(get_command(app)), ids=" ".join)
def test_every_command_explains_itself_and_can_print_json(path: tuple[str, ...]) -> None:
    said = run(*path, "--help").stdout
    assert "--json" in said or path == ("explore",)  # which serves a page until it is ended


def test_the_first_screen_is_in_the_order_of_a_user_s_work() -> None:
    assert " ".join(FIRST) == "index explore inspect check train evaluate diagnose calibrate synthesize report"
    assert list(GROUPS) == ["data", "signal", "twin", "history", "model"]


@pytest.mark.parametrize(("command", "most"), [("train", 17), ("calibrate", 15)])
def test_a_command_has_few_options_since_set_takes_the_rest(command: str, most: int) -> None:
    parameters = get_command(app).commands[command].params  # type: ignore[attr-defined]
    options = [parameter for parameter in parameters if parameter.param_type_name == "option"]
    assert sum(option.name not in READING for option in options) <= most


def kinds_of_options() -> dict[str, set[str]]:
    """Kinds of value that each option takes, over all commands; a repeatable option takes one of its kind."""
    functions = [*FIRST.values(), *PUMPS.values()]
    functions += [function for _, commands in GROUPS.values() for function in commands.values()]
    kinds: dict[str, set[str]] = {}
    for function in functions:
        for name, parameter in inspect.signature(function).parameters.items():
            annotation, words = get_args(parameter.annotation)
            (kind,) = {*(get_args(annotation) or [annotation])} - {type(None)}
            option = next(iter(getattr(words, "param_decls", None) or ()), f"--{name}").split("/")[0]
            kinds.setdefault(option, set()).add((get_args(kind) or [kind])[0].__name__)
    return kinds


def test_an_option_takes_the_same_kind_of_value_in_every_command() -> None:
    kinds = kinds_of_options()
    assert len(kinds) > 50
    assert [option for option, names in kinds.items() if len(names) > 1] == []


@pytest.mark.parametrize(
    ("typed", "answer"),
    [("swashtwin ca", "calibrate"), ("swashtwin bench stu", "study"), ("swashtwin train --win", "--window")],
)
def test_the_shell_completes_commands_and_options(typed: str, answer: str) -> None:
    if "bench" in typed:
        pytest.importorskip("swashtwin_bench")
    environment = {"_SWASHTWIN_COMPLETE": "complete_bash", "COMP_WORDS": typed, "COMP_CWORD": str(typed.count(" "))}
    process = CliRunner().invoke(app, [], env=environment, prog_name="swashtwin")
    assert answer in process.output.split()


def test_a_command_that_takes_long_shows_its_progress(monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    with console.progress("quick") as bar:
        bar(1, 2)
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(console, "_PATIENCE", 0.0)
    for is_terminal in (False, True):
        monkeypatch.setattr(sys.stderr, "isatty", lambda answer=is_terminal: answer)
        with console.progress("slow") as bar:
            time.sleep(0.3)
            bar(1, 2, "half")
        assert ("half" in capsys.readouterr().err) == is_terminal


def test_without_a_terminal_progress_is_a_line_now_and_then(monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    moment = iter([0.0, 5.0, 25.0, 25.0, 30.0])
    monkeypatch.setattr(console.time, "monotonic", lambda: next(moment))
    with console.progress("slow") as bar:
        for count in range(3):
            bar(count, 3)
    assert capsys.readouterr().err == "slow: 1 of 3\n"


def test_the_version_is_the_package_s() -> None:
    assert run("--version").stdout.strip() == swashtwin.__version__


@pytest.mark.parametrize("words", [("bench", "study", "case1"), ("demo",), ("watch", "demo", "--end")])
def test_without_the_bench_its_commands_say_the_line_that_installs_it(
    words: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(importlib.metadata, "entry_points", lambda **_: importlib.metadata.EntryPoints())
    spec = importlib.util.spec_from_file_location("application_alone", application.__file__)
    assert spec is not None
    assert spec.loader is not None
    alone = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(alone)
    result = CliRunner().invoke(alone.app, words)
    assert isinstance(result.exception, SystemExit)
    assert "pip install swashtwin-bench" in " ".join(result.output.split())
