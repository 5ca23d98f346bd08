"""A process of its own reads files: it may die of one, and it ends with the one that started it."""

import os
import pickle
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import h5py
import numpy as np
import pytest
from recording_files import some_recording

from swashtwin.foundation import DataError
from swashtwin.recordings import Recording, load_recording, write_recording
from swashtwin.recordings.formats import isolation

# A stand-in for the library of WAV files, which fails as the text of the file says.
FAILING_SOUNDFILE = """
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

ReadText = Callable[[str], Recording]


@pytest.fixture
def read_text(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ReadText]:
    """Return a function that reads a file of some text with the failing library."""
    (tmp_path / "soundfile.py").write_text(FAILING_SOUNDFILE)
    monkeypatch.syspath_prepend(tmp_path)
    isolation.stop()

    def write_and_load(text: str) -> Recording:
        path = tmp_path / f"{text}.wav"
        path.write_text(text)
        return load_recording(path, unit="1")

    yield write_and_load
    isolation.stop()


def reader_id() -> int:
    """Return the process id of the reader."""
    assert isolation.reader.pid is not None
    return isolation.reader.pid


# ---- failures of a library


def test_a_crash_is_reported_and_the_next_file_is_read(read_text: ReadText) -> None:
    message = r"crash\.wav is damaged: the library that reads it crashed \(signal 6\)"
    with pytest.raises(DataError, match=message):
        read_text("crash")

    np.testing.assert_array_equal(read_text("fine").slice(1, 3).signal[0], [1.0, 2.0])


def test_too_much_memory_is_reported_and_the_reader_lives_on(
    read_text: ReadText, monkeypatch: pytest.MonkeyPatch
) -> None:
    read_text("fine")
    first_id = reader_id()
    monkeypatch.setenv("SWASHTWIN_MEMORY_GB", "1")

    message = r"bomb\.wav .*more than the limit of 1 GB .* set SWASHTWIN_MEMORY_GB"
    with pytest.raises(DataError, match=message):
        read_text("bomb")

    # the system refuses the memory, which kills nothing
    assert read_text("fine").sample_rate == 10.0
    assert reader_id() == first_id


def test_an_endless_loop_is_ended_and_reported(
    read_text: ReadText, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(isolation, "_READ_TIMEOUT_S", 0.6)

    with pytest.raises(DataError, match=r"hang\.wav is damaged: no end was found in 1 s"):
        read_text("hang")


def test_a_crash_caused_by_an_earlier_file_is_not_blamed_on_a_later_one(
    read_text: ReadText,
) -> None:
    read_text("poison")

    assert read_text("victim").sample_rate == 10.0


# ---- the life of the reader


def test_one_process_reads_files_of_several_formats(tmp_path: Path) -> None:
    recordings = []
    for suffix in ("h5", "npz", "csv", "wav"):
        path = write_recording(some_recording(), tmp_path / f"a.{suffix}")
        recordings.append(load_recording(path, unit="m/s^2"))
    first_id = reader_id()

    for recording in recordings:
        np.testing.assert_array_equal(recording.slice(3, 9).signal, recording.signal[:, 3:9])

    assert reader_id() == first_id


def test_a_killed_reader_is_replaced(tmp_path: Path) -> None:
    path = write_recording(some_recording(), tmp_path / "a.npz")
    recording = load_recording(path)
    first_id = reader_id()

    os.kill(first_id, signal.SIGKILL)

    np.testing.assert_array_equal(recording.signal, some_recording().signal)
    assert reader_id() != first_id


# A process that reads, forks a child that reads too, and is killed.
KILLED_PARENT = """
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


def is_running(process_id: int) -> bool:
    try:
        os.kill(process_id, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_the_reader_ends_with_the_process_that_started_it(tmp_path: Path) -> None:
    path = write_recording(some_recording(), tmp_path / "a.npz")

    run = subprocess.run(
        [sys.executable, "-c", KILLED_PARENT, str(path)],
        capture_output=True,
        text=True,
        check=False,
    )

    assert run.returncode == -signal.SIGKILL, run.stderr
    orphan_id = int(run.stdout)
    deadline = time.monotonic() + 5
    while is_running(orphan_id):
        assert time.monotonic() < deadline, "the process outlives its parent"
        time.sleep(0.05)


# ---- what is kept of a file


def test_a_pickled_recording_holds_its_file_and_not_its_samples(tmp_path: Path) -> None:
    recording = load_recording(write_recording(some_recording(), tmp_path / "a.h5"))

    content = pickle.dumps(recording)

    assert len(content) < 4000
    np.testing.assert_array_equal(pickle.loads(content).signal, recording.signal)


def test_a_file_rewritten_in_place_gives_its_new_content(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        file["x"] = np.arange(100.0)
    first = load_recording(path, sample_rate=100, unit="g")
    assert first.signal[0, 1] == pytest.approx(9.80665)

    with h5py.File(path, "r+") as file:
        file["x"][:] = np.arange(100) * 2.0

    second = load_recording(path, sample_rate=100, unit="g")
    assert second.signal[0, 1] == pytest.approx(9.80665 * 2)


@pytest.mark.skipif(sys.platform != "linux", reason="open files are listed by Linux")
def test_a_deleted_file_does_not_stay_open(tmp_path: Path) -> None:
    # A watch deletes what it has judged; open, 64 recordings would keep their disk and memory.
    isolation.stop()
    for name in ("a.h5", "b.h5"):
        write_recording(some_recording(), tmp_path / name)
        assert load_recording(tmp_path / name).signal.size
        (tmp_path / name).unlink()

    open_files = Path(f"/proc/{reader_id()}/fd")
    names = [os.readlink(file) for file in open_files.iterdir()]
    assert not any("a.h5" in name for name in names)

    # the last file stays open until the next one is read
    assert any("b.h5" in name for name in names)
    isolation.stop()
