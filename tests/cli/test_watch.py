"""The commands of a watch, and its page of the documentation, as a user types them."""

import json
import re
from pathlib import Path
from typing import Any

import pytest
from commandline import run
from typer.testing import CliRunner

from swashtwin.cli import app

TUTORIAL = Path(__file__).parents[2] / "docs" / "tutorials" / "watch.md"


def watch_arguments(line: str) -> list[str] | None:
    """Return the arguments of a line that runs a watch to its end, and `None` for other lines."""
    words = [word.strip('"') for word in re.findall(r'"[^"]*"|\S+', line)]
    # the demo runs for two minutes, until Ctrl-C ends it
    if words[:2] != ["swashtwin", "watch"] or words[2] == "demo":
        return None

    arguments = words[1:]
    if arguments[1] == "run" and "--once" not in arguments:
        arguments.append("--once")
    return arguments


def test_the_tutorial_runs_as_printed_and_ends_with_an_alarm(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    page = TUTORIAL.read_text(encoding="utf-8")
    names: dict[str, Any] = {}
    outputs = []

    for language, block in re.findall(r"```(sh|python)\n(.*?)```", page, flags=re.DOTALL):
        if language == "python":
            exec(block, names)
            continue
        for line in block.splitlines():
            arguments = watch_arguments(line)
            if arguments is not None:
                outputs.append(run(*arguments).stdout)

    assert "r019.h5: learning 20/20" in outputs[1]
    assert "pump alarm raised" in outputs[2]
    assert "learning its baseline again" in outputs[3]
    log = (tmp_path / "watch-data" / "alarms.log").read_text(encoding="utf-8")
    assert "pump alarm opened" in log


def test_a_configuration_may_follow_watch_directly(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    run("watch", "init")
    (tmp_path / "incoming").mkdir()

    assert "0 judged" in run("watch", "watch.toml", "--once").stdout
    assert json.loads(run("watch", "--once", "watch.toml", "--json").stdout)["judged"] == 0


@pytest.fixture
def users_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """File of the users of a watch whose page requires a login, in the current folder."""
    monkeypatch.chdir(tmp_path)
    run("watch", "init")
    config = Path("watch.toml")
    text = config.read_text(encoding="utf-8").replace("# users = ", "users = ")
    config.write_text(text, encoding="utf-8")
    return Path("users.json")


def add_kim(password: str) -> str:
    """Add the user kim, who types a password twice, and return what is printed."""
    arguments = ["watch", "user", "watch.toml", "kim"]
    return CliRunner().invoke(app, arguments, input=f"{password}\n{password}\n").output


def test_a_password_is_neither_printed_nor_saved(users_file: Path) -> None:
    password = "correct horse battery"

    output = add_kim(password)

    assert "Added kim to" in output
    assert password not in output
    users = users_file.read_text(encoding="utf-8")
    assert "kim" in users
    assert password not in users


def test_a_program_gets_a_token_that_is_not_saved(users_file: Path) -> None:
    arguments = ("watch", "user", "watch.toml", "uploader", "--token", "--json")

    token = json.loads(run(*arguments).stdout)["token"]

    assert token not in users_file.read_text(encoding="utf-8")


def test_a_removed_user_is_deleted_from_the_file(users_file: Path) -> None:
    add_kim("correct horse battery")
    assert "kim" in users_file.read_text(encoding="utf-8")

    run("watch", "user", "watch.toml", "kim", "--remove")

    assert "kim" not in users_file.read_text(encoding="utf-8")
