"""Commands answer with `--json` what the golden files say: the same keys, words and numbers."""

import pytest
from golden_commands import COMMANDS, Workspace
from golden_files import FOLDER, differences, load_golden
from golden_values import VALUES
from json_page import PAGE, page_text
from stored_keys import STORED_KEYS


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_answers_what_its_golden_file_says(name: str, workspace: Workspace) -> None:
    command = COMMANDS[name]
    golden = load_golden(f"answer_{name}")

    assert (
        list(differences(workspace.answer(name), golden, rtol=command.rtol, atol=command.atol))
        == []
    )


def test_every_golden_file_is_compared_with_something() -> None:
    names = {*VALUES, STORED_KEYS, *(f"answer_{name}" for name in COMMANDS)}
    assert {path.stem for path in FOLDER.glob("*.json")} == names


def test_the_page_of_answers_is_made_from_them() -> None:
    assert PAGE.read_text(encoding="utf-8") == page_text()
