"""The process that reads files: it may die, never this one; it serves one file after the other and
ends with this.
"""

import os
import pickle
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from recording_files import some_recording

from swashtwin.foundation import DataError
from swashtwin.recordings import Recording, load_recording, write_recording
from swashtwin.recordings.formats import isolation

DEADLY = """
import os, sys
import numpy as np

class SoundFile:
    channels, frames, samplerate, subtype = 1, 5, 10, "DOUBLE"
    def __init__(self, path):
        text = open(path).read()
        if text == "crash":
            os.abort()
        if text == "hang":
            while True: pass
        if text == "bomb":
            np.ones(int(3e9))
        if text == "poison":
            sys.poisoned = True
        if text == "victim" and hasattr(sys, "poisoned"):
            os.abort()
    def seek(self, start):
        self.start = start
    def read(self, count, dtype, always_2d):
        return np.arange(float(self.frames))[self.start : self.start + count, None]
"""
"""A library that dies of some files."""


@pytest.fixture
def read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str], Recording]]:
    """Reads a file of some text by that library."""
    (tmp_path / "soundfile.py").write_text(DEADLY)
    monkeypatch.syspath_prepend(tmp_path)
    isolation.stop()

    def read_text(text: str) -> Recording:
        path = tmp_path / f"{text}.wav"
        path.write_text(text)
        return load_recording(path, unit="1")

    yield read_text
    isolation.stop()


def worker_id() -> int:
    assert isolation.reader.pid is not None
    return isolation.reader.pid


def test_a_crash_an_endless_loop_and_too_much_memory_are_one_line_each(
    read: Callable[[str], Recording], monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(
        DataError, match=r"crash\.wav is damaged: the library that reads it crashed \(signal 6\)"
    ):
        read("crash")
    np.testing.assert_array_equal(read("fine").slice(1, 3).signal[0], [1.0, 2.0])
    before = worker_id()
    monkeypatch.setenv("SWASHTWIN_MEMORY_GB", "1")
    with pytest.raises(
        DataError, match=r"bomb\.wav .*more than the limit of 1 GB .* set SWASHTWIN_MEMORY_GB"
    ):
        read("bomb")
    assert read("fine").sample_rate == 10.0
    assert worker_id() == before  # refused by the system, and the process goes on
    monkeypatch.setattr(isolation, "_READ_TIMEOUT_S", 0.6)
    with pytest.raises(DataError, match=r"hang\.wav is damaged: no end was found in 1 s"):
        read("hang")


def test_what_an_earlier_file_broke_is_not_blamed_on_a_later_one(
    read: Callable[[str], Recording],
) -> None:
    read("poison")
    assert read("victim").sample_rate == 10.0


def test_one_process_reads_many_files_and_is_started_anew_when_it_was_killed(
    tmp_path: Path,
) -> None:
    recording = some_recording()
    paths = [
        write_recording(recording, tmp_path / f"a.{suffix}")
        for suffix in ("h5", "npz", "csv", "wav")
    ]
    loaded = [load_recording(path, unit="m/s^2") for path in paths]
    before = worker_id()
    for each in loaded:
        np.testing.assert_array_equal(each.slice(3, 9).signal, each.signal[:, 3:9])
    assert worker_id() == before
    (fresh,) = [load_recording(paths[1])]
    os.kill(before, signal.SIGKILL)
    np.testing.assert_array_equal(fresh.signal, recording.signal)
    assert worker_id() != before


def test_columns_are_pickled_without_their_samples(tmp_path: Path) -> None:
    recording = load_recording(write_recording(some_recording(), tmp_path / "a.h5"))
    content = pickle.dumps(recording)
    assert len(content) < 4000
    np.testing.assert_array_equal(pickle.loads(content).signal, recording.signal)


ORPHAN = """
import os, signal, sys
from swashtwin.recordings import load_recording
from swashtwin.recordings.formats import isolation
load_recording(sys.argv[1])
child = os.fork()
if child == 0:
    assert load_recording(sys.argv[1]).signal.shape[0] == 2  # by a process of its own
    os._exit(0)
assert os.waitpid(child, 0)[1] == 0
print(isolation.reader.pid, flush=True)
os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_the_process_ends_with_the_one_that_started_it(tmp_path: Path) -> None:
    path = write_recording(some_recording(), tmp_path / "a.npz")
    run = subprocess.run(
        [sys.executable, "-c", ORPHAN, str(path)], capture_output=True, text=True, check=False
    )
    assert run.returncode == -signal.SIGKILL, run.stderr
    deadline = time.monotonic() + 5
    while time.monotonic() < deadline:
        try:
            os.kill(int(run.stdout), 0)
        except ProcessLookupError:
            return
        time.sleep(0.05)
    raise AssertionError("the process outlives its parent")


def test_a_file_that_was_written_anew_in_place_gives_its_new_content(tmp_path: Path) -> None:
    import h5py

    for value in (1.0, 2.0):
        with h5py.File(tmp_path / "a.h5", "r+" if value > 1 else "w") as file:
            data = file.require_dataset("x", (100,), "f8")
            data[:] = np.arange(100) * value
        recording = load_recording(tmp_path / "a.h5", sample_rate=100, unit="g")
        assert recording.signal[0, 1] == pytest.approx(9.80665 * value)


@pytest.mark.skipif(sys.platform != "linux", reason="open files are listed by Linux")
def test_a_deleted_file_does_not_stay_open(tmp_path: Path) -> None:
    # A watch deletes what it has judged; open, 64 recordings would keep their disk and memory.
    isolation.stop()
    for name in ("a.h5", "b.h5"):
        write_recording(some_recording(), tmp_path / name)
        assert load_recording(tmp_path / name).signal.size
        (tmp_path / name).unlink()
    assert isolation.reader.pid is not None
    opened = Path(f"/proc/{isolation.reader.pid}/fd")
    names = [os.readlink(file) for file in opened.iterdir()]
    assert not any("a.h5" in name for name in names)
    assert any("b.h5" in name for name in names)
    isolation.stop()
