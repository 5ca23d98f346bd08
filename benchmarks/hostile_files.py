"""Damaged, lying and greedy files for the readers of recordings, and what comes of reading one of
them.

Of the files of each format three quarters are damaged (bytes changed, left out, repeated; files cut
off), and one quarter is whole but lies: rates, units, shapes and number types that cannot be or
contradict. `BOMBS` are small files that ask for too much memory or time.

A file must be refused in one line by a SwashTwinError, or read with the rate, the unit, the length
and the samples that it states. A damaged file of a format without a checksum may hold other
samples, but not another rate. Two exceptions are counted apart as `resolve_sample_rate`:

- HDF5 files of the layout that MATLAB and many other programs write, and uncompressed MATLAB files.
  Nothing in them has a checksum. Changed bytes (not missing ones) that state the rate, or its
  address in the file, are therefore detected only if the rate is absurd.
- TDMS files of which only one channel remains, so that no other channel contradicts it.
"""

import gzip
import os
import resource
import struct
import warnings
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.lib import format as npy

from swashtwin.foundation import MEMORY_VARIABLE, SwashTwinError
from swashtwin.recordings import (
    Recording,
    join_blocks,
    load_recording,
    load_recordings,
    write_recording,
    write_store,
)

RATE = 25600.0
TELLS_ONCE = ("mat73", "hdf5_foreign", "mat5_plain")
"""Formats whose rate stands in one place, found by addresses, and of which nothing has a
checksum.
"""
CHECKED = ("csv_gz", "text_gz", "mat5", "hdf5", "store", "npz")
"""Formats with checksums of everything, which must never be read as anything else than what was
written.
"""
SILENT = ("wrong_rate", "wrong_samples", "wrong_unit")
FAILURES = (*SILENT, "exception", "two_lines", "crash", "hang")
MEMORY_KB = 1_500_000
"""Memory that a process may take with a greedy file [KiB]."""
LYING = 4
"""Each so many files one is whole and lies."""
STATES_UNIT = (
    "csv",
    "csv_gz",
    "mat5",
    "mat5_plain",
    "hdf5",
    "hdf5_foreign",
    "tdms",
    "uff",
    "parquet",
    "npz",
    "mdf",
    "store",
)
"""Formats that state the unit."""
_WORDS = (
    b"\x00" * 4,
    b"\xff" * 4,
    b"\xff\xff\xff\x7f",
    b"\x00\x00\x00\x80",
    b"\x01\x00\x00\x00",
    b"\xff" * 8,
)


def recording() -> Recording:
    """What every file holds."""
    signal = np.random.default_rng(0).standard_normal((2, 60))
    return Recording(
        signal, RATE, "a", channels=("x", "y"), label="normal", attributes={"sensor": "352C33"}
    )


def _plain(suffix: str) -> Callable[[Path], Path]:
    return lambda folder: write_recording(recording(), folder / f"a.{suffix}")


def _gzipped(folder: Path) -> Path:
    text = write_recording(recording(), folder / "b.csv").read_bytes()
    (folder / "a.csv.gz").write_bytes(gzip.compress(text))
    return folder / "a.csv.gz"


def _header_lines(folder: Path) -> Path:
    rows = zip(recording().time, *recording().signal, strict=True)
    lines = ""
    for row in rows:
        lines += "\t".join(f"{value:.10f}" for value in row) + "\n"
    text = (
        "%\n% Convert TDMS to ASCII\n% File created on 10-4-2026\n%\n\n"
        "Time     \tch 0     \tch 1     \n" + lines
    )
    (folder / "a.dat.gz").write_bytes(gzip.compress(text.encode()))
    return folder / "a.dat.gz"


def _matlab_7_3(folder: Path) -> Path:
    path = folder / "a.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, value in {"x": recording().signal, "fs": np.array([[RATE]])}.items():
            file[name] = value
            file[name].attrs["MATLAB_class"] = np.bytes_("double")
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(116) + bytes(8) + b"\x00\x02IM")
    return path


def _matlab_plain(folder: Path) -> Path:
    from scipy.io import savemat

    first, second = recording().signal
    content = {
        "x": first,
        "y": second,
        "fs": RATE,
        "unit": "g",
        "rig": {"note": "352C33", "levels": np.arange(3.0)},
    }
    savemat(folder / "a.mat", content, do_compression=False)
    return folder / "a.mat"


def _foreign(folder: Path) -> Path:
    with h5py.File(folder / "a.h5", "w") as file:
        file["acc"] = recording().signal
        file["acc"].attrs.update({"fs": RATE, "unit": "g"})
    return folder / "a.h5"


def _write_universal(
    path: Path, rows: list[np.ndarray], rates: list[float | None], units: list[str]
) -> Path:
    import pyuff

    steps = [0.0 if rate is None else float(np.divide(1.0, rate)) for rate in rates]
    sets = [
        pyuff.prepare_58(
            id1=f"s{number}",
            func_type=1,
            rsp_node=number,
            rsp_dir=1,
            ref_node=0,
            ref_dir=0,
            ord_data_type=4,
            num_pts=len(row),
            abscissa_spacing=1,
            abscissa_min=0.0,
            abscissa_inc=step,
            abscissa_spec_data_type=17,
            ordinate_spec_data_type=12,
            orddenom_spec_data_type=0,
            ordinate_axis_units_lab=unit[:20],
            data=row,
            x=np.arange(len(row)) * step,
        )
        for number, (row, step, unit) in enumerate(zip(rows, steps, units, strict=True))
    ]
    pyuff.UFF(str(path)).write_sets(sets, mode="overwrite")
    return path


FORMATS: dict[str, Callable[[Path], Path]] = {
    "csv": _plain("csv"),
    "csv_gz": _gzipped,
    "text_gz": _header_lines,
    "mat5": _plain("mat"),
    "mat5_plain": _matlab_plain,
    "mat73": _matlab_7_3,
    "hdf5": _plain("h5"),
    "hdf5_foreign": _foreign,
    "store": lambda folder: write_store([recording()], folder / "a.h5"),
    "wav": _plain("wav"),
    "tdms": _plain("tdms"),
    "uff": lambda folder: _write_universal(
        folder / "a.uff", [*recording().signal], [RATE] * 2, ["g"] * 2
    ),
    "parquet": _plain("parquet"),
    "npz": _plain("npz"),
    "mdf": _plain("mf4"),
}
"""Writer of a valid file of each format."""


def mutated(content: bytes, generator: np.random.Generator) -> bytes:
    """`content` cut off, or with some of its bytes changed, left out, repeated or set to telling
    values.
    """
    kind = generator.integers(0, 10)
    if kind < 3:
        return content[: int(generator.integers(0, len(content)))]
    changed = bytearray(content)
    reach = (
        len(changed) if generator.random() < 0.5 else min(400, len(changed))
    )  # half of them in the header
    at = int(generator.integers(0, reach))
    size = int(2 ** generator.uniform(0, np.log2(max(2, len(content) // 4))))
    if kind < 7:
        for offset in generator.integers(0, reach, int(generator.integers(1, 12))):
            changed[offset] = (
                int(generator.integers(0, 256))
                if kind < 6
                else changed[offset] ^ (1 << generator.integers(8))
            )
    elif kind == 7:
        word = _WORDS[generator.integers(0, len(_WORDS))]
        changed[at : at + len(word)] = word
    elif kind == 8:
        del changed[at : at + size]
    else:
        changed[at:at] = changed[at : at + size]
    return bytes(changed)


def attempt(
    name: str, path: Path, *, in_blocks: bool
) -> tuple[Recording, np.ndarray] | tuple[str, str]:
    """Recording of a file and its samples, read with what the format cannot state; or the error's
    kind and message.
    """
    facts = {} if name in STATES_UNIT else {"unit": "1" if name != "wav" else "m/s^2"}
    channels = {"channels": ["x", "y"]} if name == "mat5_plain" and path.name != "lie.mat" else {}
    try:
        result = (
            load_recordings(path)[0]
            if name == "store"
            else load_recording(path, **facts, **channels)
        )
        return result, join_blocks(result.blocks()).signal if in_blocks else result.signal
    except Exception as error:  # what is looked for
        return _kind_of(error)


def _kind_of(error: Exception) -> tuple[str, str]:
    if isinstance(error, SwashTwinError):
        return ("two_lines" if "\n" in str(error) else "refused"), str(error)
    return "exception", f"{type(error).__name__}: {error}"


def outcome(name: str, path: Path, original: bytes, *, in_blocks: bool) -> tuple[str, str]:
    """Class of what came of reading a mutated file, and the message."""
    result, signal = attempt(name, path, in_blocks=in_blocks)
    if isinstance(result, str):
        return result, str(signal)
    assert isinstance(signal, np.ndarray)
    if abs(result.sample_rate / RATE - 1) > 1e-6:
        unchecked = name in TELLS_ONCE and len(path.read_bytes()) >= len(original)
        alone = (
            name == "tdms" and result.n_channels == 1
        )  # the one whose rate would contradict is lost as well
        return ("stated_rate" if unchecked or alone else "wrong_rate"), f"{result.sample_rate:g} Hz"
    if name in CHECKED and not np.allclose(signal, recording().signal, rtol=0, atol=1e-9):
        return "wrong_samples", f"{signal.shape}"
    if name in CHECKED and result.unit not in ("1", "m/s^2"):
        return "wrong_unit", result.unit
    return "same" if signal.shape == (2, 60) and path.read_bytes() == original else "read", ""


@dataclass(frozen=True)
class Truth:
    """What a reader may get from a file."""

    signal: np.ndarray
    rate: float
    unit: str


def outcome_of_lie(
    name: str, path: Path, truth: Truth | None, *, in_blocks: bool
) -> tuple[str, str]:
    """Class of what came of reading a lying file, and the message."""
    result, signal = attempt(name, path, in_blocks=in_blocks)
    if isinstance(result, str):
        return result, str(signal)
    assert isinstance(signal, np.ndarray)
    if truth is None:
        return (
            "wrong_samples",
            f"read at {result.sample_rate:g} Hz in {result.unit}, but contradicts itself",
        )
    if not abs(result.sample_rate / truth.rate - 1) <= 1e-5:
        return "wrong_rate", f"{result.sample_rate:g} Hz, not {truth.rate:g} Hz"
    if result.unit != truth.unit:
        return "wrong_unit", f"{result.unit!r}, not {truth.unit!r}"
    if signal.shape != truth.signal.shape or not np.allclose(
        signal, truth.signal, rtol=1e-6, atol=1e-9
    ):
        return "wrong_samples", f"{signal.shape}, not {truth.signal.shape}"
    return "read", ""


FACTORS = {"g": 9.80665, "m/s^2": 1.0, "mm/s^2": 1e-3, "mg": 9.80665e-3, "Pa": 1.0, "V": 1.0}
"""What one of each unit is in the unit that a reader gives."""
_UNKNOWN_UNITS = ("bananas", "\x1b[31mg", "=1+1", "g" * 500)
"""Units that a reader does not know: a column in one of them is left out beside accelerations."""
_JUNK = (*_UNKNOWN_UNITS, "", "none")
_RATES = (25600.0, 12800.0, 51200 / 3, 1000.0)
_ABSURD = (0.0, -25600.0, float("nan"), float("inf"), 1e12, 1e-9, None)
_NAMES = (
    "x",
    "y",
    "z",
    "../../etc/passwd",
    "a\x1b[2Jb",
    "e\u0301",
    "\u202egnp",
    "-1",
    "=1+1",
    "n" * 300,
)
_TYPES = ("<f8", ">f8", "<f4", "<i2", ">i4", "<u1", "<i8")


@dataclass(frozen=True)
class Case:
    """Channels and what is stated of each."""

    names: list[str]
    values: list[np.ndarray]
    rates: list[float | None]
    units: list[str]

    def truth(self) -> Truth | None:
        """What may be read; None where the file must be refused. Accelerations go before other
        quantities.
        """
        vibration = [
            number
            for number, unit in enumerate(self.units)
            if unit in FACTORS and unit not in ("Pa", "V")
        ]
        if (
            vibration
            and len(vibration) < len(self.units)
            and all(unit in FACTORS or unit in _UNKNOWN_UNITS for unit in self.units)
        ):
            columns = (self.names, self.values, self.rates, self.units)
            return Case(*([column[number] for number in vibration] for column in columns)).truth()  # type: ignore[arg-type]
        rate, lengths = self.rates[0], {len(values) for values in self.values}
        units = {"m/s^2" if unit not in ("Pa", "V") else unit for unit in self.units}
        plausible = isinstance(rate, float) and 1e-3 <= rate <= 1e9 and len(set(self.rates)) == 1
        if (
            not plausible
            or len(lengths) > 1
            or len(units) > 1
            or any(unit not in FACTORS for unit in self.units)
        ):
            return None
        assert rate is not None
        rows = [
            FACTORS[unit] * values.astype(float)
            for unit, values in zip(self.units, self.values, strict=True)
        ]
        return Truth(np.stack(rows), rate, units.pop())


def case(
    rng: np.random.Generator, *, types: tuple[str, ...] = _TYPES, same_length: bool = False
) -> Case:
    """Channels of which something may be wrong."""
    count = int(rng.integers(1, 4))
    names = [str(name) for name in rng.choice(_NAMES, count, replace=False)]
    lengths = (
        [60] * count
        if same_length or rng.random() < 0.85
        else [int(n) for n in rng.integers(5, 70, count)]
    )
    kind = str(rng.choice(types))
    values = [
        np.round(20 * rng.standard_normal(length)).clip(0, 200).astype(kind) for length in lengths
    ]
    draw = rng.random()
    rates: list[float | None] = [float(rng.choice(_RATES))] * count
    if draw > 0.75:
        rates[int(rng.integers(count))] = _ABSURD[int(rng.integers(len(_ABSURD)))]
    elif draw > 0.5:
        rates = [float(rate) for rate in rng.choice(_RATES, count)]
    draw = rng.random()
    units = [str(rng.choice(list(FACTORS)))] * count
    if draw > 0.85:
        units[int(rng.integers(count))] = str(rng.choice(_JUNK))
    elif draw > 0.65:
        units = [str(unit) for unit in rng.choice(list(FACTORS), count)]
    return Case(names, values, rates, units)


def _stated(rate: float | None, name: str = "fs") -> dict[str, float]:
    return {} if rate is None else {name: rate}


def _archive_lie(folder: Path, rng: np.random.Generator) -> tuple[Path, Truth | None]:
    lie = case(rng)
    content: dict[str, Any] = {}
    for number, (values, rate, unit) in enumerate(
        zip(lie.values, lie.rates, lie.units, strict=True)
    ):
        content |= {f"s{number}": values, f"s{number}_unit": unit, **_stated(rate, f"s{number}_fs")}
    np.savez(folder / "lie.npz", **content)
    return folder / "lie.npz", lie.truth()


def _matlab_lie(folder: Path, rng: np.random.Generator) -> tuple[Path, Truth | None]:
    from scipy.io import savemat

    lie = case(rng)
    content = {
        f"s{number}": {"x": values, "unit": unit, **_stated(rate)}
        for number, (values, rate, unit) in enumerate(
            zip(lie.values, lie.rates, lie.units, strict=True)
        )
    }
    savemat(folder / "lie.mat", content, do_compression=bool(rng.random() < 0.5))
    return folder / "lie.mat", lie.truth()


def _foreign_lie(folder: Path, rng: np.random.Generator) -> tuple[Path, Truth | None]:
    lie, truth = case(rng), None
    damage = str(rng.choice(["none", "none", "none", "unwritten", "virtual", "external", "link"]))
    with h5py.File(folder / "lie.h5", "w") as file:
        for number, (values, rate, unit) in enumerate(
            zip(lie.values, lie.rates, lie.units, strict=True)
        ):
            name, chunk = f"g{number}/x", int(rng.integers(1, 100))
            extra: dict[str, Any] = {}
            if rng.random() < 0.5:
                extra = {"chunks": (min(chunk, len(values)),), "compression": "gzip"}
            if number == 0 and damage == "virtual":
                layout = h5py.VirtualLayout(values.shape, values.dtype)
                layout[:] = h5py.VirtualSource("absent.h5", "x", values.shape)
                data = file.create_virtual_dataset(name, layout)
            elif number == 0 and damage == "external":
                data = file.create_dataset(
                    name, values.shape, values.dtype, external=[("absent.bin", 0, values.nbytes)]
                )
            elif number == 0 and damage == "unwritten":
                data = file.create_dataset(name, values.shape, values.dtype, chunks=(3,))
            else:
                data = file.create_dataset(name, data=values, **extra)
            holder = data if rng.random() < 0.5 else data.parent
            holder.attrs.update(_stated(rate))
            data.attrs["unit"] = unit
        if damage == "link":
            file["elsewhere"] = h5py.ExternalLink("absent.h5", "x")
        truth = lie.truth() if damage == "none" else None
    return folder / "lie.h5", truth


def _measurement_lie(folder: Path, rng: np.random.Generator) -> tuple[Path, Truth | None]:
    import nptdms

    lie = case(rng, types=("<f8", "<f4", "<i2", "<i4", "<u1"))
    channels = []
    for name, values, rate, unit in zip(lie.names, lie.values, lie.rates, lie.units, strict=True):
        step = {} if rate is None else {"wf_increment": float(np.divide(1.0, rate))}
        channels.append(
            nptdms.ChannelObject("g", name, values, properties={**step, "unit_string": unit})
        )
    with nptdms.TdmsWriter(str(folder / "lie.tdms")) as writer:
        writer.write_segment(channels)
    return folder / "lie.tdms", lie.truth()


def _universal_lie(folder: Path, rng: np.random.Generator) -> tuple[Path, Truth | None]:
    lie = case(rng, types=("<f8",))
    return _write_universal(folder / "lie.uff", lie.values, lie.rates, lie.units), lie.truth()


def _timed(lie: Case) -> tuple[dict[str, np.ndarray], Truth | None]:
    """A time column and channels; one that cannot be where the first rate is absurd."""
    rate = lie.rates[0]
    count = len(lie.values[0])
    columns = {} if rate is None else {"time [s]": np.arange(count) * float(np.divide(1.0, rate))}
    for number, (values, unit) in enumerate(zip(lie.values, lie.units, strict=True)):
        columns[f"s{number} [{unit}]"] = values.astype(float)
    return columns, Case(lie.names, lie.values, [rate] * len(lie.rates), lie.units).truth()


def _parquet_lie(folder: Path, rng: np.random.Generator) -> tuple[Path, Truth | None]:
    import polars

    columns, truth = _timed(case(rng, same_length=True))
    polars.DataFrame(columns).write_parquet(folder / "lie.parquet")
    return folder / "lie.parquet", truth


def _text_lie(folder: Path, rng: np.random.Generator) -> tuple[Path, Truth | None]:
    columns, truth = _timed(case(rng, same_length=True))
    separator = str(rng.choice([",", ";", "\t"]))
    rows = [separator.join(columns)]
    for row in zip(*columns.values(), strict=True):
        # repr is exact: what is read must be what was written
        rows.append(separator.join(repr(float(value)) for value in row))
    (folder / "lie.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    return folder / "lie.csv", truth


def _sound_lie(folder: Path, rng: np.random.Generator) -> tuple[Path, Truth | None]:
    """WAV: one field of the header is another, or the rate with all that depends on it."""
    values = np.round(20 * rng.standard_normal((2, 60)))
    path = write_recording(Recording(values, 25600.0, "a", channels=("x", "y")), folder / "lie.wav")
    content = bytearray(path.read_bytes())
    at = content.index(b"fmt ") + 8
    rate = int(rng.choice([8000, 12800, 48000, 51200]))
    truth = None
    if rng.random() < 0.4:
        content[at + 4 : at + 12] = np.uint32([rate, 8 * rate]).tobytes()
        truth = Truth(values, float(rate), "m/s^2")
    else:
        field, size = ((2, 2), (4, 4), (8, 4), (12, 2), (14, 2))[int(rng.integers(5))]
        wrong = int(rng.integers(1, 1 << (8 * size - 1)))
        if content[at + field : at + field + size] == wrong.to_bytes(size, "little"):
            wrong += 1
        content[at + field : at + field + size] = wrong.to_bytes(size, "little")
    path.write_bytes(content)
    return path, truth


def _vehicle_lie(folder: Path, rng: np.random.Generator) -> tuple[Path, Truth | None]:
    """MDF: each channel in a group of its own time."""
    import asammdf

    lie = case(rng, types=("<f8", "<f4", "<i2", "<u1"))
    with asammdf.MDF(version="4.10") as file:
        for number, (values, rate, unit) in enumerate(
            zip(lie.values, lie.rates, lie.units, strict=True)
        ):
            time = np.arange(len(values)) * float(np.divide(1.0, rate if rate is not None else 0.0))
            file.append([asammdf.Signal(values, timestamps=time, name=f"s{number}", unit=unit)])
        file.save(folder / "lie.mf4", overwrite=True)
    return folder / "lie.mf4", lie.truth()


LIES: dict[str, Callable[[Path, np.random.Generator], tuple[Path, Truth | None]]] = {
    "csv": _text_lie,
    "mat5": _matlab_lie,
    "hdf5_foreign": _foreign_lie,
    "wav": _sound_lie,
    "tdms": _measurement_lie,
    "uff": _universal_lie,
    "parquet": _parquet_lie,
    "npz": _archive_lie,
    "mdf": _vehicle_lie,
}
"""Writer of lying files of each format that has a structure to lie in; the others are these
formats, packed.
"""


def _hdf5(path: Path, **layout: Any) -> None:
    with h5py.File(path, "w") as file:
        file.create_dataset("x", **layout).attrs.update({"fs": 25600.0, "unit": "g"})


def _huge_chunk(path: Path, count: int) -> None:
    with h5py.File(path, "w") as file:
        data = file.create_dataset(
            "x", (count,), "f8", chunks=(min(count, (1 << 29) - 1),), compression="gzip"
        )
        for start in range(0, count, data.chunks[0]):
            data.id.write_direct_chunk((start,), zlib.compress(bytes(1000)))
        data.attrs.update({"fs": 25600.0, "unit": "g"})


def _npz(path: Path, shape: tuple[int, ...], megabytes: int) -> None:
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        archive.open("x.npy", "w", force_zip64=True) as file,
    ):
        npy.write_array_header_1_0(file, {"descr": "<f8", "fortran_order": False, "shape": shape})
        for _ in range(megabytes):
            file.write(bytes(1 << 20))


def _gzip(path: Path, head: bytes, row: bytes, megabytes: int) -> None:
    with gzip.open(path, "wb", compresslevel=1) as file:
        file.write(head)
        for _ in range(megabytes):
            file.write(row * ((1 << 20) // len(row)))


def _patched(path: Path, old: bytes, new: bytes) -> None:
    """A valid file in which a number stands for another."""
    write_recording(Recording(np.zeros((1, 600)), 25600.0, "a", channels=("x",)), path)
    content = path.read_bytes()
    assert old in content, path
    path.write_bytes(content.replace(old, new))


BOMBS: dict[str, Callable[[Path], object]] = {
    "ones.npz": lambda path: _npz(path, (150 << 20,), 1200),
    "lie.npz": lambda path: _npz(path, (10**15,), 1),
    "chunk.h5": lambda path: _huge_chunk(path, (1 << 29) - 1),
    "chunks.h5": lambda path: _huge_chunk(path, 10**11),
    "fill.h5": lambda path: _hdf5(
        path, shape=(10**12,), dtype="f8", chunks=(1 << 20,), fillvalue=2.0
    ),
    "square.h5": lambda path: _hdf5(path, shape=(10**6, 10**6), dtype="f8", chunks=(1000, 1000)),
    "columns.h5": lambda path: _hdf5(
        path, data=np.zeros((12_000, 12_001), "i1"), compression="gzip"
    ),
    "rows.csv.gz": lambda path: _gzip(path, b"x\n", b"0\n", 400),
    "line.csv": lambda path: path.write_bytes(b"x,y\n" + b"1" * 200_000_000),
    "fields.csv": lambda path: path.write_bytes((b"1," * 20_000_000 + b"1\n") * 2),
    "header.csv": lambda path: path.write_bytes(b"# a\n" * 20_000_000 + b"1\n2\n"),
    "blank.csv": lambda path: path.write_bytes(b"\n" * 100_000_000),
    "utf16.csv": lambda path: path.write_bytes(b"\xff\xfe" + b"1\x00" * 40_000_000),
    "count.tdms": lambda path: _patched(path, struct.pack("<Q", 600), struct.pack("<Q", 10**13)),
    "count.mf4": lambda path: _patched(path, struct.pack("<Q", 600), struct.pack("<Q", 10**13)),
}
"""Writer of each small file that asks for too much memory or time."""


def tried_bomb(name: str, folder: Path) -> tuple[str, str]:
    """Class of what came of reading a file of `BOMBS`, and the message."""
    os.environ[MEMORY_VARIABLE] = "0.5"
    path = folder / name
    BOMBS[name](path)
    facts = (
        {} if path.suffix in (".h5", ".mf4", ".tdms") else {"unit": "g", "sample_rate": "25.6 kHz"}
    )
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    try:
        kind, said = (
            "read",
            f"{sum(block.n_samples for block in load_recording(path, **facts).blocks())} samples",
        )
    except Exception as error:  # what is looked for
        kind, said = _kind_of(error)
    if (taken := resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) > MEMORY_KB:
        kind, said = "exception", f"{taken} KiB taken"
    path.unlink()
    return kind, f"{name}: {said}"


@lru_cache
def _valid(name: str, folder: Path) -> tuple[bytes, str]:
    """Content and suffix of a valid file, which is read as it is."""
    path = FORMATS[name](folder)
    content = path.read_bytes()
    kind, message = outcome(name, path, content, in_blocks=True)
    if kind != "same":
        raise ValueError(f"the valid {name} file is {kind}: {message}")
    return content, "".join(path.suffixes)


def tried(name: str, number: int, seed: int, folder: Path) -> tuple[str, str]:
    """Class of what came of reading a damaged or lying file of a format, or a bomb, and the
    message.
    """
    warnings.simplefilter("ignore")
    if name == "bombs":
        return tried_bomb(list(BOMBS)[number], folder)
    generator, in_blocks = np.random.default_rng([seed, *name.encode(), number]), number % 2 == 1
    content, suffix = _valid(name, folder)
    if name in LIES and number % LYING == 0:
        path, truth = LIES[name](folder, generator)
        answer = outcome_of_lie(name, path, truth, in_blocks=in_blocks)
    else:
        path = folder / f"mutated_{number}{suffix}"
        path.write_bytes(mutated(content, generator))
        answer = outcome(name, path, content, in_blocks=in_blocks)
    path.unlink(missing_ok=True)
    return answer
