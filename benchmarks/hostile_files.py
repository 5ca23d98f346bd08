"""Small files that ask for too much memory or time."""

import gzip
import os
import resource
import struct
import time
import zipfile
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.lib import format

from swashtwin import Recording
from swashtwin.foundation import MEMORY_VARIABLE, SwashTwinError
from swashtwin.recordings import load_recording, write_recording

Report = Callable[[int, str, str], None]
GIGABYTE = 10**9
MEMORY_KB = 1_500_000
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
        before, began = peak_memory(), time.monotonic()
        try:
            loaded = load_recording(path, **facts)
            samples = sum(block.n_samples for block in loaded.blocks())
            kind, said = "read", f"{samples} samples"
        except SwashTwinError as error:
            kind, said = ("two_lines" if "\n" in str(error) else "refused"), str(error)
        except Exception as error:  # what is looked for
            kind, said = "exception", f"{type(error).__name__}: {error}"
        if peak_memory() - before > MEMORY_KB:
            kind, said = "exception", f"{peak_memory() - before} KiB taken"
        report(number, kind, f"{path.name}: {said} ({time.monotonic() - began:.1f} s)")
        path.unlink()


def peak_memory() -> int:
    """Most memory that this process ever had [KiB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
