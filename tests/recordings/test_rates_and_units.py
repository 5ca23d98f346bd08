"""Files of several rates or units: each channel has its own, and nothing is taken from a
neighbor.
"""

from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from recording_files import write_uff
from scipy.io import savemat

from swashtwin.foundation import DataError
from swashtwin.recordings import load_recording

X, Y = np.arange(20.0), np.arange(20.0) + 0.5


def hdf5_data_sets(folder: Path) -> Path:
    with h5py.File(folder / "a.h5", "w") as file:
        for name, values, rate in (("x", X, 25600.0), ("y", Y, 12800.0)):
            file[name] = values
            file[name].attrs.update({"fs": rate, "unit": "g"})
    return folder / "a.h5"


def hdf5_groups(folder: Path) -> Path:
    with h5py.File(folder / "a.h5", "w") as file:
        file.attrs.update({"fs": 12800.0, "unit": "g"})
        file["fast/x"], file["slow/y"] = X, Y
        file["fast"].attrs["fs"] = 25600.0
    return folder / "a.h5"


def matlab_structures(folder: Path) -> Path:
    content = {"a": {"x": X, "fs": 25600.0, "unit": "g"}, "b": {"y": Y, "fs": 12800.0, "unit": "g"}}
    savemat(folder / "a.mat", content)
    return folder / "a.mat"


def archive_keys(folder: Path) -> Path:
    np.savez(folder / "a.npz", x=X, y=Y, x_fs=25600.0, fs_y=12800.0, unit="g")
    return folder / "a.npz"


def universal_file(folder: Path) -> Path:
    texts = []
    for values, rate in ((X, 25600.0), (Y, 12800.0)):
        write_uff(folder / "a.uff", values[None], 1 / rate, "g")
        texts.append((folder / "a.uff").read_text())
    (folder / "a.uff").write_text(texts[0] + texts[1].replace("point 0", "point 1"))
    return folder / "a.uff"


@pytest.mark.parametrize(
    "write", [hdf5_data_sets, hdf5_groups, matlab_structures, archive_keys, universal_file]
)
def test_each_channel_has_its_own_rate_and_two_rates_are_refused_together(
    write: Callable[[Path], Path], tmp_path: Path
) -> None:
    path = write(tmp_path)
    with pytest.raises(
        DataError, match=r"several rates \(\S.*: 25600 Hz, \S.*: 12800 Hz\).*with channels"
    ) as caught:
        load_recording(path)
    assert "\n" not in str(caught.value)
    for channel, rate, values in ((0, 25600.0, X), (1, 12800.0, Y)):
        loaded = load_recording(path, channels=[channel])
        assert loaded.sample_rate == rate
        np.testing.assert_allclose(loaded.signal[0], values * 9.80665)
    with pytest.raises(DataError, match="12800 Hz, but 25600 Hz is specified"):
        load_recording(path, channels=[1], sample_rate="25.6 kHz")


def test_two_rates_for_the_same_vector_and_one_that_is_none_are_refused_by_name(
    tmp_path: Path,
) -> None:
    np.savez(tmp_path / "a.npz", x=X, fs=25600.0, sample_rate=12800.0)
    with pytest.raises(
        DataError, match=r"two sample rates for x \(fs = 25600\.0, sample_rate = 12800\.0\)"
    ):
        load_recording(tmp_path / "a.npz", unit="g")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["x"] = X
        file["x"].attrs.update({"fs": 25600.0, "samplerate": 12800.0})
    with pytest.raises(
        DataError, match=r"two sample rates for x \(fs = 25600\.0, samplerate = 12800\.0\)"
    ):
        load_recording(tmp_path / "a.h5", unit="g")
    for rate in (0.0, -5.0):
        savemat(tmp_path / "a.mat", {"x": X, "fs": rate})
        with pytest.raises(DataError, match=rf"a\.mat states a sample rate of {rate:g} Hz"):
            load_recording(tmp_path / "a.mat", unit="g", sample_rate="1 kHz")
    savemat(tmp_path / "b.mat", {"x": X, "fs": rate, "sample_rate": 2e3})
    assert load_recording(tmp_path / "b.mat", unit="g").sample_rate == 2e3


def test_units_of_two_structures_are_not_mixed(tmp_path: Path) -> None:
    savemat(
        tmp_path / "a.mat", {"fs": 1000.0, "a": {"x": X, "unit": "g"}, "b": {"y": Y, "unit": "Pa"}}
    )
    with pytest.raises(DataError, match="different units"):
        load_recording(tmp_path / "a.mat", channels=["a.x", "b.y"])
    assert load_recording(tmp_path / "a.mat").channels == ("a.x",)
    assert load_recording(tmp_path / "a.mat", channels=["b.y"]).unit == "Pa"
    with pytest.raises(DataError, match=r"'b\.y' is in Pa, but g is specified"):
        load_recording(tmp_path / "a.mat", channels=["b.y"], unit="g")


def times_in_mat(folder: Path, **stated: object) -> Path:
    savemat(folder / "a.mat", {"x": X, "time": np.arange(len(X)) / 1000.0, "unit": "g", **stated})
    return folder / "a.mat"


def times_in_npz(folder: Path, **stated: object) -> Path:
    np.savez(folder / "a.npz", x=X, time=np.arange(len(X)) / 1000.0, unit="g", **stated)  # type: ignore[arg-type]
    return folder / "a.npz"


@pytest.mark.parametrize("make", [times_in_mat, times_in_npz])
def test_a_vector_of_times_is_no_channel_and_agrees_with_the_stated_rate(
    make: Callable[..., Path], tmp_path: Path
) -> None:
    for stated in ({}, {"fs": 1000.0}):
        loaded = load_recording(make(tmp_path, **stated))
        assert (loaded.channels, loaded.sample_rate) == (("x",), 1000.0)
    with pytest.raises(
        DataError, match="two sample rates for x: 2000 Hz, and 1000 Hz by the times in time"
    ):
        load_recording(make(tmp_path, fs=2000.0))


@pytest.mark.parametrize("make", [times_in_mat, times_in_npz])
def test_a_vector_called_t_that_does_not_rise_stays_a_channel_beside_a_rate(
    make: Callable[..., Path], tmp_path: Path
) -> None:
    path = make(tmp_path, fs=1000.0, t=np.sin(np.arange(len(X))))
    assert load_recording(path).channels == ("x", "t")
