"""Recordings longer than memory are written block by block, and many of them to a folder."""

import os
import resource
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np
import pytest

import swashtwin
from swashtwin.foundation import ArtifactError, DataError, InputError, MPa, rpm
from swashtwin.physics import Twin
from swashtwin.physics.twin import model
from swashtwin.pump import OperatingCondition, Pump
from swashtwin.recordings import (
    Recording,
    join_blocks,
    load_recording,
    load_recordings,
    write_blocks,
    write_recording,
    write_series,
)

SOURCES = Path(swashtwin.__file__).parents[1]

# Facts of a recording, besides its samples.
FACTS = (
    "sample_rate",
    "recording_id",
    "channels",
    "unit",
    "label",
    "condition",
    "specimen",
    "synthetic",
)


def blocks_of(
    lengths: tuple[int, ...], *, has_speed: bool = True, seed: int = 0
) -> list[Recording]:
    """Return consecutive blocks of noise with these numbers of samples."""
    rng = np.random.default_rng(seed)
    return [
        Recording(
            signal=rng.normal(size=(2, length)),
            sample_rate=1000.0,
            recording_id="a",
            channels=("x", "y"),
            label="normal",
            condition=OperatingCondition(speed=rpm(860), discharge_pressure=MPa(15)),
            speed=rng.uniform(80, 90, length) if has_speed else None,
            synthetic=True,
        )
        for length in lengths
    ]


# ---- one file

BLOCK_LENGTHS = pytest.mark.parametrize(
    "lengths",
    [
        pytest.param((5,), id="less than a chunk"),
        # a chunk of the file has 16384 samples
        pytest.param((16384, 16384, 1), id="whole chunks"),
        pytest.param((20000, 7, 30000), id="parts of chunks"),
    ],
)


@BLOCK_LENGTHS
@pytest.mark.parametrize("has_speed", [True, False], ids=["speed", "no speed"])
def test_a_file_written_block_by_block_holds_the_facts_of_its_blocks(
    tmp_path: Path, lengths: tuple[int, ...], has_speed: bool
) -> None:
    blocks = blocks_of(lengths, has_speed=has_speed)

    facts = write_blocks(iter(blocks), tmp_path / "stream.h5")

    streamed = load_recording(tmp_path / "stream.h5")
    assert facts.n_samples == sum(lengths)
    for name in FACTS:
        expected = getattr(blocks[0], name)
        assert getattr(facts, name) == expected
        assert getattr(streamed, name) == expected


@BLOCK_LENGTHS
@pytest.mark.parametrize("has_speed", [True, False], ids=["speed", "no speed"])
def test_a_file_written_block_by_block_reads_as_one_written_whole(
    tmp_path: Path, lengths: tuple[int, ...], has_speed: bool
) -> None:
    blocks = blocks_of(lengths, has_speed=has_speed)

    write_blocks(iter(blocks), tmp_path / "stream.h5")
    write_recording(join_blocks(blocks), tmp_path / "whole.h5")

    streamed = load_recording(tmp_path / "stream.h5")
    whole = load_recording(tmp_path / "whole.h5")
    np.testing.assert_array_equal(streamed.signal, whole.signal)
    for name in FACTS:
        assert getattr(streamed, name) == getattr(whole, name)

    assert (streamed.speed is not None) == has_speed
    if has_speed:
        np.testing.assert_array_equal(streamed.speed, whole.speed)


def test_the_speed_survives_a_file_and_a_resampling(tmp_path: Path) -> None:
    (block,) = blocks_of((1000,))
    block = replace(block, speed=80 + 10 * block.time)

    path = write_recording(block, tmp_path / "a.h5")

    np.testing.assert_array_equal(load_recording(path).speed, block.speed)
    halved = load_recording(path, resample="500 Hz")
    np.testing.assert_allclose(halved.speed, 80 + 10 * halved.time)


@pytest.mark.parametrize("load", [load_recording, load_recordings])
@pytest.mark.parametrize(
    ("version", "advice"), [(1, "make it again"), (2, "make it again"), (4, "a newer swashtwin")]
)
def test_a_file_of_another_version_is_refused_with_what_to_do(
    tmp_path: Path, version: int, advice: str, load: Callable[[Path], object]
) -> None:
    (block,) = blocks_of((10,))
    path = write_recording(block, tmp_path / "a.h5")
    with h5py.File(path, "r+") as file:
        assert file.attrs["format"] == b"swashtwin recording 3"
        file.attrs["format"] = np.bytes_(f"swashtwin recording {version}".encode())

    message = (
        f"format 'swashtwin recording {version}', .* reads 'swashtwin recording 3'; .*{advice}"
    )
    with pytest.raises(ArtifactError, match=message):
        load(path)


# ---- blocks that make no recording

BlockConsumer = Callable[[list[Recording], Path], object]
BLOCK_CONSUMERS = pytest.mark.parametrize(
    "consume",
    [
        pytest.param(lambda blocks, path: join_blocks(blocks), id="join"),
        pytest.param(write_blocks, id="write"),
    ],
)


@BLOCK_CONSUMERS
@pytest.mark.parametrize(
    ("change", "message"),
    [
        pytest.param(
            {"sample_rate": 500.0}, "sample_rate 500.0, the first one 1000.0", id="sample rate"
        ),
        pytest.param({"channels": ("x", "z")}, "channels", id="channels"),
        pytest.param({"recording_id": "b"}, "recording_id 'b'", id="recording id"),
        pytest.param({"speed": None}, "only some blocks have a speed", id="no speed"),
    ],
)
def test_a_block_that_does_not_continue_the_first_is_refused(
    tmp_path: Path, change: dict[str, Any], message: str, consume: BlockConsumer
) -> None:
    first, second = blocks_of((10, 10))

    with pytest.raises(DataError, match=message):
        consume([first, replace(second, **change)], tmp_path / "a.h5")

    assert not list(tmp_path.iterdir())


@BLOCK_CONSUMERS
def test_no_block_is_refused(tmp_path: Path, consume: BlockConsumer) -> None:
    with pytest.raises(DataError, match="no block"):
        consume([], tmp_path / "a.h5")

    assert not list(tmp_path.iterdir())


def test_blocks_for_a_format_that_cannot_grow_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be written block by block"):
        write_blocks(blocks_of((10,)), tmp_path / "a.wav")

    assert not list(tmp_path.iterdir())


# ---- a full disk

WRITE_TWENTY_BLOCKS = """
import numpy as np
from pathlib import Path
from swashtwin.recordings import Recording, write_blocks

blocks = (
    Recording(np.full((2, 20000), float(number)), 1000.0, "a", channels=("x", "y"))
    for number in range(20)
)
try:
    write_blocks(blocks, Path("a.h5"))
except OSError as error:
    print(error.strerror)
"""


def write_twenty_blocks(folder: Path, max_file_bytes: int) -> "subprocess.CompletedProcess[str]":
    """Write a.h5 in a process whose files cannot exceed a size, as on a disk that is full."""
    limits = (max_file_bytes, max_file_bytes)
    return subprocess.run(
        [sys.executable, "-B", "-c", WRITE_TWENTY_BLOCKS],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(SOURCES)},
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, limits),
        capture_output=True,
        text=True,
        check=False,
    )


def assert_old_file_survives(folder: Path, max_file_bytes: int) -> None:
    (folder / "a.h5").write_text("old")

    process = write_twenty_blocks(folder, max_file_bytes)

    # HDF5 prints a trace of its own unless it is silenced
    assert (process.returncode, process.stdout, process.stderr) == (0, "File too large\n", "")
    contents = {path.name: path.read_text() for path in folder.iterdir()}
    assert contents == {"a.h5": "old"}


@pytest.mark.parametrize(
    "max_file_bytes",
    [
        pytest.param(100, id="in the header"),
        pytest.param(5000, id="in the first block"),
        pytest.param(700_000, id="between blocks"),
    ],
)
def test_a_disk_that_fills_up_leaves_the_old_file(tmp_path: Path, max_file_bytes: int) -> None:
    assert_old_file_survives(tmp_path, max_file_bytes)


def test_a_disk_that_fills_up_when_a_file_is_closed_leaves_the_old_file(tmp_path: Path) -> None:
    # HDF5 writes its last tables when it closes a file.
    write_twenty_blocks(tmp_path, resource.RLIM_INFINITY)
    complete_size = (tmp_path / "a.h5").stat().st_size

    assert_old_file_survives(tmp_path, complete_size - 100)


# ---- blocks of the twin


def test_blocks_of_a_steady_twin_are_its_simulation_bit_for_bit(
    pump: Pump, at_15: OperatingCondition, monkeypatch: pytest.MonkeyPatch
) -> None:
    twin = Twin(pump, at_15, bandwidth=1000)
    monkeypatch.setattr(model, "BLOCK_SAMPLES", 1000)

    blocks = list(twin.blocks(0.8, 6400.0, phase=0.3, recording_id="r"))
    whole = twin.simulate(0.8, 6400.0, phase=0.3, recording_id="r")

    # 0.8 s are 5120 samples
    assert len(blocks) == 6
    joined = join_blocks(blocks)
    np.testing.assert_array_equal(joined.signal, whole.signal)
    for name in (*FACTS, "speed"):
        assert getattr(joined, name) == getattr(whole, name)


def test_blocks_of_less_than_a_sample_are_refused(pump: Pump, at_15: OperatingCondition) -> None:
    with pytest.raises(InputError, match="at least one sample"):
        list(Twin(pump, at_15).blocks(1e-6, 25600.0))


def test_blocks_at_a_rate_too_low_for_the_bandwidth_are_refused(
    pump: Pump, at_15: OperatingCondition
) -> None:
    with pytest.raises(InputError, match="twice the twin's bandwidth"):
        list(Twin(pump, at_15).blocks(1.0, 8000.0))


# ---- many files


class SeriesRun(NamedTuple):
    """A run of a series that collects the numbers of the recordings that were requested."""

    requested_numbers: list[int]

    def blocks_of(self, number: int) -> list[Recording]:
        self.requested_numbers.append(number)
        return blocks_of((300, 200), seed=number)


def test_a_series_is_a_folder_with_an_index(tmp_path: Path) -> None:
    run = SeriesRun([])
    progress: list[tuple[int, ...]] = []

    index, ids = write_series(
        tmp_path / "runs",
        3,
        run.blocks_of,
        settings={"seed": 0},
        bytes_each=9000,
        progress=lambda *counts: progress.append(counts),
    )

    assert ids == ["runs-0000", "runs-0001", "runs-0002"]
    assert progress == [(0, 3), (1, 3), (2, 3), (3, 3)]

    loaded = load_recordings(index)
    assert [recording.recording_id for recording in loaded] == ids
    for number, recording in enumerate(loaded):
        expected = join_blocks(blocks_of((300, 200), seed=number))
        np.testing.assert_array_equal(recording.signal, expected.signal)


def test_a_series_larger_than_the_free_space_is_refused_before_it_starts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # 2 GB, and the 16 MiB that always stay free
    usage = shutil.disk_usage(tmp_path)._replace(free=2_000_000_000 + (1 << 24))
    monkeypatch.setattr(shutil, "disk_usage", lambda path: usage)
    run = SeriesRun([])

    with pytest.raises(InputError, match=r"has 2 GB free, and 3 such recordings take 2\.1 GB"):
        write_series(tmp_path / "runs", 3, run.blocks_of, settings={}, bytes_each=700_000_000)

    assert not run.requested_numbers
