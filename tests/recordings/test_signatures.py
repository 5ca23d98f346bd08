"""A file that is not what its suffix states is named for what it is."""

import gzip
import json
import re
import shutil
import zipfile
from pathlib import Path

import h5py
import numpy as np
import pytest

from swashtwin.foundation import DataError
from swashtwin.recordings import Recording, load_recording, write_recording

CASES = Path(__file__).parent / "cases"
TABLE = "time;acc\n" + "".join(f"{n / 1000};{n % 7 - 3}\n" for n in range(500))
PAGE = "\n<!DOCTYPE html>\n<html><head><title>Anmelden</title></head></html>\n"


def zipped(path: Path, names: list[str]) -> None:
    with zipfile.ZipFile(path, "w") as archive:
        for name in names:
            archive.writestr(name, b"content")


def array_file(path: Path) -> None:
    with path.open("wb") as file:
        np.save(file, np.arange(9.0))


def hdf5_file(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["x"] = np.arange(9.0)


CONTENTS = {
    "git lfs": (
        lambda path: shutil.copy(CASES / "K18-gitlfs.mat", path),
        "a Git LFS pointer to the file",
        "git lfs pull",
    ),
    "git annex": (
        lambda path: path.write_text("/annex/objects/MD5E-s123--abc.h5\n"),
        "a git-annex pointer",
        "git annex get",
    ),
    "page": (lambda path: path.write_text(PAGE), "a web page (HTML)", "Download the file itself"),
    "pdf": (lambda path: path.write_bytes(b"%PDF-1.7\n%\xe2\xe3\n"), "a PDF document", "Export"),
    "json": (
        lambda path: path.write_text(json.dumps({"acc": [0.1, 0.2, 0.3]}, indent=1)),
        "a JSON text",
        "as CSV",
    ),
    "json list": (lambda path: path.write_text("[\n0.1,\n0.2,\n0.3\n]\n"), "a JSON text", "as CSV"),
    "xlsx": (
        lambda path: zipped(path, ["[Content_Types].xml", "xl/workbook.xml"]),
        "an Excel workbook",
        "Save its sheet as CSV",
    ),
    "ods": (
        lambda path: zipped(path, ["mimetype", "content.xml"]),
        "a document of OpenDocument",
        "Save its sheet as CSV",
    ),
    "zip": (lambda path: zipped(path, ["run1.csv"]), "a ZIP archive", "Unpack it"),
    "old workbook": (
        lambda path: path.write_bytes(b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(600)),
        "a workbook or document of Office",
        "Save its sheet as CSV",
    ),
    "gz": (
        lambda path: path.write_bytes(gzip.compress(TABLE.encode())),
        "a gzipped file",
        "Unpack it",
    ),
    "image": (lambda path: path.write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(99)), "an image", "Name"),
    "npy": (array_file, "a single NumPy array", "numpy.savez"),
    "database": (
        lambda path: path.write_bytes(b"SQLite format 3\0" + bytes(99)),
        "an SQLite database",
        "Export",
    ),
}


@pytest.mark.parametrize("suffix", [".csv", ".mat", ".h5", ".wav", ".tdms", ".parquet", ".xls"])
@pytest.mark.parametrize("content", CONTENTS)
def test_a_file_of_another_kind_is_named(tmp_path: Path, content: str, suffix: str) -> None:
    write, kind, remedy = CONTENTS[content]
    path = tmp_path / f"run{suffix}"
    write(path)

    with pytest.raises(DataError, match=re.escape(f"run{suffix} is {kind}")) as refusal:
        load_recording(path, sample_rate="1 kHz", unit="g")

    assert remedy in refusal.value.remedy


@pytest.mark.parametrize("suffix", [".xls", ".mat", ".tdms", ".h5", ".xlsx", ".npz"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_a_table_saved_as_something_else_can_be_renamed(
    tmp_path: Path, suffix: str, encoding: str
) -> None:
    path = tmp_path / f"run{suffix}"
    path.write_text(TABLE, encoding=encoding)

    with pytest.raises(DataError, match="is a text that begins with 'time;acc'") as refusal:
        load_recording(path, unit="g")

    assert "Rename it to .csv" in refusal.value.remedy
    assert load_recording(path.rename(tmp_path / "run.csv"), unit="g").sample_rate == 1000


@pytest.mark.parametrize(
    ("suffix", "kind"),
    [
        (".wav", "a WAV file"),
        (".tdms", "a TDMS file"),
        (".parquet", "a Parquet file"),
        (".h5", "an HDF5 file"),
        (".npz", "a NumPy archive"),
        (".mf4", "an MDF file"),
    ],
)
def test_a_recording_with_a_wrong_suffix_can_be_renamed(
    tmp_path: Path, suffix: str, kind: str
) -> None:
    if suffix == ".mf4":
        pytest.importorskip("asammdf")
    signal = np.random.default_rng(0).standard_normal((1, 500))
    recording = Recording(signal=signal, sample_rate=1000.0, recording_id="a", channels=("x",))
    written = write_recording(recording, tmp_path / f"a{suffix}")
    path = written.rename(tmp_path / "a.csv")

    with pytest.raises(DataError, match=rf"a\.csv is {kind}, not a \.csv file") as refusal:
        load_recording(path, unit="g")

    assert refusal.value.remedy == f"Rename it to {suffix}."
    renamed = path.rename(tmp_path / f"b{suffix}")
    assert load_recording(renamed, unit=None if suffix != ".wav" else "g").n_samples == 500


def test_hdf5_without_the_head_of_matlab_can_be_renamed(tmp_path: Path) -> None:
    hdf5_file(tmp_path / "a.mat")

    with pytest.raises(DataError, match="is an HDF5 file") as refusal:
        load_recording(tmp_path / "a.mat", sample_rate="1 kHz", unit="g")

    assert refusal.value.remedy == "Rename it to .h5."
