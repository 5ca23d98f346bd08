"""README's example and those of docs/how-to/extending.md run as printed."""

import re
import shlex
from pathlib import Path
from typing import Any

import pytest
from commandline import run

import swashtwin
from swashtwin.learning import NETWORKS
from swashtwin.pump.faults import _faults
from swashtwin.recordings.files import _registered

pytestmark = pytest.mark.nightly

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
    )
    for registry, name in names:
        monkeypatch.setitem(registry, name, None)
        del registry[name]


def test_readmes_example_runs_as_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """On a choice from fewer windows, and without the refits that explain a misfit; both have tests of their own."""
    monkeypatch.setattr("swashtwin.learning.choice.choosing.MOST_WINDOWS", 120)
    monkeypatch.setattr("swashtwin.calibration.uncertainty.misfit_hypotheses.misfit_hypotheses", lambda *_: ())
    monkeypatch.chdir(tmp_path)
    (rig,) = re.findall(r"`swashtwin (bench rig [^`]*)`", (ROOT / "README.md").read_text(encoding="utf-8"))
    run(*shlex.split(rig))
    (example,) = blocks("README.md", "python")
    names: dict[str, Any] = {}
    capsys.readouterr()
    exec(example, names)
    assert float(capsys.readouterr().out) > 0.6
    assert set(names["calibration"].recording_ids) <= set(names["train"].recording_ids)
    assert "<svg" in (tmp_path / "report" / "report.html").read_text(encoding="utf-8")


@pytest.mark.usefixtures("_own_registries")
def test_each_example_of_extending_runs_as_printed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    for example in blocks("docs/how-to/extending.md", "python"):
        exec(example, names)
    assert names["twin"].label == "cracked_plate"
    assert names["more"].synthetic.all()
    assert names["recording"].unit == "m/s^2"


def test_the_page_of_python_lists_every_public_name() -> None:
    listed = re.findall(r"^   (\w+)$", (ROOT / "docs/reference/api.md").read_text(encoding="utf-8"), flags=re.MULTILINE)
    assert sorted(listed) == sorted(set(swashtwin.__all__) - {"__version__"})
