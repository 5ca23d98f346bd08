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

PACKAGE = Path(swashtwin.__file__).parent

HEAVY = ("torch", "numpy", "scipy", "sklearn", "matplotlib", "h5py", "arro3", "pint", "joblib")
"""Libraries that take a noticeable time to import."""


@pytest.mark.parametrize(
    "arguments",
    [
        pytest.param(("bench", "rig"), id="missing argument"),
        pytest.param(("calibrate", "x", *AT_15, "--method", "guess"), id="unknown method"),
        pytest.param(
            ("calibrate", "x", *AT_15, "--method", "gauss-newton", "--set", "epochs=5"),
            id="setting of another method",
        ),
        pytest.param(("bench", "study", "case1", "x", "--seeds", "a,b"), id="seed is no number"),
        pytest.param(("demo", "--seed", "0"), id="missing folder"),
    ],
)
def test_a_wrong_command_line_ends_with_code_2_and_the_usage(
    arguments: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)

    result = run(*arguments, code=2)

    assert not result.stdout
    assert "Usage" in result.stderr


def test_a_misspelled_command_is_answered_with_the_nearest() -> None:
    result = run("trian", code=2)

    assert not result.stdout
    assert "Usage" in result.stderr
    assert "train" in result.stderr


def test_an_unexpected_error_asks_for_a_report_and_shows_its_traceback_on_request(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("swashtwin.pump.load_pump", lambda name: 1 / 0)

    assert "ZeroDivisionError" in one_line(run("twin", "pump", "show", code=1))
    assert "Traceback" in run("--debug", "twin", "pump", "show", code=1).stderr


def test_help_loads_few_modules_and_no_heavy_library() -> None:
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


NOT_AT_A_PLANT = ("torch", "numba", "sklearn", "matplotlib", "PIL", "fontTools", "pandas", "onnx")
"""Libraries that neither an inspection nor a watch without a model loads."""


def loaded_libraries(code: str) -> set[str]:
    """Return those of `NOT_AT_A_PLANT` that a process has loaded after it ran `code`."""
    process = subprocess.run(
        [sys.executable, "-c", f"import sys\n{code}\nprint(*sys.modules, file=sys.stderr)"],
        capture_output=True,
        text=True,
        check=True,
    )
    return set(NOT_AT_A_PLANT) & set(process.stderr.split())


def test_an_inspection_loads_no_library_for_figures_or_networks(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t [s],x [g]\n" + "".join(f"{k},{k % 7}\n" for k in range(99)))

    code = (
        f"sys.argv = ['swashtwin', 'inspect', {str(tmp_path / 'a.csv')!r}]\n"
        "from swashtwin.cli import main\n"
        "try: main()\n"
        "except SystemExit: pass"
    )

    assert loaded_libraries(code) == set()


def test_a_watch_and_its_pages_load_no_library_for_figures_or_networks() -> None:
    pytest.importorskip("sqlalchemy")
    pytest.importorskip("fastapi")

    code = "import swashtwin.monitoring.page.server, swashtwin.monitoring.service.running"

    assert loaded_libraries(code) == set()


def command_paths(command: Any, *names: str) -> list[tuple[str, ...]]:
    """Return the words of each command below a group, or of the command itself."""
    subcommands = getattr(command, "commands", None)
    if subcommands is None:
        return [names]

    paths = []
    for name, subcommand in subcommands.items():
        paths += command_paths(subcommand, *names, name)
    return paths


@pytest.mark.parametrize("path", command_paths(get_command(app)), ids=" ".join)
def test_every_command_explains_itself_and_can_print_json(path: tuple[str, ...]) -> None:
    text = run(*path, "--help").stdout

    # explore serves a page until it is ended, and prints no result
    if path != ("explore",):
        assert "--json" in text


def test_without_a_terminal_progress_is_printed_at_intervals(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    clock = [0.0]
    monkeypatch.setattr(console.time, "monotonic", lambda: clock[0])

    # step 0 is too early after the start, and step 2 too early after step 1
    with console.progress("slow") as bar:
        for count, time in enumerate([5.0, 25.0, 30.0]):
            clock[0] = time
            bar(count, 3)

    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("slow: 1 of 3, ")


@pytest.mark.parametrize(
    "arguments",
    [("bench", "study", "case1"), ("demo",), ("watch", "demo", "--end")],
    ids=" ".join,
)
def test_without_the_bench_its_commands_print_how_to_install_it(
    arguments: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        importlib.metadata, "entry_points", lambda **_: importlib.metadata.EntryPoints()
    )
    # the entry points are read at import, so that the application is imported a second time
    spec = importlib.util.spec_from_file_location("application_alone", application.__file__)
    assert spec is not None
    assert spec.loader is not None
    application_alone = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(application_alone)

    result = CliRunner().invoke(application_alone.app, arguments)

    assert isinstance(result.exception, SystemExit)
    assert "pip install swashtwin-bench" in " ".join(result.output.split())


def options_of(command: Any) -> set[str]:
    """Return every option of a command and of its subcommands."""
    options = set()
    for parameter in command.params:
        options.update(parameter.opts, parameter.secondary_opts)

    for subcommand in getattr(command, "commands", {}).values():
        options |= options_of(subcommand)
    return options


def test_every_option_that_the_package_names_exists() -> None:
    # --nthreads belongs to `dask worker`
    known_options = options_of(get_command(app)) | {"--help", "--nthreads"}

    named_options = set()
    for path in PACKAGE.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        for option in re.findall(r"(?<![\w-])--[a-z][a-z-]*", text):
            named_options.add((path.name, option))

    # so that an expression that matches nothing does not pass
    assert len(named_options) > 50
    assert [pair for pair in named_options if pair[1] not in known_options] == []


def test_an_error_names_the_option_of_the_argument_that_it_is_about(tmp_path: Path) -> None:
    file = tmp_path / "a.csv"
    file.write_text("cover_z\n" + "\n".join(str(number % 7) for number in range(4000)))
    facts = ("--sample-rate", "2 kHz", "--unit", "g", *AT_15, "--channels", "cover_z")

    line = one_line(run("calibrate", file, *facts, "--band", "0-90 kHz", code=3))

    # 98 % of half the sample rate, the upper limit of a band
    assert line.endswith("end it at 980 Hz. (--band)"), line
