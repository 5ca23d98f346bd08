"""The commands of a watch, and its page of the documentation, as a user types them."""

import json
import re
from pathlib import Path
from typing import Any

import pytest
from commandline import run
from typer.testing import CliRunner

from swashtwin.cli import app

DOCUMENT = (Path(__file__).parents[2] / "docs" / "tutorials" / "watch.md").read_text(
    encoding="utf-8"
)


def test_the_tutorial_runs_as_printed_and_ends_with_an_alarm(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    answers = []
    for language, block in re.findall(r"```(sh|python)\n(.*?)```", DOCUMENT, flags=re.DOTALL):
        if language == "python":
            exec(block, names)
            continue
        for line in block.splitlines():
            words = re.findall(r'"[^"]*"|\S+', line)
            if words[:2] != ["swashtwin", "watch"] or words[2] == "demo":
                continue
            once = ["--once"] if words[2] == "run" and "--once" not in words else []
            answers.append(run(*[word.strip('"') for word in words[1:]], *once).stdout)
    assert "r019.h5: learning 20/20" in answers[1]
    assert "pump alarm raised" in answers[2]
    assert "learning its baseline again" in answers[3]
    assert "pump alarm opened" in (tmp_path / "watch-data" / "alarms.log").read_text(
        encoding="utf-8"
    )


def test_a_configuration_may_follow_watch_directly(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    run("watch", "init")
    (tmp_path / "incoming").mkdir()
    assert "0 judged" in run("watch", "watch.toml", "--once").stdout
    assert json.loads(run("watch", "--once", "watch.toml", "--json").stdout)["judged"] == 0


def test_people_and_programs_are_let_in_and_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    run("watch", "init")
    config = Path("watch.toml")
    config.write_text(
        config.read_text(encoding="utf-8").replace("# users = ", "users = "), encoding="utf-8"
    )
    password = "correct horse battery"
    said = (
        CliRunner()
        .invoke(app, ["watch", "user", "watch.toml", "kim"], input=f"{password}\n{password}\n")
        .output
    )
    assert "Added kim to" in said
    assert password not in said
    token = json.loads(run("watch", "user", "watch.toml", "uploader", "--token", "--json").stdout)[
        "token"
    ]
    saved = Path("users.json").read_text(encoding="utf-8")
    assert "kim" in saved
    assert token not in saved
    run("watch", "user", "watch.toml", "kim", "--remove")
    assert "kim" not in Path("users.json").read_text(encoding="utf-8")
