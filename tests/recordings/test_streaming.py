"""Recordings longer than memory: written block by block, many to a folder, and taken up again."""

import os
import resource
import shutil
import subprocess
import sys
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


def blocks_of(lengths: tuple[int, ...], *, speed: bool = True, seed: int = 0) -> list[Recording]:
    rng = np.random.default_rng(seed)
    condition = OperatingCondition(speed=rpm(860), discharge_pressure=MPa(15))
    return [
        Recording(
            signal=rng.normal(size=(2, length)),
            sample_rate=1000.0,
            recording_id="a",
            channels=("x", "y"),
            label="normal",
            condition=condition,
            speed=rng.uniform(80, 90, length) if speed else None,
            synthetic=True,
        )
        for length in lengths
    ]


# ---- one file


@pytest.mark.parametrize("speed", [True, False])
@pytest.mark.parametrize("lengths", [(5,), (16384, 16384, 1), (20000, 7, 30000)])
def test_a_file_written_block_by_block_reads_as_one_written_whole(
    tmp_path: Path, lengths: tuple[int, ...], speed: bool
) -> None:
    blocks = blocks_of(lengths, speed=speed)
    facts = write_blocks(iter(blocks), tmp_path / "stream.h5")
    streamed = load_recording(tmp_path / "stream.h5")
    whole = load_recording(write_recording(join_blocks(blocks), tmp_path / "whole.h5"))
    np.testing.assert_array_equal(streamed.signal, whole.signal)
    assert (streamed.speed is not None) == speed
    if speed:
        np.testing.assert_array_equal(streamed.speed, whole.speed)
    for name in FACTS:
        assert (
            getattr(streamed, name)
            == getattr(whole, name)
            == getattr(facts, name)
            == getattr(blocks[0], name)
        )
    assert facts.n_samples == sum(lengths)


def test_the_speed_survives_the_index_and_a_resampling(tmp_path: Path) -> None:
    (block,) = blocks_of((1000,))
    block = replace(block, speed=80 + 10 * block.time)
    path = write_recording(block, tmp_path / "a.h5")
    np.testing.assert_array_equal(load_recording(path).speed, block.speed)
    halved = load_recording(path, resample="500 Hz")
    np.testing.assert_allclose(halved.speed, 80 + 10 * halved.time)


@pytest.mark.parametrize(
    ("number", "advice"), [(1, "make it again"), (2, "make it again"), (4, "a newer swashtwin")]
)
def test_a_recording_of_another_version_is_refused_by_both_names(
    tmp_path: Path, number: int, advice: str
) -> None:
    (block,) = blocks_of((10,))
    with h5py.File(write_recording(block, tmp_path / "a.h5"), "r+") as file:
        assert file.attrs["format"] == b"swashtwin recording 3"
        file.attrs["format"] = np.bytes_(f"swashtwin recording {number}".encode())
    for load in (load_recording, load_recordings):
        with pytest.raises(
            ArtifactError,
            match=f"format 'swashtwin recording {number}', .* reads 'swashtwin recording 3'; .*{advice}",
        ):
            load(tmp_path / "a.h5")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"sample_rate": 500.0}, "sample_rate 500.0, the first one 1000.0"),
        ({"channels": ("x", "z")}, "channels"),
        ({"recording_id": "b"}, "recording_id 'b'"),
        ({"speed": None}, "only some blocks have a speed"),
    ],
)
def test_a_block_that_does_not_continue_the_first_is_refused(
    tmp_path: Path, change: dict[str, Any], message: str
) -> None:
    first, second = blocks_of((10, 10))
    for join in (join_blocks, lambda blocks: write_blocks(blocks, tmp_path / "a.h5")):
        with pytest.raises(DataError, match=message):
            join([first, replace(second, **change)])
    assert not list(tmp_path.iterdir())


def test_no_block_is_no_recording(tmp_path: Path) -> None:
    for join in (join_blocks, lambda blocks: write_blocks(blocks, tmp_path / "a.h5")):
        with pytest.raises(DataError, match="no block"):
            join([])
    with pytest.raises(InputError, match="cannot be written block by block"):
        write_blocks(blocks_of((10,)), tmp_path / "a.wav")
    assert not list(tmp_path.iterdir())


FAILING = """
import sys, numpy as np
from pathlib import Path
from swashtwin.recordings import write_blocks
from swashtwin.recordings import Recording
blocks = (Recording(np.full((2, 20000), float(i)), 1000.0, "a", channels=("x", "y")) for i in range(20))
try:
    write_blocks(blocks, Path("a.h5"))
except OSError as error:
    print(error.strerror)
"""


@pytest.mark.parametrize("limit", [100, 5000, 700_000, -100])
def test_a_disk_that_fills_up_leaves_the_old_file_and_no_complaint(
    tmp_path: Path, limit: int
) -> None:
    """In the header, the first block, among the blocks, and when the file is closed."""
    if limit < 0:
        blocks = (
            Recording(np.full((2, 20000), float(i)), 1000.0, "a", channels=("x", "y"))
            for i in range(20)
        )
        write_blocks(blocks, tmp_path / "a.h5")
        limit += (tmp_path / "a.h5").stat().st_size
    (tmp_path / "a.h5").write_text("old")
    process = subprocess.run(
        [sys.executable, "-B", "-c", FAILING],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(SOURCES)},
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
        capture_output=True,
        text=True,
        check=False,
    )
    assert (process.returncode, process.stdout, process.stderr) == (0, "File too large\n", "")
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("a.h5", "old")]


# ---- the twin's blocks


def test_blocks_of_a_steady_twin_are_its_simulation_bit_for_bit(
    pump: Pump, at_15: OperatingCondition, monkeypatch: pytest.MonkeyPatch
) -> None:
    twin = Twin(pump, at_15, bandwidth=1000)
    monkeypatch.setattr(model, "BLOCK_SAMPLES", 1000)
    blocks = list(twin.blocks(0.8, 6400.0, phase=0.3, recording_id="r"))
    whole = twin.simulate(0.8, 6400.0, phase=0.3, recording_id="r")
    assert len(blocks) == 6
    together = join_blocks(blocks)
    np.testing.assert_array_equal(together.signal, whole.signal)
    for name in (*FACTS, "speed"):
        assert getattr(together, name) == getattr(whole, name)


def test_blocks_of_no_sample_or_too_few_are_refused(pump: Pump, at_15: OperatingCondition) -> None:
    twin = Twin(pump, at_15)
    with pytest.raises(InputError, match="at least one sample"):
        list(twin.blocks(1e-6, 25600.0))
    with pytest.raises(InputError, match="twice the twin's bandwidth"):
        list(twin.blocks(1.0, 8000.0))


# ---- many files


class SeriesRun(NamedTuple):
    """A run of a series, which notes the recordings that it was asked for."""

    blocks: list[int]

    def blocks_of(self, number: int) -> list[Recording]:
        self.blocks.append(number)
        return blocks_of((300, 200), seed=number)


def test_a_series_is_a_folder_with_an_index(tmp_path: Path) -> None:
    run, progress = SeriesRun([]), []
    index, ids = write_series(
        tmp_path / "runs", 3, run.blocks_of, settings={"seed": 0}, bytes_each=9000,
        progress=lambda *counts: progress.append(counts),
    )  # fmt: skip
    loaded = load_recordings(index)
    assert (
        [recording.recording_id for recording in loaded]
        == ids
        == ["runs-0000", "runs-0001", "runs-0002"]
    )
    assert progress == [(0, 3), (1, 3), (2, 3), (3, 3)]
    for number, recording in enumerate(loaded):
        np.testing.assert_array_equal(
            recording.signal, join_blocks(blocks_of((300, 200), seed=number)).signal
        )


def test_a_disk_without_space_is_refused_before_the_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr(
        shutil, "disk_usage", lambda path: usage._replace(free=2_000_000_000 + (1 << 24))
    )
    run = SeriesRun([])
    with pytest.raises(InputError, match=r"has 2 GB free, and 3 such recordings take 2\.1 GB"):
        write_series(tmp_path / "runs", 3, run.blocks_of, settings={}, bytes_each=700_000_000)
    assert not run.blocks
