"""No command replaces a file that it was not told to replace, and none one that it reads."""

import shlex
import shutil
from pathlib import Path

import pytest
from commandline import one_line, run
from plant import Plant

POINT = '--speed "860 rpm" --pressure "15 MPa"'
WRITERS = {
    "index": ("index . --table table.csv --out {}", ".toml", "table.csv"),
    "train": (
        "train recordings.toml --add windows.safetensors --out {}",
        ".x",
        "a.h5 recordings.toml windows.safetensors",
    ),
    "train on": (
        "train recordings.toml --network bitcn --add kept.x --out {}",
        ".x",
        "kept.x table.csv",
    ),
    "evaluate": ("evaluate model.safetensors recordings.toml --report {}", ".html", "a.html"),
    "evaluate in": ("evaluate model.safetensors recordings.toml --report {folder}", ".html", ""),
    "diagnose": ("diagnose model.safetensors a.html a.h5 --report {}", ".html", "a.html"),
    "diagnose in": ("diagnose model.safetensors a.h5 --report {folder}", ".html", ""),
    "report": ("report model.safetensors healthy.json --out {}", ".html", ""),
    "report in": ("report model.safetensors healthy.json --out {folder}", ".html", ""),
    "calibrate": ("calibrate recordings.toml --out {}", ".json", "a.json"),
    "calibrate page": ("calibrate recordings.toml --out new.json --report {}", ".html", "a.html"),
    "synthesize": (
        "synthesize healthy.json --like recordings.toml --count 1 --out {}",
        ".x",
        "healthy.json recordings.toml a.h5 table.csv",
    ),
    "convert": ("data convert a.h5 --out {}", ".h5", "a.h5"),
    "convert all": (
        "data convert recordings.toml --out {}",
        ".h5",
        "recordings.toml a.h5 table.csv",
    ),
    "split": ("data split recordings.toml --out {folder}", ".toml", ""),
    "split train": ("data split train.toml", ".toml", "train.toml"),
    "features": ("signal features recordings.toml --out {}", ".csv", "table.csv"),
    "spectrum": ("signal spectrum a.svg --out {}", ".svg", "a.svg"),
    "spectrum data": ("signal spectrum a-data.csv --out a.svg", ".svg", "a-data.csv"),
    "trend": ("signal trend recordings.toml --out {}", ".svg", "a.svg"),
    "simulate": (f"twin simulate --calibration healthy.json {POINT} --out {{}}", ".csv", ""),
    "simulate of": (f"twin simulate --pump a.csv {POINT} --out {{}}", ".csv", "a.csv"),
    "prior": ("twin prior --pump a.safetensors --out {}", ".safetensors", "a.safetensors"),
    "adapt": (
        "model adapt model.safetensors recordings.toml --out {}",
        ".safetensors",
        "model.safetensors",
    ),
    "export": ("model export a.onnx --out {}", ".onnx", "a.onnx"),
}
"""Command line, suffix of what it writes, and files that it reads, in whose place its output is
put.
"""
WRITTEN = {
    "report in": "report.html",
    "evaluate in": "results.json",
    "diagnose in": "figures/a.svg",
    "split": "test.toml",
}
"""A file of those commands that write a folder."""


@pytest.fixture
def files(plant: Plant, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Folder with a copy of each file that a command reads; what has another suffix than its kind
    is read as text.
    """
    kept = {
        "model.safetensors": plant.model,
        "windows.safetensors": plant.synthetic,
        "healthy.json": plant.calibration,
    }
    for name, path in {
        **kept,
        "a.h5": plant.worn,
        "kept.x": plant.model,
        "a.onnx": plant.model,
    }.items():
        shutil.copy(path, tmp_path / name)
    for name in ("table.csv", "a.csv", "a.json", "a.html", "a.svg", "a-data.csv", "a.safetensors"):
        (tmp_path / name).write_text("x\n" + "1\n2\n" * 200)
    shutil.copytree(plant.folder / "recordings", tmp_path / "recordings")
    shutil.copy(plant.pair, tmp_path / "pair.toml")
    entries = "".join(
        f'[[recording]]\nfile = "{name}"\n'
        for name in ("a.h5", "table.csv", "a.json", "a.html", "a.svg")
    )
    for name in ("recordings.toml", "train.toml"):
        (tmp_path / name).write_text(f"format = 1\n{entries}")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def contents(folder: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("name", WRITERS)
def test_a_file_that_is_there_is_replaced_only_where_told(name: str, files: Path) -> None:
    line, suffix, _ = WRITERS[name]
    target = files / "out" / WRITTEN.get(name, f"mine{suffix}")
    target.parent.mkdir(parents=True)
    target.write_text("mine")
    before = contents(files)
    words = shlex.split(line.format(target, folder=files / "out"))
    assert "Overwrite it with --force" in one_line(run(*words, code=3)) or "{" not in line
    assert contents(files) == before


@pytest.mark.parametrize(
    ("name", "read"),
    [(name, read) for name, (_, _, inputs) in WRITERS.items() for read in inputs.split()],
)
def test_no_command_replaces_what_it_reads(name: str, read: str, files: Path) -> None:
    before = contents(files)
    link = files / f"link{Path(read).suffix}"
    link.symlink_to(files / read)
    for target in (files / read, link):
        refusal = one_line(run(*shlex.split(WRITERS[name][0].format(target)), "--force", code=3))
        assert (
            "is an input of this command and would be lost" in refusal or "must end in" in refusal
        )
    link.unlink()
    assert contents(files) == before


OWN = {
    "signal features pair.toml --out own.csv": "own.csv",
    "signal spectrum a.h5 --out own.svg": "own-data.csv",
    "report model.safetensors --out own": "own/results.json",
    "report model.safetensors --out own.html": "own.html",
    "synthesize healthy.json --like pair.toml --count 1 --out own.x --fault swash_plate --window 2048": "own.x",
}
"""Commands that replace what they wrote themselves, and a file of it."""


@pytest.mark.parametrize("line", OWN)
def test_a_command_replaces_what_it_wrote_itself_but_no_other_file(line: str, files: Path) -> None:
    target = files / OWN[line]
    target.parent.mkdir(exist_ok=True)
    target.write_text("mine")
    run(*line.split(), code=3)
    assert target.read_text() == "mine"
    run(*line.split(), "--force")
    assert target.read_bytes() != b"mine"
    run(*line.split())
