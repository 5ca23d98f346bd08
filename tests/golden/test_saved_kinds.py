"""A saved file that another version wrote is refused with a clear message, never half loaded."""

import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from golden_files import load_golden
from saved_kinds import SAVED_KINDS, WITHOUT_VERSION, SavedKind
from stored_keys import STORED_KEYS, stored_keys

from swashtwin.calibration.result import FORMAT_WITHOUT_MISTAKES
from swashtwin.diagnosis.classifier_file import VERSION_WITHOUT_MACHINES
from swashtwin.foundation import SwashTwinError
from swashtwin.monitoring.history.database import EXTENDED_VERSION

MAX_MESSAGE_LENGTH = 700


@pytest.fixture(scope="module")
def saved_file(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str, Path], Path]:
    """Copy the file of a kind, and what lies beside it, into a folder."""
    originals: dict[str, Path] = {}

    def copy(name: str, folder: Path) -> Path:
        if name not in originals:
            original_folder = tmp_path_factory.mktemp("saved")
            originals[name] = SAVED_KINDS[name].write(original_folder)
        original = originals[name]
        shutil.copytree(original.parent, folder)
        return folder / original.name

    return copy


def refusal(kind: SavedKind, path: Path) -> str:
    """The message with which a file is refused; empty if it is loaded."""
    try:
        kind.load(path)
    except SwashTwinError as error:
        return error.describe(lambda name: name)
    return ""


def unclear(path: Path, message: str, cause: str, remedy: str) -> str:
    """What a message lacks; empty if it names the file, the cause and the remedy in one line."""
    if not message:
        return "loaded"
    for pattern in (re.escape(path.name), re.escape(cause), remedy):
        if not re.search(pattern, message):
            return f"does not name {pattern!r}: {message}"
    if "\n" in message or len(message) > MAX_MESSAGE_LENGTH:
        return f"too long: {message}"
    return ""


@pytest.mark.parametrize("name", SAVED_KINDS)
def test_a_key_is_renamed_with_a_new_version_only(
    name: str, saved_file: Callable[[str, Path], Path], tmp_path: Path
) -> None:
    """If it fails, raise the version of the kind, then write the listing with regenerate.py."""
    path = saved_file(name, tmp_path / "file")
    assert stored_keys(name, path) == load_golden(STORED_KEYS)[name]


@pytest.mark.parametrize("name", [name for name in SAVED_KINDS if name not in WITHOUT_VERSION])
def test_another_version_is_refused(
    name: str, saved_file: Callable[[str, Path], Path], tmp_path: Path
) -> None:
    kind = SAVED_KINDS[name]
    number = re.search(r"\d+$", kind.file.version(saved_file(name, tmp_path / "file")))
    assert number is not None
    unclear_messages = {}
    others = {int(number[0]) + 1, int(number[0]) - 1, 999_999}
    if name == "history":
        # A plant's history of the previous version is extended when it is opened.
        others.remove(EXTENDED_VERSION)
    if name == "calibration":
        # A calibration of the previous version is read; it lists no mistakes.
        others.remove(int(FORMAT_WITHOUT_MISTAKES.rsplit(" ", 1)[1]))
    if name == "classifier":
        # A classifier of the previous version keeps its confidence of one machine.
        others.remove(VERSION_WITHOUT_MACHINES)
    for other in sorted(others):
        path = saved_file(name, tmp_path / str(other))
        version = re.sub(r"\d+$", str(other), kind.file.version(path))
        kind.file.set_version(path, version)
        unclear_messages[version] = unclear(path, refusal(kind, path), version, kind.remedy)
    assert {version: text for version, text in unclear_messages.items() if text} == {}


@pytest.mark.parametrize("change", ["removed", "renamed"])
@pytest.mark.parametrize("name", SAVED_KINDS)
def test_a_missing_or_renamed_key_is_refused(
    name: str, change: str, saved_file: Callable[[str, Path], Path], tmp_path: Path
) -> None:
    kind = SAVED_KINDS[name]
    path = saved_file(name, tmp_path / "file")
    assert refusal(kind, path) == ""

    unclear_messages = {}
    for number, key in enumerate(kind.file.keys(path)):
        if change == "removed" and key in kind.optional:
            continue
        path = saved_file(name, tmp_path / str(number))
        word = re.split(r"[.\[\]]+", key)[-1]
        kind.file.rename(path, key, None if change == "removed" else f"{word}_renamed")
        # The array head_bias is the entry head.bias.
        message = refusal(kind, path).replace("head.", "head_")
        remedy = "" if kind.is_edited else kind.remedy
        unclear_messages[key] = unclear(path, message, word, remedy)
    assert {key: text for key, text in unclear_messages.items() if text} == {}
