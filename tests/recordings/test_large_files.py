"""Files that require more memory than there is are refused by what they state."""

import resource
import tracemalloc
import zipfile
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from numpy.lib import format
from scipy.io import savemat

from swashtwin.foundation import DataError
from swashtwin.recordings import Recording, channel_statistics, load_recording, write_recording

FileWriter = Callable[[Path], Path]


# ---- files that state, or unpack to, more than they hold


def write_compressed_archive(folder: Path) -> Path:
    np.savez_compressed(folder / "a.npz", x=np.zeros(1_000_000))
    return folder / "a.npz"


def write_archive_with_false_shape(folder: Path) -> Path:
    """Write a header of 8 TB, and no sample."""
    header = {"descr": "<f8", "fortran_order": False, "shape": (10**12,)}
    with zipfile.ZipFile(folder / "a.npz", "w") as archive, archive.open("x.npy", "w") as file:
        format.write_array_header_1_0(file, header)
    return folder / "a.npz"


def write_compressed_matlab_file(folder: Path) -> Path:
    savemat(folder / "a.mat", {"x": np.zeros(1_500_000)}, do_compression=True)
    return folder / "a.mat"


def write_hdf5_with_huge_chunks(folder: Path) -> Path:
    """Write chunks of 3.2 GB, since a chunk is unpacked whole, of a byte each."""
    with h5py.File(folder / "a.h5", "w") as file:
        data_set = file.create_dataset(
            "x", (500_000_000,), "f8", chunks=(400_000_000,), compression="gzip"
        )
        data_set.id.write_direct_chunk((0,), b"x")
        data_set.id.write_direct_chunk((400_000_000,), b"x")
    return folder / "a.h5"


def write_hdf5_of_fill_values(folder: Path) -> Path:
    """Write 8 GB that HDF5 makes up when they are read."""
    with h5py.File(folder / "a.h5", "w") as file:
        file.create_dataset("x", (1_000_000_000,), "f8", chunks=(1 << 20,), fillvalue=3.0)
    return folder / "a.h5"


# ---- HDF5 files whose samples are elsewhere


def write_hdf5_with_missing_chunks(folder: Path) -> Path:
    with h5py.File(folder / "a.h5", "w") as file:
        data_set = file.create_dataset("x", (100_000,), "f8", chunks=(1 << 14,))
        data_set[: 1 << 14] = 1.0
    return folder / "a.h5"


def write_virtual_hdf5(folder: Path) -> Path:
    layout = h5py.VirtualLayout((100,), "f8")
    layout[:] = h5py.VirtualSource("absent.h5", "x", (100,))
    with h5py.File(folder / "a.h5", "w") as file:
        file.create_virtual_dataset("x", layout)
    return folder / "a.h5"


def write_external_hdf5(folder: Path) -> Path:
    """Write a data set that would read any file of the system."""
    with h5py.File(folder / "a.h5", "w") as file:
        file.create_dataset("x", (100,), "f8", external=[("/etc/passwd", 0, 800)])
    return folder / "a.h5"


def write_linked_hdf5(folder: Path) -> Path:
    with h5py.File(folder / "a.h5", "w") as file:
        file["y"] = np.arange(5.0)
        file["x"] = h5py.ExternalLink("other.h5", "/x")
    return folder / "a.h5"


@pytest.mark.parametrize(
    ("write", "message"),
    [
        pytest.param(
            write_hdf5_with_huge_chunks,
            r"chunks of /x that take 3\.2 GB, more than the limit of 0\.01 GB|unpacks to 4 GB",
            id="huge chunks",
        ),
        pytest.param(
            write_hdf5_of_fill_values,
            r"unpacks to 8 GB \(/x, \(1000000000,\)\), more than 100 times its size",
            id="fill values",
        ),
        pytest.param(
            write_hdf5_with_missing_chunks,
            r"/x only 1 of 7 chunks were written",
            id="missing chunks",
        ),
        pytest.param(write_virtual_hdf5, "/x is virtual", id="virtual data set"),
        pytest.param(write_external_hdf5, "/x is external", id="external data set"),
        pytest.param(
            write_linked_hdf5, r"'x' is a link to another file \(other\.h5\)", id="external link"
        ),
        pytest.param(
            write_archive_with_false_shape,
            r"takes more than the limit of 0\.01 GB of memory to read; .*SWASHTWIN_MEMORY_GB",
            id="false shape",
        ),
        pytest.param(
            write_compressed_matlab_file,
            r"takes 0\.012 GB, more than the limit of 0\.01 GB; .*SWASHTWIN_MEMORY_GB",
            id="compressed MATLAB file",
        ),
        pytest.param(
            write_compressed_archive,
            r"takes 0\.016 GB, more than the limit of 0\.01 GB; .*SWASHTWIN_MEMORY_GB",
            id="compressed archive",
        ),
    ],
)
def test_a_file_that_requires_too_much_is_refused_before_memory_is_taken(
    write: FileWriter, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SWASHTWIN_MEMORY_GB", "0.01")
    path = write(tmp_path)
    peak_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss

    with pytest.raises(DataError, match=message) as refusal:
        load_recording(path, sample_rate=1000, unit="g")

    assert "\n" not in str(refusal.value)
    assert path.name in str(refusal.value)

    # kB; reading them would take gigabytes
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - peak_kb < 50_000


# ---- recordings larger than memory


def test_a_resampling_beyond_memory_is_refused_with_both_sizes(tmp_path: Path) -> None:
    path = write_recording(Recording(np.zeros((1, 25600)), 25600.0, "a"), tmp_path / "a.h5")

    message = r"resampled to 1e\+09 Hz takes 8 GB, more than the limit of 4 GB"
    with pytest.raises(DataError, match=message):
        load_recording(path, resample="1e9 Hz")


@pytest.fixture
def file_of_800_kb(tmp_path: Path) -> Path:
    recording = Recording(np.ones((2, 50_000)), 25600.0, "a", channels=("x", "y"))
    return write_recording(recording, tmp_path / "a.h5")


def test_a_file_larger_than_memory_is_read_in_parts_but_not_whole(
    file_of_800_kb: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SWASHTWIN_MEMORY_GB", "0.0006")
    loaded = load_recording(file_of_800_kb)

    assert loaded.slice(40_000, 40_010).signal.sum() == 20

    message = r"with all its samples in memory, 0\.0008 GB, more than the limit"
    with pytest.raises(DataError, match=message):
        _ = loaded.signal


def test_a_memory_limit_that_is_no_number_is_refused(
    file_of_800_kb: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SWASHTWIN_MEMORY_GB", "much")

    with pytest.raises(ValueError, match="SWASHTWIN_MEMORY_GB = 'much' must be a positive number"):
        _ = load_recording(file_of_800_kb).signal


# ---- recordings that are inspected in parts


def test_an_inspection_holds_few_parts_of_a_long_recording_in_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    part_samples = 1 << 16
    monkeypatch.setattr(channel_statistics, "PART_SAMPLES", part_samples)
    samples = np.random.default_rng(0).normal(size=(1, 64 * part_samples))
    path = write_recording(Recording(samples, 50_000.0, "long"), tmp_path / "long.h5")
    recording = load_recording(path)

    tracemalloc.start()
    statistics = channel_statistics.compute_channel_statistics(recording)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()

    assert statistics[0].count == samples.size
    # of 64 parts
    assert peak < 16 * 8 * part_samples
