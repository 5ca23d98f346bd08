"""README is short, and its commands work in the shells of every system."""

import re
from pathlib import Path

README = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")


def code_blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, flags=re.DOTALL)


def test_readme_has_at_most_600_words() -> None:
    assert len(README.split()) <= 600


def test_each_command_of_the_installation_starts_on_a_fresh_machine() -> None:
    installation = code_blocks("sh")[0].splitlines()
    assert len(installation) == 2
    for command in installation:
        assert command.startswith("python3 -m venv .venv && .venv/bin/pip install ")


def test_the_installation_on_windows_has_the_steps_of_other_systems() -> None:
    unix_steps = []
    for block in code_blocks("sh"):
        for step in re.split(r"&&|\n", block):
            if ".venv" in step:
                unix_steps.append(step.strip())
    windows_steps = [line for block in code_blocks("bat") for line in block.splitlines()]

    expected_steps = []
    # two blocks of sh may share a step
    for step in dict.fromkeys(unix_steps):
        windows_step = step.replace("python3 ", "py ").replace(".venv/bin/", ".venv\\Scripts\\")
        expected_steps.append(windows_step)
    assert expected_steps == windows_steps


def test_other_commands_are_the_same_in_every_shell() -> None:
    lines = [
        line for block in code_blocks("sh") for line in block.splitlines() if ".venv" not in line
    ]
    assert lines

    # cmd.exe knows no single quotes, PowerShell expands `$` and backquotes, and each continues
    # lines in its own way
    assert [line for line in lines if re.search(r"['$`!]|\\$|&&", line)] == []
