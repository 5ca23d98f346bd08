"""The main commands work with only the modules, functions and file names that Windows has."""

import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from swashtwin.foundation import DataError, MPa, random_stream, rpm, safe_file_name
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import Recording, write_recording
from swashtwin.recordings.index_writing import relative_path, save_index

SCRIPT = Path(__file__).parents[1] / "support" / "windows.py"
"""Runs command lines in a Python without the modules and functions of POSIX."""

INDEX = (
    "index 'Prüfstand 1' --label-pattern '(?P<label>[a-z]+)_' --speed '1500 rpm' "
    "--pressure '10 MPa' --force"
)
INSPECT = "inspect 'Prüfstand 1'"
DIAGNOSE = "diagnose model.safetensors 'Prüfstand 1/normal_0.h5'"
FURTHER_COMMANDS = (
    "data convert 'Prüfstand 1' --out store.h5",
    "data split 'Prüfstand 1' --out split --test-fraction 0.25",
    "train split/train.toml --network bitcn --set epochs=1 --set stride=32 --set channels=4,4 "
    "--window 256 --test-fraction 0 --out model.safetensors",
    "evaluate model.safetensors split/test.toml",
    f"{DIAGNOSE} --report 'report of one'",
    "signal spectrum 'Prüfstand 1/normal_0.h5' --out spectrum.svg",
    "twin pump new mine",
    "watch run 'Überwachung/watch.toml' --once",
)


def run_on_windows(*commands: str, folder: Path) -> None:
    """Run commands in a folder as Windows would, and expect each to succeed."""
    # a file that is opened without an encoding differs between systems
    arguments = [sys.executable, "-X", "warn_default_encoding", SCRIPT, *commands]
    process = subprocess.run(arguments, cwd=folder, capture_output=True, text=True, check=False)
    assert process.returncode == 0, process.stderr[-3000:]


def run_on_western_console(command: str, folder: Path) -> str:
    """Return what a command prints to a console of code page 1252, which has no Greek letters."""
    process = subprocess.run(
        [sys.executable, "-m", "swashtwin", *shlex.split(command)],
        cwd=folder,
        env={**os.environ, "PYTHONIOENCODING": "cp1252"},
        capture_output=True,
        check=False,
    )
    errors = process.stderr.decode("cp1252")
    assert process.returncode == 0, errors
    assert "Traceback" not in errors
    return process.stdout.decode("cp1252")


def test_help_is_shown_on_a_western_console(tmp_path: Path) -> None:
    assert "diagnose" in run_on_western_console("--help", tmp_path)


@pytest.mark.nightly
def test_the_main_commands_need_nothing_that_only_posix_has(tmp_path: Path) -> None:
    condition = OperatingCondition(speed=rpm(1500), discharge_pressure=MPa(10))
    for label in ("normal", "piston"):
        for number in range(4):
            name = f"{label}_{number}"
            signal = random_stream(0, label, number).normal(size=(1, 4096))
            recording = Recording(signal, 6400.0, name, label=label, condition=condition)
            write_recording(recording, tmp_path / "Prüfstand 1" / f"{name}.h5")

    run_on_windows("watch init 'Überwachung/watch.toml'", folder=tmp_path)
    shutil.copytree(tmp_path / "Prüfstand 1", tmp_path / "Überwachung" / "incoming" / "pump-1")
    run_on_windows(INDEX, INSPECT, *FURTHER_COMMANDS, folder=tmp_path)

    for name in ("store.h5", "model.safetensors", "spectrum.svg", "mine.toml"):
        assert (tmp_path / name).is_file()
    assert (tmp_path / "report of one" / "report.html").is_file()
    # the watch judged and kept each recording
    assert len(list((tmp_path / "Überwachung" / "watch-data" / "waveforms").rglob("*.h5"))) == 8
    # no temporary file is left
    assert not list(tmp_path.rglob(".swashtwin-*"))

    assert "normal_0" in run_on_western_console(INSPECT, tmp_path)
    assert "normal_0" in run_on_western_console(DIAGNOSE, tmp_path)


def test_a_table_of_a_german_windows_is_indexed_and_inspected(tmp_path: Path) -> None:
    # semicolons, decimal commas, the code page 1252 and line ends of two characters
    lines = ["Zeit [s];Gehäuse [m/s²]"]
    for row in range(400):
        lines.append(f"{row / 100:.2f};{row % 7}".replace(".", ","))
    content = "".join(f"{line}\r\n" for line in lines).encode("cp1252")
    (tmp_path / "Prüfstand 1").mkdir()
    (tmp_path / "Prüfstand 1" / "normal_0.csv").write_bytes(content)

    run_on_windows(INDEX, INSPECT, folder=tmp_path)

    assert b"\r" not in (tmp_path / "Prüfstand 1" / "recordings.toml").read_bytes()


@pytest.mark.parametrize(
    ("name", "file_name"),
    [
        pytest.param(r"..\pump", "_pump", id="path"),
        pytest.param("a:b", "a_b", id="stream"),
        pytest.param("CON", "CON_", id="device"),
        pytest.param("lpt1.old", "lpt1_.old", id="device with a suffix"),
        pytest.param("x" * 300, "x" * 100, id="long"),
        pytest.param("end. ", "end._", id="dot and space at the end"),
        pytest.param("", "_", id="empty"),
        pytest.param("Größe 1", "Größe_1", id="umlaut and space"),
    ],
)
def test_the_name_of_a_machine_becomes_a_file_name_of_every_system(
    name: str, file_name: str
) -> None:
    assert safe_file_name(name) == file_name
    assert safe_file_name(file_name) == file_name


def test_a_file_name_that_is_not_unicode_is_refused(tmp_path: Path) -> None:
    # a byte of another encoding, as Python reads it from a folder
    index = {"format": 1, "recording": [{"file": "Pr\udcfcfung_1.csv"}]}

    message = r"'Pr\\udcfcfung_1.csv' is not valid Unicode.*rename the file"
    with pytest.raises(DataError, match=message):
        save_index(index, tmp_path / "recordings.toml")


def test_an_index_on_another_drive_than_its_files_has_absolute_paths(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "a"
    file = tmp_path / "b" / "c.csv"
    assert relative_path(folder, file) == "../b/c.csv"

    def relpath_between_drives(path: Path, start: Path) -> str:
        raise ValueError("path is on mount 'D:', start on mount 'C:'")

    monkeypatch.setattr("os.path.relpath", relpath_between_drives)
    assert relative_path(folder, file) == file.as_posix()
