"""Files that ask for too much, models whose card or weights were changed and sealed again, trainings in threads."""

import gzip
import json
import os
import resource
import struct
import time
import zipfile
import zlib
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import torch
from numpy.lib import format

from swashtwin import FaultClassifier, Recording
from swashtwin.foundation import MEMORY_VARIABLE, SwashTwinError, read_artifact, write_artifact
from swashtwin.recordings import load_recording, load_recordings, write_recording

Report = Callable[[int, str, str], None]
GIGABYTE = 10**9
_MEMORY_KB = 1_500_000
"""Memory that this process may take in all [KiB]."""


def _zeros(size: int) -> Iterator[bytes]:
    for _ in range(size >> 20):
        yield bytes(1 << 20)


def _npz(path: Path, shape: tuple[int, ...], kind: str, size: int) -> None:
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        archive.open("x.npy", "w", force_zip64=True) as file,
    ):
        format.write_array_header_1_0(file, {"descr": kind, "fortran_order": False, "shape": shape})
        for block in _zeros(size):
            file.write(block)


def _gzip(path: Path, head: bytes, row: bytes, megabytes: int) -> None:
    with gzip.open(path, "wb", compresslevel=1) as file:
        file.write(head)
        for _ in range(megabytes):
            file.write(row * ((1 << 20) // len(row)))


def _hdf5(path: Path, **layout: Any) -> None:
    with h5py.File(path, "w") as file:
        data = file.create_dataset("x", **layout)
        data.attrs.update({"fs": 25600.0, "unit": "g"})


def _huge_chunk(path: Path, count: int) -> None:
    with h5py.File(path, "w") as file:
        data = file.create_dataset("x", (count,), "f8", chunks=(min(count, (1 << 29) - 1),), compression="gzip")
        for start in range(0, count, data.chunks[0]):
            data.id.write_direct_chunk((start,), zlib.compress(bytes(1000)))
        data.attrs.update({"fs": 25600.0, "unit": "g"})


def _matlab(path: Path, elements: list[tuple[int, int]]) -> None:
    """A version 5 file whose compressed variables state `elements`: bytes and samples."""
    content = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM"
    for size, samples in elements:
        body = struct.pack("<II", 14, size) + struct.pack("<IIII", 6, 8, 6, 0)
        body += struct.pack("<IIii", 5, 8, samples, 1) + struct.pack("<HHI", 1, 1, 0x78) + struct.pack("<II", 9, size)
        packed = zlib.compress(body + bytes(1 << 20))
        content += struct.pack("<II", 15, len(packed)) + packed
    path.write_bytes(content)


def _parquet(path: Path, rows: int) -> None:
    import polars

    polars.select(x=polars.repeat(1.5, rows, dtype=polars.Float32)).write_parquet(path, statistics=False)


def _wav(path: Path, **fields: int) -> None:
    write_recording(Recording(np.zeros((2, 600)), 25600.0, "a", channels=("x", "y")), path)
    content = bytearray(path.read_bytes())
    at, data = content.index(b"fmt ") + 8, content.index(b"data") + 4
    places = {"channels": (at + 2, 2), "frame": (at + 12, 2), "bits": (at + 14, 2), "riff": (4, 4), "data": (data, 4)}
    for name, value in fields.items():
        start, size = places[name]
        content[start : start + size] = value.to_bytes(size, "little")
    path.write_bytes(content)


def _patched(path: Path, old: bytes, new: bytes) -> None:
    """A valid file in which a number stands for another."""
    write_recording(Recording(np.zeros((1, 600)), 25600.0, "a", channels=("x",)), path)
    content = path.read_bytes()
    assert old in content, path
    path.write_bytes(content.replace(old, new))


def _text(path: Path, text: bytes) -> None:
    path.write_bytes(text)


BOMBS: tuple[tuple[str, Callable[[Path], None]], ...] = (
    ("ones.npz", lambda path: _npz(path, (150 << 20,), "<f8", 1200 << 20)),
    ("bytes.npz", lambda path: _npz(path, (600 << 20,), "|u1", 600 << 20)),
    ("wide.npz", lambda path: _npz(path, (3, 10**9), "<f8", 1 << 20)),
    ("lie.npz", lambda path: _npz(path, (10**15,), "<f8", 1 << 20)),
    ("negative.npz", lambda path: _npz(path, (-(10**9),), "<f8", 1 << 20)),
    ("many.npz", lambda path: np.savez_compressed(path, **{f"a{n}": np.zeros(500_000) for n in range(100)})),
    ("chunk.h5", lambda path: _huge_chunk(path, (1 << 29) - 1)),
    ("chunks.h5", lambda path: _huge_chunk(path, 10**11)),
    ("fill.h5", lambda path: _hdf5(path, shape=(10**12,), dtype="f8", chunks=(1 << 20,), fillvalue=2.0)),
    ("late.h5", lambda path: _hdf5(path, shape=(10**10,), dtype="f8")),
    ("square.h5", lambda path: _hdf5(path, shape=(10**6, 10**6), dtype="f8", chunks=(1000, 1000))),
    ("deep.h5", lambda path: _hdf5(path, shape=(10**3,) * 6, dtype="f8", chunks=(10,) * 6)),
    ("columns.h5", lambda path: _hdf5(path, data=np.zeros((12_000, 12_001), "i1"), compression="gzip")),
    ("zeros.h5", lambda path: _hdf5(path, data=np.zeros(20_000_000), chunks=(1 << 22,), compression="gzip")),
    ("one.mat", lambda path: _matlab(path, [(9 * 10**9 % (1 << 32), 10**9)])),
    ("most.mat", lambda path: _matlab(path, [((1 << 32) - 64, (1 << 29) - 8)])),
    ("several.mat", lambda path: _matlab(path, [(GIGABYTE, GIGABYTE // 8)] * 12)),
    ("negative.mat", lambda path: _matlab(path, [(1000, -5)])),
    ("rows.parquet", lambda path: _parquet(path, 150_000_000)),
    ("rows.csv.gz", lambda path: _gzip(path, b"x\n", b"0\n", 400)),
    ("time.csv.gz", lambda path: _gzip(path, b"t,x\n0,1\n1,2\n", b"2,3\n", 400)),
    ("line.csv", lambda path: _text(path, b"x,y\n" + b"1" * 200_000_000)),
    ("line.csv.gz", lambda path: _gzip(path, b"", b"1", 400)),
    ("fields.csv", lambda path: _text(path, (b"1," * 20_000_000 + b"1\n") * 2)),
    ("header.csv", lambda path: _text(path, b"# a\n" * 20_000_000 + b"1\n2\n")),
    ("digits.csv", lambda path: _text(path, b"x\n" + b"9" * 1_000_000 + b"\n" + b"1\n" * 50)),
    ("blank.csv", lambda path: _text(path, b"\n" * 100_000_000)),
    ("utf16.csv", lambda path: _text(path, b"\xff\xfe" + b"1\x00" * 40_000_000)),
    ("channels.wav", lambda path: _wav(path, channels=65535, frame=65535)),
    ("data.wav", lambda path: _wav(path, data=0xFFFFFFF0, riff=0xFFFFFFF0)),
    ("bits.wav", lambda path: _wav(path, bits=65528)),
    ("count.tdms", lambda path: _patched(path, struct.pack("<Q", 600), struct.pack("<Q", 10**13))),
    ("count.mf4", lambda path: _patched(path, struct.pack("<Q", 600), struct.pack("<Q", 10**13))),
    ("points.uff", lambda path: _text(path, _UNIVERSAL)),
)
"""Name and writer of each file."""
_UNIVERSAL = (
    b"    -1\n    58\nx\nNONE\nNONE\nNONE\nNONE\n    1         0    0         0 NONE               1   1 NONE"
    b"               0   0\n         4 999999999         1  0.00000e+00  1.00000e-04  0.00000e+00\n"
    + b"        17    0    0    0 NONE                 g\n" * 4
    + b"  1.0\n" * 100
    + b"    -1\n"
)


def bombs(name: str, first: int, count: int, seed: int, folder: Path, report: Report) -> None:
    """Tell the outcome of each file that asks for too much, and of a resampling that does, from number `first` on."""
    os.environ[MEMORY_VARIABLE] = "0.5"
    for number in range(first, first + count):
        path = folder / (BOMBS[number][0] if number < len(BOMBS) else "a.npz")
        if number < len(BOMBS):
            BOMBS[number][1](path)
            facts: dict[str, Any] = {"unit": "g", "sample_rate": "25.6 kHz"}
            if path.suffix in (".h5", ".mf4", ".tdms"):
                facts = {}
        else:
            write_recording(Recording(np.zeros((1, 25600)), 25600.0, "a"), path)
            facts = {"resample": "1e9 Hz"}
        before, began = _memory(), time.monotonic()
        try:
            loaded = load_recording(path, **facts)
            samples = sum(block.n_samples for block in loaded.blocks())
            kind, said = "read", f"{samples} samples"
        except SwashTwinError as error:
            kind, said = ("two_lines" if "\n" in str(error) else "refused"), str(error)
        except Exception as error:  # what is looked for
            kind, said = "exception", f"{type(error).__name__}: {error}"
        if _memory() - before > _MEMORY_KB:
            kind, said = "exception", f"{_memory() - before} KiB taken"
        report(number, kind, f"{path.name}: {said} ({time.monotonic() - began:.1f} s)")
        path.unlink()


def _memory() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def _small_recordings() -> list[Recording]:
    rng = np.random.default_rng(0)
    return [
        Recording(rng.normal(size=(1, 2000)) * scale, 2000.0, f"{label}{number}", label=label, channels=("x",))
        for label, scale in (("normal", 1.0), ("piston", 3.0))
        for number in range(3)
    ]


_VALUES: tuple[Any, ...] = (
    None, -1, 0, 10**9, 10**18, 1e308, "x", "", [], {}, [[]], True, "\x1b[2J", {"a": {"b": []}}, ["x"] * 1000,
)  # fmt: skip


def _paths(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Way to each value within a card."""
    if path:
        yield path
    items = value.items() if isinstance(value, dict) else enumerate(value[:2]) if isinstance(value, list) else ()
    for key, inner in items:
        yield from _paths(inner, (*path, key))


def _hostile_card(card: dict[str, Any], tensors: dict[str, Any], rng: np.random.Generator) -> str:
    """What was changed of a card, or of the weights, in a way that no honest writer does."""
    draw = rng.random()
    if draw < 0.2:
        name = str(rng.choice(sorted(tensors)))
        value = tensors[name]
        kind = int(rng.integers(4))
        if kind == 0:
            del tensors[name]
        elif kind == 1:
            tensors[name] = torch.zeros(3, 1, 2)
        elif kind == 2:
            tensors[name] = torch.full_like(value.to(torch.float32), torch.nan)
        else:
            tensors[name] = value.to(torch.int8)
        return f"tensor {name} {kind}"
    ways = list(_paths(card))
    way = ways[int(rng.integers(len(ways)))]
    holder = card
    for key in way[:-1]:
        holder = holder[key]
    if draw < 0.35 and isinstance(holder, dict):
        del holder[way[-1]]
        return f"no {way}"
    value = _VALUES[int(rng.integers(len(_VALUES)))]
    holder[way[-1]] = value
    return f"{way} = {str(value)[:40]}"


def models(name: str, first: int, count: int, seed: int, folder: Path, report: Report) -> None:
    """Tell the outcome of each hostile model: refused, or it gives finite probabilities, or the same as before."""
    path = folder / "model.safetensors"
    settings: dict[str, Any] = {"epochs": 1, "batch_size": 8, "network_settings": {"channels": (4,)}}
    loaded = load_recordings_of(_small_recordings(), folder)
    classifier = FaultClassifier("bitcn", window=200, seed=0, **settings).fit(loaded)
    classifier.save(path)
    note = {"advice": "save it again", "may_be_nan": None}
    for number in range(first, first + count):
        card, tensors = read_artifact(path, "classifier", _version(path), **note)
        rng = np.random.default_rng([seed, number])
        change = _hostile_card(card, tensors, rng)
        hostile = write_artifact(folder / "h.safetensors", "classifier", _version(path), card, tensors, may_be_nan=None)
        try:
            score = FaultClassifier.load(hostile).predict_proba(loaded)
            kind, said = ("read", "") if np.isfinite(score).all() else ("wrong_samples", "not finite")
        except SwashTwinError as error:
            kind, said = ("two_lines" if "\n" in str(error) else "refused"), str(error)
        except Exception as error:  # what is looked for
            kind, said = "exception", f"{type(error).__name__}: {error}"
        report(number, kind, f"{change}: {said}"[:300])


def _version(path: Path) -> int:
    content = path.read_bytes()
    header = json.loads(content[8 : 8 + int.from_bytes(content[:8], "little")])
    return int(json.loads(header["__metadata__"]["swashtwin"])["version"])


def load_recordings_of(recordings: list[Recording], folder: Path) -> Any:
    """The recordings, from files."""
    files = [write_recording(recording, folder / f"{recording.recording_id}.h5") for recording in recordings]
    return load_recordings(files)


def threads(name: str, first: int, count: int, seed: int, folder: Path, report: Report) -> None:
    """Tell whether each training in one of `count` threads gives the bits of the same training by itself."""
    recordings = load_recordings_of(_small_recordings(), folder)

    def train(number: int) -> bytes:
        settings: dict[str, Any] = {"epochs": 1, "batch_size": 8, "network_settings": {"channels": (4,)}}
        classifier = FaultClassifier("bitcn", window=200, seed=number, **settings).fit(recordings)
        return classifier.predict_proba(recordings).tobytes()

    numbers = range(first, first + count)
    alone = [train(number) for number in numbers]
    with ThreadPoolExecutor(count) as pool:
        together = list(pool.map(train, numbers))
    for number, one, other in zip(numbers, alone, together, strict=True):
        report(number, "same" if one == other else "wrong_samples", "")
