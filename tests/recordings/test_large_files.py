"""Files that ask for more than there is: refused from what they state, before anything is taken."""

import resource
import zipfile
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from numpy.lib import format
from scipy.io import savemat

from swashtwin.foundation import DataError
from swashtwin.recordings import Recording, load_recording, write_recording


def packed_archive(folder: Path) -> Path:
    np.savez_compressed(folder / "a.npz", x=np.zeros(1_000_000))
    return folder / "a.npz"


def one_chunk(folder: Path) -> Path:
    with h5py.File(folder / "a.h5", "w") as file:
        x = file.create_dataset(
            "x", (500_000_000,), "f8", chunks=(400_000_000,), compression="gzip"
        )
        x.id.write_direct_chunk((0,), b"x")
        x.id.write_direct_chunk((400_000_000,), b"x")
    return folder / "a.h5"


def fill_values(folder: Path) -> Path:
    with h5py.File(folder / "a.h5", "w") as file:
        file.create_dataset("x", (1_000_000_000,), "f8", chunks=(1 << 20,), fillvalue=3.0)
    return folder / "a.h5"


def unwritten(folder: Path) -> Path:
    with h5py.File(folder / "a.h5", "w") as file:
        file.create_dataset("x", (100_000,), "f8", chunks=(1 << 14,))[: 1 << 14] = 1.0
    return folder / "a.h5"


def virtual(folder: Path) -> Path:
    layout = h5py.VirtualLayout((100,), "f8")
    layout[:] = h5py.VirtualSource("absent.h5", "x", (100,))
    with h5py.File(folder / "a.h5", "w") as file:
        file.create_virtual_dataset("x", layout)
    return folder / "a.h5"


def external(folder: Path) -> Path:
    with h5py.File(folder / "a.h5", "w") as file:
        file.create_dataset("x", (100,), "f8", external=[("/etc/passwd", 0, 800)])
    return folder / "a.h5"


def linked(folder: Path) -> Path:
    with h5py.File(folder / "a.h5", "w") as file:
        file["y"] = np.arange(5.0)
        file["x"] = h5py.ExternalLink("other.h5", "/x")
    return folder / "a.h5"


def shape_of_more_than_there_is(folder: Path) -> Path:
    with zipfile.ZipFile(folder / "a.npz", "w") as archive, archive.open("x.npy", "w") as file:
        format.write_array_header_1_0(
            file, {"descr": "<f8", "fortran_order": False, "shape": (10**12,)}
        )
    return folder / "a.npz"


def matlab_zeros(folder: Path) -> Path:
    savemat(folder / "a.mat", {"x": np.zeros(1_500_000)}, do_compression=True)
    return folder / "a.mat"


BOMBS: list[tuple[Callable[[Path], Path], str]] = [
    (one_chunk, r"chunks of /x that take 3\.2 GB, more than the limit of 0\.01 GB|unpacks to 4 GB"),
    (fill_values, r"unpacks to 8 GB \(/x, \(1000000000,\)\), more than 100 times its size"),
    (unwritten, r"/x only 1 of 7 chunks were written"),
    (virtual, "/x is virtual"),
    (external, "/x is external"),
    (linked, r"'x' is a link to another file \(other\.h5\)"),
    (
        shape_of_more_than_there_is,
        r"takes more than the limit of 0\.01 GB of memory to read; .*SWASHTWIN_MEMORY_GB",
    ),
    (matlab_zeros, r"takes 0\.012 GB, more than the limit of 0\.01 GB; .*SWASHTWIN_MEMORY_GB"),
    (packed_archive, r"takes 0\.016 GB, more than the limit of 0\.01 GB; .*SWASHTWIN_MEMORY_GB"),
]


@pytest.mark.parametrize(("write", "message"), BOMBS, ids=[write.__name__ for write, _ in BOMBS])
def test_a_file_that_asks_for_too_much_is_refused_before_anything_is_taken(
    write: Callable[[Path], Path], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SWASHTWIN_MEMORY_GB", "0.01")
    path = write(tmp_path)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(DataError, match=message) as caught:
        load_recording(path, sample_rate=1000, unit="g")
    assert "\n" not in str(caught.value)
    assert path.name in str(caught.value)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 50_000


def test_a_resampling_beyond_memory_is_refused_with_both_numbers(tmp_path: Path) -> None:
    path = write_recording(Recording(np.zeros((1, 25600)), 25600.0, "a"), tmp_path / "a.h5")
    with pytest.raises(
        DataError, match=r"resampled to 1e\+09 Hz takes 8 GB, more than the limit of 4 GB"
    ):
        load_recording(path, resample="1e9 Hz")


def test_a_large_file_is_read_in_parts_and_refused_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_recording(
        Recording(np.ones((2, 50_000)), 25600.0, "a", channels=("x", "y")), tmp_path / "a.h5"
    )
    monkeypatch.setenv("SWASHTWIN_MEMORY_GB", "0.0006")
    loaded = load_recording(path)
    assert loaded.slice(40_000, 40_010).signal.sum() == 20
    with pytest.raises(
        DataError, match=r"with all its samples in memory, 0\.0008 GB, more than the limit"
    ):
        _ = loaded.signal
    monkeypatch.setenv("SWASHTWIN_MEMORY_GB", "much")
    with pytest.raises(ValueError, match="SWASHTWIN_MEMORY_GB = 'much' must be a positive number"):
        _ = load_recording(path).signal
