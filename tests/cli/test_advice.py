"""Errors in the shell speak of options, never of Python calls."""

import ast
import re
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
from commandline import PYTHON_WORDS
from typer.main import get_command

import swashtwin
from swashtwin.cli import app
from swashtwin.cli.advice import in_options

PACKAGE = Path(swashtwin.__file__).parent
NO_COMMAND = {
    "diagnosis/fault_classifier.py": "scikit-learn's interface, which takes arrays",
    "diagnosis/classifier_input.py": "the data that this interface takes",
    "calibration/uncertainty/sampling.py": "sampling the posterior has no command",
}
"""Modules whose errors no command can raise, and why."""
METHODS = {"ADASYN", "BiTCN", "MPa", "RK4"}
"""Public names that are also names of methods and units."""
ROOMS = ("foundation", "pump", "recordings", "signals", "physics", "calibration", "learning", "synthesis", "diagnosis")


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
    assert [(where, shown) for where, text in texts if PYTHON_WORDS.search(shown := in_options(text))] == []


def test_no_error_of_the_package_shows_a_name_of_the_public_api_in_the_shell() -> None:
    doors = [swashtwin, *(import_module(f"swashtwin.{door}") for door in ROOMS)]
    names = {
        name for door in doors for name in door.__all__ if re.search("[a-zA-Z]_|[a-z][A-Z]|[A-Z]{2}", name)
    } - METHODS
    pattern = re.compile(rf"(?<![\w./-])({'|'.join(sorted(names))})(?![\w-])")
    assert [(where, shown) for where, text in error_texts() if pattern.search(shown := in_options(text))] == []


def options_of(command: Any) -> set[str]:
    """Every option of a command and of the commands within it."""
    options = {option for parameter in command.params for option in (*parameter.opts, *parameter.secondary_opts)}
    return options.union(*map(options_of, getattr(command, "commands", {}).values()))


def test_every_option_that_an_error_names_exists() -> None:
    options = options_of(get_command(app)) | {"--nthreads"}  # of dask worker
    shown = [
        (where, option) for where, text in error_texts() for option in re.findall(r"--[a-z][a-z-]*", in_options(text))
    ]
    assert len(shown) > 50
    assert [(where, option) for where, option in shown if option not in options] == []


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("860 rev/min is rpm(860).", '860 rev/min is "860 rpm".'),
        ("resume=True needs checkpoint=, the file.", "--resume needs --checkpoint, the file."),
        ("calibrate with phases=False.", "calibrate with --no-phases."),
        ("needs a fault; use lines='piston'.", "needs a fault; use --lines piston."),
        ("use band=(0, 1200).", 'use --band "0-1200 Hz".'),
        ("select its recordings: --specimen, or recordings.where(specimen=...).", "select its recordings: --specimen."),
        ("leave the solver at HarmonicBalance() (--solver harmonic-balance).",
         "leave the solver at --solver harmonic-balance."),
        ("a classifier is saved with save_classifier(classifier, path), or by swashtwin train",
         "a classifier is saved by swashtwin train"),
        ("take length 1787 or more, or allow_partial_revolution=True.",
         "take --window 1787 or more, or --allow-partial-revolution."),
        ("SwashPlateDefect.length (3 mm) is too long", "length (3 mm) is too long"),
        ("LooseSlipper.csv is damaged", "LooseSlipper.csv is damaged"),
        ("a.toml is not an index (recordings.toml); one file alone is loaded by load_recording.",
         "a.toml is not an index (recordings.toml); swashtwin index FOLDER writes one."),
        ("there are 2 channel(s) of 1 class(es), a==b", "there are 2 channel(s) of 1 class(es), a==b"),
    ],
)  # fmt: skip
def test_advice_is_said_as_options(text: str, shown: str) -> None:
    assert in_options(text) == shown
