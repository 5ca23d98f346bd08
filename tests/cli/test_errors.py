"""Errors in the shell speak of options, never of Python calls."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from commandline import AT_15, PYTHON_WORDS, one_line, run
from typer.main import get_command

import swashtwin
from swashtwin.cli import app

PACKAGE = Path(swashtwin.__file__).parent
NO_COMMAND = {
    "diagnosis/fault_classifier.py": "scikit-learn's interface, which takes arrays",
    "diagnosis/classifier_input.py": "the data that this interface takes",
    "calibration/uncertainty/sampling.py": "sampling the posterior has no command",
}
"""Modules whose errors no command can raise, and why."""


def text_of(node: ast.AST) -> str:
    """Text of an expression, ``7`` for whatever is filled in."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        return "".join(value.value if isinstance(value, ast.Constant) else "7" for value in node.values)
    return text_of(node.left) + text_of(node.right) if isinstance(node, ast.BinOp) else ""


def error_texts() -> Iterator[tuple[str, str]]:
    """(where, text) of every text in a ``raise`` of the package."""
    for path in sorted(PACKAGE.rglob("*.py")):
        name = path.relative_to(PACKAGE).as_posix()
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Raise) and name not in NO_COMMAND:
                pending: list[ast.AST] = [node]
                while pending:
                    part = pending.pop()
                    if text := text_of(part):
                        yield f"{name}:{node.lineno}", text
                    else:
                        pending += ast.iter_child_nodes(part)


def test_no_error_of_the_package_shows_python_in_the_shell() -> None:
    texts = list(error_texts())
    assert len(texts) > 500
    assert [(where, text) for where, text in texts if PYTHON_WORDS.search(text)] == []


def options_of(command: Any) -> set[str]:
    """Every option of a command and of the commands within it."""
    options = {option for parameter in command.params for option in (*parameter.opts, *parameter.secondary_opts)}
    return options.union(*map(options_of, getattr(command, "commands", {}).values()))


def test_every_option_that_an_error_names_exists() -> None:
    options = options_of(get_command(app)) | {"--nthreads"}  # of dask worker
    shown = [(where, option) for where, text in error_texts() for option in re.findall(r"--[a-z][a-z-]*", text)]
    assert shown
    assert [(where, option) for where, option in shown if option not in options] == []


def test_an_error_names_the_option_of_the_argument_that_it_is_about(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("cover_z\n" + "\n".join(str(i % 7) for i in range(4000)))
    facts = ("--sample-rate", "2 kHz", "--unit", "g", *AT_15, "--channels", "cover_z")
    line = one_line(run("calibrate", tmp_path / "a.csv", *facts, "--band", "0-90 kHz", code=3))
    assert line.endswith("end it at 980 Hz. (--band)"), line
