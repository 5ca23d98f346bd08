"""Every command and example that README and the documents print: it runs on small data as printed.

Blocks of shell are read line by line. What needs hours, a plant or a public set is parsed only
(`NOT_RUN`), and so is what a test of its own runs. A page whose commands need files finds them in
its folder (`PREPARED`); a command that is not listed runs, so a new one that lacks its files fails
here.
"""

import re
import shlex
import shutil
from collections.abc import Callable, Container, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commandline import run
from typer.core import TyperGroup
from typer.main import get_command

import swashtwin
from swashtwin.cli import app
from swashtwin.learning import NETWORKS
from swashtwin.pump.faults import _faults
from swashtwin.recordings import load_recordings, write_recording
from swashtwin.recordings.file_formats import _registered_readers
from swashtwin_bench import build_rig

ROOT = Path(__file__).parents[2]
EVIDENCE = "docs/bench/evidence.md"
"""Its commands run at the tags that it names."""
PAGES = {path.relative_to(ROOT).as_posix() for path in (ROOT / "docs").rglob("*.md")}
DOCUMENTS = sorted({"README.md", *PAGES} - {EVIDENCE})

NOT_RUN = (
    (r"bench (?!rig )", "a study takes minutes to days"),
    (r"bench rig (?!.*--size tiny)", "a rig of that size takes minutes"),
    (r"(watch|history) ", "tests/cli/test_watch.py runs the tutorial"),
    (r"explore ", "it serves until it is ended; tests/explorer run it"),
    (r"demo", "tests/cli/test_cli.py and .ci/run run it"),
    (r"calibrate (healthy/|INDEX)", "a calibration of a whole band takes minutes"),
    (r"twin severity pump-A.json", "it needs that calibration"),
)
"""Commands that are parsed and not run, and why."""

ELSEWHERE = {
    "docs/how-to/recordings.md": "tests/cli/test_recordings.py",
    "docs/how-to/zero-shot.md": "tests/diagnosis/test_prior_classifier.py",
    "docs/tutorials/watch.md": "tests/cli/test_watch.py",
}
"""Pages that a test of their own runs."""


def blocks(document: str, languages: Container[str] = ("", "sh")) -> list[str]:
    """Text of each fenced block of some languages; no language is shell, where it holds a
    command.
    """
    text = (ROOT / document).read_text(encoding="utf-8")
    fenced = re.findall(
        r"^ *```+ *([^\n`]*)\n(.*?)^ *```+ *$", text, flags=re.DOTALL | re.MULTILINE
    )
    return [block for language, block in fenced if language.strip() in languages]


def commands(document: str) -> Iterator[str]:
    """Every command line of swashtwin in the shell blocks of a document, its variables filled in,
    without its name.
    """
    for block in blocks(document):
        for name, value in re.findall(r'^(\w+)="?([^"\n]*)"?$', block, flags=re.MULTILINE):
            block = block.replace(f"${name}", value)
        block = re.sub(
            r"for (\w+) in (\S+)[^;]*; do (.*?); done",
            lambda m: m[3].replace(f"${m[1]}", m[2]),
            block,
        )
        for line in block.splitlines():
            for piece in re.split(r"&&|;", line):
                if match := re.match(r"\s*(?:\.venv/bin/)?swashtwin (.+)", piece):
                    yield re.split(r" {3}", match[1])[0]


def command_of(words: list[str]) -> tuple[object, list[str]]:
    """(the command that the words name, the words left)."""
    command, rest = get_command(app), list(words)
    while isinstance(command, TyperGroup) and rest:
        assert rest[0] in command.commands, f"no command {rest[0]!r} in {' '.join(words)}"
        command = command.commands[rest.pop(0)]
    return command, rest


@pytest.mark.parametrize("document", DOCUMENTS)
def test_every_printed_command_is_one_that_the_shell_takes(document: str) -> None:
    for line in commands(document):
        command, words = command_of(shlex.split(line, comments=True))
        try:
            command.make_context("swashtwin", words)  # type: ignore[attr-defined]
        except Exception as error:
            pytest.fail(f"{line}: {error}")


@pytest.mark.parametrize("document", DOCUMENTS)
def test_every_command_within_a_sentence_exists_with_its_options(document: str) -> None:
    text = re.sub(
        r"^```.*?^```",
        "",
        (ROOT / document).read_text(encoding="utf-8"),
        flags=re.DOTALL | re.MULTILINE,
    )
    for line in re.findall(r"`swashtwin ([^`]+)`", text):
        words = line.split()
        names = words[
            : next(
                (i for i, word in enumerate(words) if not re.fullmatch(r"[a-z][a-z0-9-]*", word)),
                None,
            )
        ]
        command = get_command(app)
        for name in names:
            if not isinstance(command, TyperGroup):
                break
            assert name in command.commands or name == "watch", (
                f"no command {name!r}: swashtwin {line}"
            )
            command = command.commands[name]
        options = {
            option
            for parameter in command.params
            for option in (*parameter.opts, *parameter.secondary_opts)
        }
        wrong = [
            word
            for word in words
            if re.fullmatch(r"--[a-z-]+", word) and word not in {*options, "--help"}
        ]
        assert wrong == [], f"swashtwin {line}"


def test_every_command_that_is_not_run_is_printed_somewhere() -> None:
    lines = [line for document in DOCUMENTS for line in commands(document)]
    assert [
        pattern for pattern, _ in NOT_RUN if not any(re.match(pattern, line) for line in lines)
    ] == []


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a tiny rig in ``rig``."""
    folder = tmp_path_factory.mktemp("printed")
    build_rig(folder / "rig", seed=0, size="tiny")
    return folder


def _rig(folder: Path, rig: Path) -> None:
    """The rig, whose recordings state a run of the pump."""
    (folder / "rig").mkdir()
    for part in ("A", "B"):
        (folder / "rig" / part).symlink_to(rig / "rig" / part, target_is_directory=True)
    index = (rig / "rig" / "recordings.toml").read_text(encoding="utf-8")
    index = re.sub(
        r'^(file = ".*_(\d+MPa_\d)\.h5")$',
        r'\1\nattributes = { pump_run = "\2" }',
        index,
        flags=re.MULTILINE,
    )
    (folder / "rig" / "recordings.toml").write_text(index, encoding="utf-8")


def _split(folder: Path, rig: Path) -> None:
    _rig(folder, rig)
    run("data", "split", folder / "rig", "--out", folder / "parts")
    shutil.copytree(folder / "parts", folder / "folder")
    rows = "".join(
        f"r{i},r{i},{role},{role},{pump}\n"
        for i, (role, pump) in enumerate([("train", "A"), ("test", "B")])
    )
    (folder / "windows.csv").write_text(
        f"recording,file_no,role,fold,specimen\n{rows}", encoding="utf-8"
    )


def _calibrated(folder: Path, rig: Path) -> None:
    _split(folder, rig)
    quick = ("--set", "starts=1", "--set", "nuisances=none", "--set", "phases=false")
    run(
        "calibrate", folder / "rig", "--specimen", "A", "--out", folder / "calibration.json", *quick
    )


def _named_files(folder: Path, rig: Path) -> None:
    """Files of one's own: two pumps, two classes, three recordings of each."""
    (folder / "my-recordings").mkdir()
    for number, (label, pump, repeat) in enumerate(
        (a, b, c) for a in CLASSES for b in "AB" for c in (1, 2, 3)
    ):
        _noise(
            folder / "my-recordings" / f"{label}_{pump}_15MPa_{repeat}.csv",
            number,
            CLASSES.index(label),
        )
    _noise(folder / "new-recording.csv", 99, 1)


CLASSES = ("normal", "swash_plate")


def _noise(path: Path, seed: int, line: float) -> None:
    time = np.arange(12000) / 25600
    rows = np.random.default_rng(seed).standard_normal(12000) + 2 * line * np.sin(
        2 * np.pi * 1100 * time
    )
    path.write_text("x\n" + "\n".join(f"{value:.4f}" for value in rows) + "\n", encoding="utf-8")


def _healthy(folder: Path, rig: Path) -> None:
    """Healthy recordings alone, a new one, and some with labels."""
    for name, labels in (("healthy", ["normal"] * 20), ("labeled", ["normal", "piston"] * 2)):
        (folder / name).mkdir()
        for number, label in enumerate(labels):
            _noise(
                folder / name / f"{label}_15MPa_{number}.csv",
                number + 100 * len(labels),
                float(label != "normal"),
            )
        facts = ("--sample-rate", "25.6 kHz", "--unit", "g", "--speed", "860 rpm")
        run("index", folder / name, *facts)
    recording = next(iter(load_recordings(folder / "labeled")))
    write_recording(recording.replace(label=None), folder / "new.h5")


PREPARED: dict[str, Callable[[Path, Path], None]] = {
    "README.md": _named_files,
    "docs/how-to/assistants.md": _named_files,
    "docs/how-to/indicators.md": _rig,
    "docs/how-to/leakage.md": _rig,
    "docs/explanation/calibration.md": _calibrated,
    "docs/explanation/method.md": _calibrated,
    "docs/explanation/diagnosis.md": _healthy,
}
"""What the folder of a page holds before its first command."""

RUN = {
    document: lines
    for document in DOCUMENTS
    if document not in ELSEWHERE
    and (
        lines := [
            line
            for line in commands(document)
            if not any(re.match(pattern, line) for pattern, _ in NOT_RUN)
        ]
    )
}
"""Command lines of each page that are run."""


@pytest.fixture
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """A choice from fewer windows, without the refits that explain a misfit; both have tests of
    their own.
    """
    monkeypatch.setattr("swashtwin.learning.choice.candidate_trials.MAX_WINDOWS", 120)
    monkeypatch.setattr(
        "swashtwin.calibration.misfit_hypotheses.find_misfit_hypotheses", lambda *_: ()
    )


@pytest.mark.nightly
@pytest.mark.usefixtures("_quick")
@pytest.mark.parametrize("document", RUN)
def test_the_commands_of_a_page_run_in_their_order(
    document: str, rig: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    PREPARED.get(document, lambda folder, rig: None)(tmp_path, rig)
    monkeypatch.chdir(tmp_path)
    for line in RUN[document]:
        run(*shlex.split(line, comments=True))


# ---- examples in Python


@pytest.fixture
def _own_registries(monkeypatch: pytest.MonkeyPatch) -> None:
    """Forget after the test what its examples register."""
    names: tuple[tuple[dict[str, Any], str], ...] = (
        (NETWORKS, "small_cnn"),
        (_faults, "cracked_plate"),
        (_registered_readers, ".counts"),
    )
    for registry, name in names:
        monkeypatch.setitem(registry, name, None)
        del registry[name]


@pytest.mark.nightly
@pytest.mark.usefixtures("_quick")
def test_readmes_example_runs_as_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (rig,) = re.findall(
        r"`swashtwin (bench rig [^`]*)`", (ROOT / "README.md").read_text(encoding="utf-8")
    )
    run(*shlex.split(rig))
    (example,) = blocks("README.md", ["python"])
    names: dict[str, Any] = {}
    capsys.readouterr()
    exec(example, names)
    assert float(capsys.readouterr().out) > 0.6
    assert set(names["calibration"].recording_ids) <= set(names["train"].recording_ids)
    assert "<svg" in (tmp_path / "report" / "report.html").read_text(encoding="utf-8")


@pytest.mark.nightly
@pytest.mark.usefixtures("_own_registries")
def test_each_example_of_extending_runs_as_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    for example in blocks("docs/how-to/extending.md", ["python"]):
        exec(example, names)
    assert names["twin"].label == "cracked_plate"
    assert names["more"].synthetic.all()
    assert names["recording"].unit == "m/s^2"


def test_the_page_of_python_lists_every_public_name() -> None:
    listed = re.findall(
        r"^   (\w+)$",
        (ROOT / "docs/reference/api.md").read_text(encoding="utf-8"),
        flags=re.MULTILINE,
    )
    assert sorted(listed) == sorted(set(swashtwin.__all__) - {"__version__"})
