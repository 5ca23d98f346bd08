"""The main commands work where only Windows' modules, functions and file names are."""

import subprocess
import sys
from pathlib import Path

import pytest

from swashtwin.foundation import DataError, MPa, random_stream, rpm, safe_file_name
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import Recording, write_recording
from swashtwin.recordings.index_writing import relative_path, save_index

SCRIPT = Path(__file__).parents[1] / "support" / "windows.py"
COMMANDS = (
    "index data --label-pattern '(?P<label>[a-z]+)_' --speed '1500 rpm' --pressure '10 MPa' --force",
    "inspect data",
    "data convert data --out store.h5",
    "data split data --out split --test-fraction 0.25",
    "train split/train.toml --network bitcn --set epochs=1 --set stride=32 --set channels=4,4 --window 256 "
    "--test-fraction 0 --out model.safetensors",
    "evaluate model.safetensors split/test.toml",
    "diagnose model.safetensors data/normal_0.h5 --report 'report of one'",
    "signal spectrum data/normal_0.h5 --out spectrum.svg",
    "twin pump new mine",
)


@pytest.mark.nightly
def test_the_main_commands_need_nothing_that_only_posix_has(tmp_path: Path) -> None:
    condition = OperatingCondition(speed=rpm(1500), discharge_pressure=MPa(10))
    for label in ("normal", "piston"):
        for number in range(4):
            signal = random_stream(0, label, number).normal(size=(1, 4096))
            recording = Recording(
                signal, 6400.0, f"{label}_{number}", label=label, condition=condition
            )
            write_recording(recording, tmp_path / "data" / f"{label}_{number}.h5")
    command = [sys.executable, "-X", "warn_default_encoding", SCRIPT, *COMMANDS]
    process = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert process.returncode == 0, process.stderr[-3000:]
    written = (
        "store.h5",
        "model.safetensors",
        "spectrum.svg",
        "mine.toml",
        "report of one/report.html",
    )
    assert all((tmp_path / name).is_file() for name in written)
    assert not list(tmp_path.rglob(".swashtwin-*"))


def test_recordings_are_indexed_and_inspected_without_what_only_posix_has(tmp_path: Path) -> None:
    (tmp_path / "data").mkdir()
    text = "Zeit [s];Gehäuse [m/s²]\r\n" + "".join(
        f"{n / 100:.2f};{n % 7}\r\n".replace(".", ",") for n in range(400)
    )
    (tmp_path / "data" / "normal_0.csv").write_bytes(text.encode("cp1252"))
    command = [sys.executable, "-X", "warn_default_encoding", SCRIPT, *COMMANDS[:2]]
    process = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert process.returncode == 0, process.stderr[-3000:]
    assert b"\r" not in (tmp_path / "data" / "recordings.toml").read_bytes()


def test_names_of_machines_become_names_that_every_system_takes() -> None:
    names = [r"..\pump", "a:b", "CON", "lpt1.old", "x" * 300, "end. ", "", "Größe 1"]
    files = [safe_file_name(name) for name in names]
    assert files == ["_pump", "a_b", "CON_", "lpt1_.old", "x" * 100, "end._", "_", "Größe_1"]
    assert [safe_file_name(file) for file in files] == files


def test_a_file_whose_name_is_no_unicode_is_refused_by_name(tmp_path: Path) -> None:
    index = {"format": 1, "recording": [{"file": "Pr\udcfcfung_1.csv"}]}
    with pytest.raises(
        DataError, match=r"'Pr\\udcfcfung_1.csv' is not valid Unicode.*rename the file"
    ):
        save_index(index, tmp_path / "recordings.toml")


def test_an_index_on_another_drive_than_its_files_states_whole_paths(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert relative_path(tmp_path / "a", tmp_path / "b" / "c.csv") == "../b/c.csv"

    def other_drive(path: Path, start: Path) -> str:
        raise ValueError("path is on mount 'D:', start on mount 'C:'")

    monkeypatch.setattr("os.path.relpath", other_drive)
    assert (
        relative_path(tmp_path / "a", tmp_path / "b" / "c.csv")
        == (tmp_path / "b" / "c.csv").as_posix()
    )
