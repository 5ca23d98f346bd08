"""No command replaces a file unless it is told to, and none replaces a file that it reads."""

import shlex
import shutil
from dataclasses import dataclass
from pathlib import Path

import pytest
from commandline import one_line, run
from plant import Plant


@dataclass(frozen=True)
class Writer:
    """A command that writes a file or a folder."""

    line: str
    """Its arguments; ``{}`` stands for the file that it writes, ``{folder}`` for the folder."""
    suffix: str
    """Suffix of the file that it writes."""
    inputs: str = ""
    """Files that it reads, in whose place its output could be put."""


CONDITION = '--speed "860 rpm" --pressure "15 MPa"'

WRITERS = {
    "index": Writer("index . --table table.csv --out {}", ".toml", "table.csv"),
    "train": Writer(
        "train recordings.toml --add windows.safetensors --out {}",
        ".x",
        "a.h5 recordings.toml windows.safetensors",
    ),
    "train on": Writer(
        "train recordings.toml --network bitcn --add kept.x --out {}", ".x", "kept.x table.csv"
    ),
    "evaluate": Writer("evaluate model.safetensors recordings.toml --report {}", ".html", "a.html"),
    "evaluate in": Writer("evaluate model.safetensors recordings.toml --report {folder}", ".html"),
    "diagnose": Writer("diagnose model.safetensors a.html a.h5 --report {}", ".html", "a.html"),
    "diagnose in": Writer("diagnose model.safetensors a.h5 --report {folder}", ".html"),
    "report": Writer("report model.safetensors healthy.json --out {}", ".html"),
    "report in": Writer("report model.safetensors healthy.json --out {folder}", ".html"),
    "calibrate": Writer("calibrate recordings.toml --out {}", ".json", "a.json"),
    "calibrate page": Writer(
        "calibrate recordings.toml --out new.json --report {}", ".html", "a.html"
    ),
    "synthesize": Writer(
        "synthesize healthy.json --like recordings.toml --count 1 --out {}",
        ".x",
        "healthy.json recordings.toml a.h5 table.csv",
    ),
    "convert": Writer("data convert a.h5 --out {}", ".h5", "a.h5"),
    "convert all": Writer(
        "data convert recordings.toml --out {}", ".h5", "recordings.toml a.h5 table.csv"
    ),
    "split": Writer("data split recordings.toml --out {folder}", ".toml"),
    # it would write train.toml beside its index, which has this name
    "split train": Writer("data split train.toml", ".toml", "train.toml"),
    "features": Writer("signal features recordings.toml --out {}", ".csv", "table.csv"),
    "spectrum": Writer("signal spectrum a.svg --out {}", ".svg", "a.svg"),
    # the data of the figure a.svg
    "spectrum data": Writer("signal spectrum a-data.csv --out a.svg", ".svg", "a-data.csv"),
    "trend": Writer("signal trend recordings.toml --out {}", ".svg", "a.svg"),
    "simulate": Writer(f"twin simulate --calibration healthy.json {CONDITION} --out {{}}", ".csv"),
    "simulate of": Writer(f"twin simulate --pump a.csv {CONDITION} --out {{}}", ".csv", "a.csv"),
    "prior": Writer("twin prior --pump a.safetensors --out {}", ".safetensors", "a.safetensors"),
    "adapt": Writer(
        "model adapt model.safetensors recordings.toml --out {}",
        ".safetensors",
        "model.safetensors",
    ),
    "export": Writer("model export a.onnx --out {}", ".onnx", "a.onnx"),
}

FILE_IN_FOLDER = {
    "report in": "report.html",
    "evaluate in": "results.json",
    "diagnose in": "figures/a.svg",
    "split": "test.toml",
}
"""A file that those commands write that write a folder."""


@pytest.fixture
def files(plant: Plant, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Folder with a copy of each file that a command reads.

    Those of a wrong suffix are text tables, so that a command reads any file that it could write.
    """
    originals = {
        "model.safetensors": plant.model,
        "windows.safetensors": plant.synthetic,
        "healthy.json": plant.calibration,
        "a.h5": plant.worn,
        "kept.x": plant.model,
        "a.onnx": plant.model,
    }
    for name, path in originals.items():
        shutil.copy(path, tmp_path / name)
    for name in ("table.csv", "a.csv", "a.json", "a.html", "a.svg", "a-data.csv", "a.safetensors"):
        (tmp_path / name).write_text("x\n" + "1\n2\n" * 200)

    shutil.copytree(plant.folder / "recordings", tmp_path / "recordings")
    shutil.copy(plant.pair, tmp_path / "pair.toml")
    entries = ""
    for name in ("a.h5", "table.csv", "a.json", "a.html", "a.svg"):
        entries += f'[[recording]]\nfile = "{name}"\n'
    for name in ("recordings.toml", "train.toml"):
        (tmp_path / name).write_text(f"format = 1\n{entries}")

    monkeypatch.chdir(tmp_path)
    return tmp_path


def contents(folder: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("name", WRITERS)
def test_an_existing_file_is_not_replaced_without_force(name: str, files: Path) -> None:
    writer = WRITERS[name]
    target = files / "out" / FILE_IN_FOLDER.get(name, f"mine{writer.suffix}")
    target.parent.mkdir(parents=True)
    target.write_text("mine")
    original_contents = contents(files)

    refusal = one_line(run(*shlex.split(writer.line.format(target, folder=files / "out")), code=3))

    # a command without a place for the target is refused for another reason
    if "{" in writer.line:
        assert "Overwrite it with --force" in refusal
    assert contents(files) == original_contents


@pytest.mark.parametrize(
    ("name", "input_name"),
    [
        pytest.param(name, input_name, id=f"{name}: {input_name}")
        for name, writer in WRITERS.items()
        for input_name in writer.inputs.split()
    ],
)
def test_no_command_replaces_a_file_that_it_reads_even_by_force(
    name: str, input_name: str, files: Path
) -> None:
    original_contents = contents(files)
    link = files / f"link{Path(input_name).suffix}"
    link.symlink_to(files / input_name)

    for target in (files / input_name, link):
        arguments = shlex.split(WRITERS[name].line.format(target))
        refusal = one_line(run(*arguments, "--force", code=3))
        # a file of another suffix than the output's is refused before
        assert (
            "is an input of this command and would be lost" in refusal or "must end in" in refusal
        )

    link.unlink()
    assert contents(files) == original_contents


@pytest.mark.parametrize(
    ("line", "output"),
    [
        ("signal features pair.toml --out own.csv", "own.csv"),
        ("signal spectrum a.h5 --out own.svg", "own-data.csv"),
        ("report model.safetensors --out own", "own/results.json"),
        ("report model.safetensors --out own.html", "own.html"),
        (
            "synthesize healthy.json --like pair.toml --count 1 --out own.x "
            "--fault swash_plate --window 2048",
            "own.x",
        ),
    ],
)
def test_a_command_replaces_a_file_of_the_user_or_its_earlier_output_only_by_force(
    line: str, output: str, files: Path
) -> None:
    arguments = line.split()
    target = files / output
    target.parent.mkdir(exist_ok=True)
    target.write_text("mine")

    run(*arguments, code=3)
    assert target.read_text() == "mine"

    run(*arguments, "--force")
    written = target.read_bytes()
    assert written != b"mine"

    assert "Overwrite it with --force" in one_line(run(*arguments, code=3))
    assert target.read_bytes() == written
