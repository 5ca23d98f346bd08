"""The process that reads files: it may die, never this one; it serves one file after the other and ends with this."""

import json
import os
import pickle
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from recording_files import some_recording

from swashtwin.foundation import DataError
from swashtwin.recordings import Options, RawFile, Recording, load_recording, open_raw, write_recording
from swashtwin.recordings.columns import file_stamp
from swashtwin.recordings.formats import csv, subprocess_reader, worker

DEADLY = """
import os, sys, time
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
        if text == "slow":
            self.frames = 3_000_000
    def seek(self, start):
        self.start = start
        time.sleep(0.3 if self.frames > 5 else 0)
    def read(self, count, dtype, always_2d):
        return np.arange(float(self.frames))[self.start : self.start + count, None]
"""
"""A library that dies of some files."""


@pytest.fixture
def read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str], Recording]]:
    """Reads a file of some text by that library."""
    (tmp_path / "soundfile.py").write_text(DEADLY)
    monkeypatch.syspath_prepend(tmp_path)
    subprocess_reader.stop()

    def read_text(text: str) -> Recording:
        path = tmp_path / f"{text}.wav"
        path.write_text(text)
        return load_recording(path, unit="1")

    yield read_text
    subprocess_reader.stop()


def worker_id() -> int:
    assert subprocess_reader._process._popen is not None
    return subprocess_reader._process._popen.pid


def test_a_crash_an_endless_loop_and_too_much_memory_are_one_line_each(
    read: Callable[[str], Recording], monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(DataError, match=r"crash\.wav is damaged: the library that reads it crashed \(signal 6\)"):
        read("crash")
    np.testing.assert_array_equal(read("fine").slice(1, 3).signal[0], [1.0, 2.0])
    before = worker_id()
    monkeypatch.setenv("SWASHTWIN_MEMORY_GB", "1")
    with pytest.raises(DataError, match=r"bomb\.wav .*more than the limit of 1 GB .* set SWASHTWIN_MEMORY_GB"):
        read("bomb")
    assert read("fine").sample_rate == 10.0
    assert worker_id() == before  # refused by the system, and the process goes on
    monkeypatch.setattr(subprocess_reader, "_PATIENCE", 0.6)
    with pytest.raises(DataError, match=r"hang\.wav is damaged: no end was found in 1 s"):
        read("hang")


def test_a_file_that_takes_long_for_each_slice_comes_to_an_end(
    read: Callable[[str], Recording], monkeypatch: pytest.MonkeyPatch
) -> None:
    slow = read("slow")
    slow.slice(0, 1)
    monkeypatch.setattr(subprocess_reader, "_PATIENCE", 3.0)
    slow.slice(0, 1)
    time.sleep(3)
    slow.slice(1, 2)  # only the time of the answers counts
    with pytest.raises(DataError, match=r"slow\.wav is damaged: no end was found in 3 s"):
        [slow.slice(number, number + 1) for number in range(2, 12)]


def test_what_an_earlier_file_broke_is_not_blamed_on_a_later_one(read: Callable[[str], Recording]) -> None:
    read("poison")
    assert read("victim").sample_rate == 10.0


def test_a_changed_byte_in_a_matlab_file_ends_another_process_only(tmp_path: Path) -> None:
    from scipy.io import savemat

    savemat(tmp_path / "a.mat", {"x": np.arange(40.0).reshape(2, 20), "fs": 25600.0, "s": {"a": np.arange(3.0)}})
    content = bytearray((tmp_path / "a.mat").read_bytes())
    for at in (552, 553, 616):
        (tmp_path / "a.mat").write_bytes(content[:at] + b"\xff" + content[at + 1 :])
        try:
            load_recording(tmp_path / "a.mat", unit="1")
        except DataError as error:
            if "a.mat is damaged: the library that reads it crashed" in str(error):
                return
    raise AssertionError("no changed byte crashes the library")


def test_one_process_reads_many_files_and_is_started_anew_when_it_was_killed(tmp_path: Path) -> None:
    recording = some_recording()
    paths = [write_recording(recording, tmp_path / f"a.{suffix}") for suffix in ("h5", "npz", "csv", "wav")]
    loaded = [load_recording(path, unit="m/s^2") for path in paths]
    before = worker_id()
    for each in loaded:
        np.testing.assert_array_equal(each.slice(3, 9).signal, each.signal[:, 3:9])
    assert worker_id() == before
    (fresh,) = [load_recording(paths[1])]
    os.kill(before, signal.SIGKILL)
    np.testing.assert_array_equal(fresh.signal, recording.signal)
    assert worker_id() != before


def test_a_table_of_many_short_columns_is_read_in_a_few_answers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    values = {f"c{number}": np.arange(7.0) + number for number in range(300)}
    np.savez(tmp_path / "wide.npz", **values, x=np.arange(7), fs=np.array(100.0))
    lines, exchange = [], subprocess_reader._Process._exchange

    def counting(process: Any, source: Any, line: bytes, *rest: Any) -> Any:
        lines.append(line)
        return exchange(process, source, line, *rest)

    monkeypatch.setattr(subprocess_reader._Process, "_exchange", counting)
    columns = open_raw(tmp_path / "wide.npz", Options()).columns
    for span in (slice(None), slice(2, 5)):
        for name, samples in values.items():
            np.testing.assert_array_equal(columns[name][span], samples[span])
    assert len(lines) < 10


def test_columns_are_pickled_without_their_samples(tmp_path: Path) -> None:
    recording = load_recording(write_recording(some_recording(), tmp_path / "a.h5"))
    content = pickle.dumps(recording)
    assert len(content) < 4000
    np.testing.assert_array_equal(pickle.loads(content).signal, recording.signal)


ORPHAN = """
import os, signal, sys
from swashtwin.recordings import load_recording
from swashtwin.recordings.formats import subprocess_reader
load_recording(sys.argv[1])
child = os.fork()
if child == 0:
    assert load_recording(sys.argv[1]).signal.shape[0] == 2  # by a process of its own
    os._exit(0)
assert os.waitpid(child, 0)[1] == 0
print(subprocess_reader._process._popen.pid, flush=True)
os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_the_process_ends_with_the_one_that_started_it(tmp_path: Path) -> None:
    path = write_recording(some_recording(), tmp_path / "a.npz")
    run = subprocess.run([sys.executable, "-c", ORPHAN, str(path)], capture_output=True, text=True, check=False)
    assert run.returncode == -signal.SIGKILL, run.stderr
    deadline = time.monotonic() + 5
    while time.monotonic() < deadline:
        try:
            os.kill(int(run.stdout), 0)
        except ProcessLookupError:
            return
        time.sleep(0.05)
    raise AssertionError("the process outlives its parent")


def test_a_file_is_parsed_once_for_its_facts_and_its_samples(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    paths: list[Path] = []
    parse = csv.read

    def counted(path: Path, options: Options) -> RawFile:
        paths.append(path)
        return parse(path, options)

    monkeypatch.setattr(csv, "read", counted)
    monkeypatch.setattr(worker, "_limit_memory", lambda: None)
    files = worker._Files()
    sources = []
    for name in ("a", "b"):
        path = write_recording(some_recording(), tmp_path / f"{name}.csv")
        sources.append({"module": "csv", "function": "read", "path": str(path), "options": {}, "stamp": [0, 0, 0]})
    for _ in range(2):
        assert files.content(sources[0]) is files.content(sources[0])
        files.content(sources[1])
    assert len(paths) == 2
    monkeypatch.setattr(worker, "_BYTES", 0)
    files.content({**sources[1], "stamp": [1, 0, 0]})
    files.content(sources[0])
    assert len(paths) == 4


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="needs the list of open files")
@pytest.mark.parametrize("stays", [True, False])
def test_no_file_stays_open_where_that_blocks_its_deletion(
    stays: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(worker, "_STAY_OPEN", stays)
    monkeypatch.setattr(worker, "_limit_memory", lambda: None)
    monkeypatch.setenv("SWASHTWIN_MEMORY_GB", "4")
    requests, paths = [], []
    for suffix, module in {"h5": "hdf5", "wav": "wav", "tdms": "tdms", "csv": "csv"}.items():
        path = write_recording(some_recording(), tmp_path / f"a.{suffix}").resolve()
        source = {"module": module, "function": "read", "path": str(path), "options": {}, "stamp": file_stamp(path)}
        span = {"part": "", "column": 0, "count": 1, "start": 3, "stop": 9}
        request = {"source": source, "seconds": 30.0, "memory": "4", **span}
        requests.append(json.dumps(request).encode() + b"\n")
        paths.append(path)
    (tmp_path / "requests").write_bytes(b"".join(requests))
    open_files: list[set[Path]] = []

    def note() -> None:
        open_files.append({file.resolve() for file in Path("/proc/self/fd").iterdir()} & set(paths))

    clock = SimpleNamespace(dump_traceback_later=lambda *_, **__: None, cancel_dump_traceback_later=note)
    monkeypatch.setattr(worker, "faulthandler", clock)
    with (tmp_path / "requests").open("rb") as stream, (tmp_path / "answers").open("wb") as answers:
        worker._serve(stream, answers)
    assert (tmp_path / "answers").read_bytes().count(b'"count": 6') == 4
    assert [len(files) for files in open_files] == ([1, 2, 3, 3] if stays else [0, 0, 0, 0])


def test_where_no_limit_can_be_set_the_memory_is_watched(monkeypatch: pytest.MonkeyPatch) -> None:
    class Growing:
        def __init__(self, pid: int) -> None:
            self.rss = 0

        def memory_info(self) -> "Growing":
            self.rss += 3_000_000_000
            return self

    library = SimpleNamespace(Process=Growing, NoSuchProcess=ProcessLookupError)
    monkeypatch.setattr(subprocess_reader, "import_module", lambda name: library)
    process = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
    reader = subprocess_reader._Process()
    reader._watch_memory(process)
    assert reader._excess
    assert process.wait(10) != 0


@pytest.mark.skipif(sys.platform != "linux", reason="the process limits itself on Linux only")
def test_a_lower_limit_of_the_system_is_kept(tmp_path: Path) -> None:
    code = (
        "import resource; from swashtwin.recordings.formats import worker\n"
        "resource.setrlimit(resource.RLIMIT_DATA, (2**31, 2**31)); worker._limit_memory()\n"
        "print(resource.getrlimit(resource.RLIMIT_DATA))"
    )
    process = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert process.stdout.strip() == f"({2**31}, {2**31})"
