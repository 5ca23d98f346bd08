"""Every command and example that README and the documents print runs on small data as printed.

Shell blocks are read line by line. A command that needs hours, a plant or a public data set is only
parsed (`NOT_RUN`); so are the commands of a page that another test runs (`RUN_BY_ANOTHER_TEST`). A
page whose commands need files finds them in its folder (`PREPARED`). Every other command runs, so
that a new one that lacks its files fails here.
"""

import re
import shlex
import shutil
from collections.abc import Callable, Container, Iterator
from dataclasses import replace
from itertools import product
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
from swashtwin.recordings import load_recordings, write_index, write_recording
from swashtwin.recordings.file_formats import _registered_readers
from swashtwin_bench import build_rig
from swashtwin_bench.rigs.writing import RigSize

ROOT = Path(__file__).parents[2]
EVIDENCE = "docs/bench/evidence.md"
"""Its commands run at the commits that it names, not at this commit."""
PAGES = {path.relative_to(ROOT).as_posix() for path in (ROOT / "docs").rglob("*.md")}
DOCUMENTS = sorted({"README.md", *PAGES} - {EVIDENCE})

NOT_RUN = (
    (r"bench (?!rig )", "a study takes minutes to days"),
    (r"bench rig (?!.*--size tiny)", "a rig of that size takes minutes"),
    (r"(watch|history) ", "tests/cli/test_watch.py runs the tutorial"),
    (r"explore ", "it serves until it is ended; tests/explorer run it"),
    (r".*--cluster ", "it needs a cluster; tests/foundation/test_cluster.py starts one"),
    (r"demo", "tests/cli/test_cli.py and .ci/run run it"),
    (r"calibrate (healthy/|INDEX)", "a calibration of a whole band takes minutes"),
    (r"twin severity pump-A.json", "it needs that calibration"),
)
"""Commands that are parsed and not run, and why."""

RUN_BY_ANOTHER_TEST = {
    "docs/how-to/recordings.md": "tests/cli/test_recordings.py",
    "docs/how-to/zero-shot.md": "tests/diagnosis/test_prior_classifier.py",
    "docs/tutorials/watch.md": "tests/cli/test_watch.py",
}
"""Pages, and the test that runs the commands of each."""


def code_blocks(document: str, languages: Container[str] = ("", "sh")) -> list[str]:
    """Return the fenced blocks of some languages; a block without a language may hold commands."""
    text = (ROOT / document).read_text(encoding="utf-8")
    fence = r"^ *```+ *([^\n`]*)\n(.*?)^ *```+ *$"
    blocks = re.findall(fence, text, flags=re.DOTALL | re.MULTILINE)
    return [block for language, block in blocks if language.strip() in languages]


def expand_shell(block: str) -> str:
    """Replace the variables of a shell block, and each loop by its body for the first value."""
    for name, value in re.findall(r'^(\w+)="?([^"\n]*)"?$', block, flags=re.MULTILINE):
        block = block.replace(f"${name}", value)

    def first_turn(loop: re.Match[str]) -> str:
        variable, first_value, body = loop.groups()
        return body.replace(f"${variable}", first_value)

    return re.sub(r"for (\w+) in (\S+)[^;]*; do (.*?); done", first_turn, block)


def printed_commands(document: str) -> Iterator[str]:
    """Return the arguments of every `swashtwin` in the shell blocks of a document."""
    for block in code_blocks(document):
        for piece in re.split(r"&&|;|\n", expand_shell(block)):
            match = re.match(r"\s*(?:\.venv/bin/)?swashtwin (.+)", piece)
            if match:
                # three spaces separate an explanation
                yield re.split(r" {3}", match[1])[0]


def find_command(words: list[str]) -> tuple[Any, list[str]]:
    """Return the command that the first words name, and the remaining words."""
    command: Any = get_command(app)
    arguments = list(words)
    while isinstance(command, TyperGroup) and arguments:
        name = arguments.pop(0)
        assert name in command.commands, f"no command {name!r} in {' '.join(words)}"
        command = command.commands[name]
    return command, arguments


@pytest.mark.parametrize("document", DOCUMENTS)
def test_every_printed_command_line_is_accepted(document: str) -> None:
    for line in printed_commands(document):
        command, arguments = find_command(shlex.split(line, comments=True))
        try:
            command.make_context("swashtwin", arguments)
        except Exception as error:
            pytest.fail(f"{line}: {error}")


def find_mentioned_command(words: list[str]) -> Any:
    """Return the command that a mention names, which may stop at a group or go on to a file."""
    command: Any = get_command(app)
    for word in words:
        is_name = re.fullmatch(r"[a-z][a-z0-9-]*", word)
        if not is_name or not isinstance(command, TyperGroup):
            break
        assert word in command.commands, f"no command {word!r}: swashtwin {' '.join(words)}"
        command = command.commands[word]
    return command


@pytest.mark.parametrize("document", DOCUMENTS)
def test_every_command_within_a_sentence_exists_with_its_options(document: str) -> None:
    text = (ROOT / document).read_text(encoding="utf-8")
    prose = re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)

    for mention in re.findall(r"`swashtwin ([^`]+)`", prose):
        words = mention.split()
        command = find_mentioned_command(words)
        known_options = {"--help"}
        for parameter in command.params:
            known_options.update(parameter.opts, parameter.secondary_opts)

        named_options = {word for word in words if re.fullmatch(r"--[a-z-]+", word)}
        assert named_options <= known_options, f"swashtwin {mention}"


def is_run(line: str) -> bool:
    return not any(re.match(pattern, line) for pattern, _ in NOT_RUN)


@pytest.mark.parametrize("pattern", [pattern for pattern, _ in NOT_RUN])
def test_every_command_that_is_not_run_is_printed_in_a_document(pattern: str) -> None:
    lines = [line for document in DOCUMENTS for line in printed_commands(document)]
    assert any(re.match(pattern, line) for line in lines)


# Files that pages need before their first command.


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with a tiny rig in `rig`, which tests only read."""
    folder = tmp_path_factory.mktemp("printed")
    build_rig(folder / "rig", seed=0, size="tiny")
    return folder


def prepare_rig(folder: Path, rig: Path) -> None:
    """Link the rig's recordings, and state a run of the pump in their index."""
    (folder / "rig").mkdir()
    for pump in ("A", "B"):
        (folder / "rig" / pump).symlink_to(rig / "rig" / pump, target_is_directory=True)

    index = (rig / "rig" / "recordings.toml").read_text(encoding="utf-8")
    index = re.sub(
        r'^(file = ".*_(\d+MPa_\d)\.h5")$',
        r'\1\nattributes = { pump_run = "\2" }',
        index,
        flags=re.MULTILINE,
    )
    (folder / "rig" / "recordings.toml").write_text(index, encoding="utf-8")


QUICK_CALIBRATION = ("--set", "starts=1", "--set", "nuisances=none", "--set", "phases=false")


def prepare_calibration(folder: Path, rig: Path) -> None:
    """Split the rig, calibrate a twin on it, and write a table of windows."""
    prepare_rig(folder, rig)
    run("data", "split", folder / "rig", "--out", folder / "parts")
    # pages use both names
    shutil.copytree(folder / "parts", folder / "folder")

    header = "recording,file_no,role,fold,specimen"
    rows = ("r0,r0,train,train,A", "r1,r1,test,test,B")
    (folder / "windows.csv").write_text("\n".join((header, *rows, "")), encoding="utf-8")

    command = ("calibrate", folder / "rig", "--specimen", "A", *QUICK_CALIBRATION)
    run(*command, "--out", folder / "calibration.json")


def write_recording_table(path: Path, seed: int, amplitude: float) -> None:
    """Write a text table of noise and, if the amplitude is not zero, a line at 1100 Hz."""
    time = np.arange(12000) / 25600
    noise = np.random.default_rng(seed).standard_normal(12000)
    samples = noise + 2 * amplitude * np.sin(2 * np.pi * 1100 * time)
    rows = "\n".join(f"{sample:.4f}" for sample in samples)
    path.write_text(f"x\n{rows}\n", encoding="utf-8")


def prepare_labeled_tables(folder: Path, rig: Path) -> None:
    """Write tables of two pumps and two classes, three recordings of each, and a new one."""
    (folder / "my-recordings").mkdir()
    amplitudes = {"normal": 0, "swash_plate": 1}
    for number, (label, pump, repeat) in enumerate(product(amplitudes, "AB", (1, 2, 3))):
        file = folder / "my-recordings" / f"{label}_{pump}_15MPa_{repeat}.csv"
        write_recording_table(file, number, amplitudes[label])

    write_recording_table(folder / "new-recording.csv", 99, 1)


def prepare_healthy_tables(folder: Path, rig: Path) -> None:
    """Write and index healthy recordings, a few with labels, and a new one without."""
    for name, labels in (("healthy", ["normal"] * 20), ("labeled", ["normal", "piston"] * 2)):
        (folder / name).mkdir()
        for number, label in enumerate(labels):
            file = folder / name / f"{label}_15MPa_{number}.csv"
            # no two files have the same noise
            seed = number + 100 * len(labels)
            write_recording_table(file, seed, float(label != "normal"))
        facts = ("--sample-rate", "25.6 kHz", "--unit", "g", "--speed", "860 rpm")
        run("index", folder / name, *facts)

    recording = next(iter(load_recordings(folder / "labeled")))
    write_recording(recording.replace(label=None), folder / "new.h5")


def prepare_library(folder: Path, rig: Path) -> None:
    """Write recordings of six pumps, and healthy ones of another pump with a new one."""
    size = RigSize(specimens=6, repeats=2, duration=1.25)
    build_rig(folder / "maker", seed=1, size=size, version="3")

    # of the second fleet, pump B has nine pistons, as the page states
    build_rig(folder / "plant", seed=3, size=replace(size, specimens=2), version="3")
    recordings = list(load_recordings(folder / "plant", label="normal", specimen="B"))
    files = [
        write_recording(item, folder / "healthy" / f"{item.recording_id}.h5") for item in recordings
    ]
    write_index(recordings, files, folder / "healthy")
    write_recording(recordings[0].replace(label=None), folder / "new.h5")


PREPARED: dict[str, Callable[[Path, Path], None]] = {
    "README.md": prepare_labeled_tables,
    "docs/how-to/assistants.md": prepare_labeled_tables,
    "docs/how-to/indicators.md": prepare_rig,
    "docs/how-to/leakage.md": prepare_rig,
    "docs/how-to/other-design.md": prepare_library,
    "docs/explanation/calibration.md": prepare_calibration,
    "docs/explanation/method.md": prepare_calibration,
    "docs/explanation/diagnosis.md": prepare_healthy_tables,
}
"""What the folder of a page holds before its first command."""


def commands_to_run() -> dict[str, list[str]]:
    """Return the command lines that are run of each page that has any."""
    lines_by_document = {}
    for document in DOCUMENTS:
        lines = [line for line in printed_commands(document) if is_run(line)]
        if lines and document not in RUN_BY_ANOTHER_TEST:
            lines_by_document[document] = lines
    return lines_by_document


RUN = commands_to_run()


@pytest.fixture
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Select networks on fewer windows, and calibrate without the refits that explain a misfit.

    Both have other tests.
    """
    monkeypatch.setattr("swashtwin.learning.choice.candidate_trials.MAX_WINDOWS", 120)
    monkeypatch.setattr("swashtwin.calibration.misfit_hypotheses.try_mistakes", lambda *_: ())


@pytest.mark.nightly
@pytest.mark.usefixtures("_quick")
@pytest.mark.parametrize("document", RUN)
def test_the_commands_of_a_page_run_in_their_order(
    document: str, rig: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if document in PREPARED:
        PREPARED[document](tmp_path, rig)

    monkeypatch.chdir(tmp_path)
    for line in RUN[document]:
        run(*shlex.split(line, comments=True))


# Examples in Python.


@pytest.fixture
def _own_registries(monkeypatch: pytest.MonkeyPatch) -> None:
    """Forget after the test what its examples register."""
    names: tuple[tuple[dict[str, Any], str], ...] = (
        (NETWORKS, "small_cnn"),
        (_faults, "cracked_plate"),
        (_registered_readers, ".counts"),
    )
    for registry, name in names:
        # monkeypatch removes after the test what was absent before it
        monkeypatch.setitem(registry, name, None)
        del registry[name]


@pytest.mark.nightly
@pytest.mark.usefixtures("_quick")
def test_the_readme_s_example_runs_as_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    (rig_command,) = re.findall(r"`swashtwin (bench rig [^`]*)`", readme)
    run(*shlex.split(rig_command))
    (example,) = code_blocks("README.md", ["python"])
    names: dict[str, Any] = {}

    # what the command printed
    capsys.readouterr()
    exec(example, names)

    # the example prints the classifier's score
    assert float(capsys.readouterr().out) > 0.6
    assert set(names["calibration"].recording_ids) <= set(names["train"].recording_ids)
    assert "<svg" in (tmp_path / "report" / "report.html").read_text(encoding="utf-8")


@pytest.mark.nightly
@pytest.mark.usefixtures("_own_registries")
def test_the_examples_of_extending_run_as_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}

    # each example continues the previous one
    for example in code_blocks("docs/how-to/extending.md", ["python"]):
        exec(example, names)

    assert names["twin"].label == "cracked_plate"
    assert names["more"].synthetic.all()
    assert names["recording"].unit == "m/s^2"


def test_the_reference_of_python_lists_every_public_name() -> None:
    text = (ROOT / "docs/reference/api.md").read_text(encoding="utf-8")
    # the entries of its tables
    listed_names = re.findall(r"^   (\w+)$", text, flags=re.MULTILINE)
    assert sorted(listed_names) == sorted(set(swashtwin.__all__) - {"__version__"})
