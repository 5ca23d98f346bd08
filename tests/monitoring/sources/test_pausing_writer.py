"""A program that pauses while it writes a file: the file is taken once, whole."""

import io
import time
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from watched_pumps import hum, watch_config

from swashtwin.monitoring import Outcome, run_watch
from swashtwin.monitoring.config.settings import FolderSource, Seconds
from swashtwin.monitoring.sources import folder
from swashtwin.monitoring.sources.completeness import is_complete
from swashtwin.monitoring.sources.folder import FolderWatch
from swashtwin.recordings import Recording, write_recording

SETTLE_TIME_S = 0.05


def csv_bytes(recording: Recording) -> bytes:
    times = np.arange(recording.n_samples) / recording.sample_rate
    file = io.BytesIO()
    rows = np.column_stack([times, recording.signal.T])
    np.savetxt(file, rows, "%.6f", ",", header="time [s],x [m/s^2],y [m/s^2]", comments="")
    return file.getvalue()


def wav_bytes() -> bytes:
    file = io.BytesIO()
    scipy.io.wavfile.write(file, 1000, np.zeros((500, 2), np.float32))
    return file.getvalue()


def npz_bytes() -> bytes:
    file = io.BytesIO()
    np.savez(file, x=np.arange(500.0))
    return file.getvalue()


def npy_bytes() -> bytes:
    file = io.BytesIO()
    np.save(file, np.arange(500.0))
    return file.getvalue()


def mat_bytes(*, is_compressed: bool) -> bytes:
    file = io.BytesIO()
    values = {"x": np.arange(500.0), "name": "pump", "fs": 1000.0}
    scipy.io.savemat(file, values, do_compression=is_compressed)
    return file.getvalue()


def hdf5_bytes(folder_path: Path, **options: object) -> bytes:
    import h5py

    path = folder_path / "a.h5"
    with h5py.File(path, "w", **options) as file:
        file["x"] = np.arange(5000.0)
    return path.read_bytes()


def matlab_hdf5_bytes(folder_path: Path) -> bytes:
    header = b"MATLAB 7.3 MAT-file".ljust(512, b" ")
    return header + hdf5_bytes(folder_path, userblock_size=512)[512:]


def tdms_bytes(folder_path: Path) -> bytes:
    nptdms = pytest.importorskip("nptdms")
    path = folder_path / "a.tdms"
    with nptdms.TdmsWriter(str(path)) as writer:
        for part in range(2):
            channel = nptdms.ChannelObject("group", "x", np.arange(500.0) + part)
            writer.write_segment([channel])
    return path.read_bytes()


def parquet_bytes(folder_path: Path) -> bytes:
    polars = pytest.importorskip("polars")
    path = folder_path / "a.parquet"
    polars.DataFrame({"x": np.arange(500.0)}).write_parquet(path)
    return path.read_bytes()


def uff_bytes(folder_path: Path) -> bytes:
    return b"    -1\n    58\n  1.0  2.0\n    -1\n    -1\n   151\nx\n    -1\n"


FILES = {
    "a.wav": lambda _: wav_bytes(),
    "a.npz": lambda _: npz_bytes(),
    "a.npy": lambda _: npy_bytes(),
    "a.mat": lambda _: mat_bytes(is_compressed=False),
    "compressed.mat": lambda _: mat_bytes(is_compressed=True),
    "a.h5": hdf5_bytes,
    "latest.h5": lambda path: hdf5_bytes(path, libver="latest"),
    "seven.mat": matlab_hdf5_bytes,
    "a.tdms": tdms_bytes,
    "a.parquet": parquet_bytes,
    "a.uff": uff_bytes,
    "a.csv": lambda _: csv_bytes(hum(1)),
}


@pytest.mark.parametrize("name", FILES)
def test_a_file_is_complete_at_its_end_and_nowhere_else(name: str, tmp_path: Path) -> None:
    content = FILES[name](tmp_path)
    assert is_complete(name, content)

    cuts = [0, 3, 20, 100, len(content) // 3, len(content) - 40, len(content) - 2]
    for length in cuts:
        assert not is_complete(name, content[:length].rstrip(b"\n")), length


@pytest.mark.parametrize("size", [0, 0xFFFFFFFF])
def test_a_wav_file_that_is_not_closed_is_incomplete(size: int) -> None:
    content = bytearray(wav_bytes())
    position = content.index(b"data") + 4
    content[position : position + 4] = size.to_bytes(4, "little")
    assert not is_complete("a.wav", bytes(content))


def test_what_has_no_known_end_counts_as_complete() -> None:
    assert is_complete("a.bin", b"\x01\x02")
    assert is_complete("a.raw", b"text without a line break")


def folder_watch(tmp_path: Path, deliveries) -> FolderWatch:
    (tmp_path / "inbox").mkdir(exist_ok=True)
    source = FolderSource(name="inbox", path=tmp_path / "inbox", settle_time=Seconds(SETTLE_TIME_S))
    return FolderWatch(source, deliveries.accept, tmp_path / "data")


def poll_for(watch: FolderWatch, settle_times: float) -> None:
    end = time.monotonic() + settle_times * SETTLE_TIME_S
    while time.monotonic() < end:
        watch.poll()
        time.sleep(SETTLE_TIME_S / 4)


@pytest.mark.parametrize("name", ["a.wav", "a.h5", "a.csv"])
def test_a_pause_longer_than_the_settle_time_splits_no_file(
    name: str, tmp_path: Path, deliveries
) -> None:
    content = FILES[name](tmp_path)
    watch = folder_watch(tmp_path, deliveries)
    path = tmp_path / "inbox" / name

    path.write_bytes(content[: len(content) // 2])
    poll_for(watch, 4)
    assert deliveries.items == []

    with path.open("ab") as file:
        file.write(content[len(content) // 2 :])
    poll_for(watch, 4)
    assert [delivered for _, delivered in deliveries.items] == [content]


def test_a_file_that_stays_incomplete_is_taken_as_it_is(
    tmp_path: Path, deliveries, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(folder, "PATIENCE", 3)
    watch = folder_watch(tmp_path, deliveries)
    (tmp_path / "inbox" / "cut.csv").write_bytes(b"x\n1")
    poll_for(watch, 2)
    assert deliveries.items == []
    poll_for(watch, 5)
    assert len(deliveries.items) == 1


def judge(tmp_path: Path) -> list[Outcome]:
    outcomes: list[Outcome] = []
    run_watch(watch_config(tmp_path), once=True, progress=outcomes.append)
    return outcomes


def test_a_file_that_was_judged_and_grew_is_refused_however_often(tmp_path: Path) -> None:
    lines = csv_bytes(hum(1)).splitlines(keepends=True)
    watch_config(tmp_path)
    path = tmp_path / "incoming" / "a.csv"
    # It ends with a line, so nothing shows that more follows.
    path.write_bytes(b"".join(lines[:5000]))
    assert [outcome.state for outcome in judge(tmp_path)] == ["learning"]

    for count in (7000, 9000):
        path.write_bytes(b"".join(lines[:count]))
        (outcome,) = judge(tmp_path)
        assert outcome.state == "rejected"
        assert "grew after it was judged" in outcome.sentence
        assert "settle_time" in outcome.sentence


def test_a_file_whose_beginning_was_refused_is_judged_whole(tmp_path: Path) -> None:
    lines = csv_bytes(hum(1)).splitlines(keepends=True)
    watch_config(tmp_path)
    path = tmp_path / "incoming" / "a.csv"
    path.write_bytes(lines[0])
    assert [outcome.state for outcome in judge(tmp_path)] == ["rejected"]
    path.write_bytes(b"".join(lines))
    assert [outcome.state for outcome in judge(tmp_path)] == ["learning"]


def test_another_file_of_the_same_name_is_judged(tmp_path: Path) -> None:
    watch_config(tmp_path)
    path = tmp_path / "incoming" / "latest.h5"
    states = []
    for number in range(3):
        write_recording(hum(number), path)
        states += [outcome.state for outcome in judge(tmp_path)]
    assert states == ["learning"] * 3


def test_a_list_of_taken_files_of_an_earlier_version_is_read(tmp_path: Path) -> None:
    path = tmp_path / "taken.txt"
    path.write_text('["a.wav", 1, 2, 3, "abc"]\n')
    stamp = folder.Stamp(1, 2, 3)
    assert folder.TakenFiles(path).has("a.wav", stamp)
