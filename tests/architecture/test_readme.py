"""README is short, and its commands work in the shells of every system."""

import re
from pathlib import Path

README = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, flags=re.DOTALL)


def test_readme_has_600_words_at_most() -> None:
    assert len(README.split()) <= 600


def test_what_is_installed_from_a_shell_is_installed_in_the_same_way_on_windows() -> None:
    steps = [
        line.strip()
        for block in blocks("sh")
        for line in re.split(r"&&|\n", block)
        if ".venv" in line
    ]
    unix = list(dict.fromkeys(steps))
    windows = [line for block in blocks("bat") for line in block.splitlines()]
    assert [
        line.replace("python3 ", "py ").replace(".venv/bin/", ".venv\\Scripts\\") for line in unix
    ] == windows


def test_other_commands_are_the_same_in_every_shell() -> None:
    """cmd.exe knows no single quotes, PowerShell expands ``$`` and backquotes, and each continues
    lines its own way.
    """
    lines = [line for block in blocks("sh") for line in block.splitlines() if ".venv" not in line]
    assert lines
    assert [line for line in lines if re.search(r"['$`!]|\\$|&&", line)] == []
