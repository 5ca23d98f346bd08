"""A file that is written anew after it was loaded, with the size and the date that it had.

Recorders that overwrite a ring of files, and programs that copy dates, write such files.
"""

import os
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.io import savemat, wavfile

from swashtwin.foundation import DataError
from swashtwin.recordings import load_recording

DATE_S = 1_600_000_000
SAMPLES = np.random.default_rng(0).normal(size=3000).clip(-9, 9)


def write_csv(path: Path, samples: np.ndarray) -> None:
    # Signs are written, so that the negative samples take as many characters.
    path.write_text("acc\n" + "".join(f"{value:+.4f}\n" for value in samples))


def write_hdf5(path: Path, samples: np.ndarray) -> None:
    with h5py.File(path, "w") as file:
        file["acc"] = samples


WRITERS: dict[str, Callable[[Path, np.ndarray], object]] = {
    "csv": write_csv,
    "wav": lambda path, samples: wavfile.write(path, 1000, samples.astype(np.float32)),
    "h5": write_hdf5,
    "npz": lambda path, samples: np.savez(path, acc=samples),
    "mat": lambda path, samples: savemat(path, {"acc": samples}),
}


@pytest.mark.parametrize("suffix", WRITERS)
def test_a_file_written_anew_never_gives_its_old_samples(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a.{suffix}"

    def write(samples: np.ndarray) -> None:
        WRITERS[suffix](path, samples)
        os.utime(path, (DATE_S, DATE_S))

    write(SAMPLES)
    old_size = path.stat().st_size
    opened = load_recording(path, sample_rate="1 kHz", unit="1")
    old_first = opened.slice(0, 10).signal.copy()

    write(-SAMPLES)
    assert path.stat().st_size == old_size

    # What is loaded now has the new samples; what was loaded before refuses to mix both.
    reloaded = load_recording(path, sample_rate="1 kHz", unit="1")
    np.testing.assert_array_equal(reloaded.slice(0, 10).signal, -old_first)
    with pytest.raises(DataError, match="the file has changed since it was loaded; load it again"):
        opened.slice(0, 10)
