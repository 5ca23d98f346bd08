"""Errors in the shell speak of options that there are."""

import re
from pathlib import Path
from typing import Any

from commandline import AT_15, one_line, run
from typer.main import get_command

import swashtwin
from swashtwin.cli import app

PACKAGE = Path(swashtwin.__file__).parent


def options_of(command: Any) -> set[str]:
    """Every option of a command and of the commands within it."""
    options = {option for parameter in command.params for option in (*parameter.opts, *parameter.secondary_opts)}
    return options.union(*map(options_of, getattr(command, "commands", {}).values()))


def test_every_option_that_the_package_names_exists() -> None:
    known = options_of(get_command(app)) | {"--help", "--nthreads"}  # the second of dask worker
    texts = {path.name: path.read_text(encoding="utf-8") for path in PACKAGE.rglob("*.py")}
    named = {(name, option) for name, text in texts.items() for option in re.findall(r"(?<![\w-])--[a-z][a-z-]*", text)}
    assert len(named) > 50
    assert [(name, option) for name, option in named if option not in known] == []


def test_an_error_names_the_option_of_the_argument_that_it_is_about(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("cover_z\n" + "\n".join(str(i % 7) for i in range(4000)))
    facts = ("--sample-rate", "2 kHz", "--unit", "g", *AT_15, "--channels", "cover_z")
    line = one_line(run("calibrate", tmp_path / "a.csv", *facts, "--band", "0-90 kHz", code=3))
    assert line.endswith("end it at 980 Hz. (--band)"), line
