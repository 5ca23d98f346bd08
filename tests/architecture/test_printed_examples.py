"""The examples of docs/extending.md run as printed."""

import re
from pathlib import Path
from typing import Any

import pytest

from swashtwin.learning import NETWORKS
from swashtwin.pump.faults import _faults
from swashtwin.recordings.formats.registry import _registered
from swashtwin.synthesis.registry import FILLERS

ROOT = Path(__file__).parents[2]


def blocks(document: str, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", (ROOT / document).read_text(encoding="utf-8"), flags=re.DOTALL)


@pytest.fixture
def _own_registries(monkeypatch: pytest.MonkeyPatch) -> None:
    """Forget after the test what its examples register."""
    names: tuple[tuple[dict[str, Any], str], ...] = (
        (NETWORKS, "small_cnn"),
        (_faults, "cracked_plate"),
        (_registered, ".counts"),
        (FILLERS, "reversed"),
    )
    for registry, name in names:
        monkeypatch.setitem(registry, name, None)
        del registry[name]


@pytest.mark.usefixtures("_own_registries")
def test_each_example_of_extending_runs_as_printed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    for example in blocks("docs/extending.md", "python"):
        exec(example, names)
    assert names["twin"].label == "cracked_plate"
    assert names["more"].synthetic.all()
    assert names["recording"].unit == "m/s^2"
