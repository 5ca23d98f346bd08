"""Whole files whose contents lie: rates, units, shapes, number types, names and chunks that cannot be, or contradict.

Each writer makes a file that its format's own library takes for whole, and says what a reader may get from it: the
samples, the rate and the unit that the file states, or nothing, where it must be refused.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from swashtwin.recordings import Recording, write_recording, write_store

FACTORS = {"g": 9.80665, "m/s^2": 1.0, "mm/s^2": 1e-3, "mg": 9.80665e-3, "Pa": 1.0, "V": 1.0}
"""What one of each unit is in the unit that a reader gives."""
_JUNK = ("bananas", "", "\x1b[31mg", "=1+1", "g" * 500, "none")
_RATES = (25600.0, 12800.0, 51200 / 3, 1000.0)
_ABSURD = (0.0, -25600.0, float("nan"), float("inf"), 1e12, 1e-9, None)
_NAMES = ("x", "y", "z", "../../etc/passwd", "a\x1b[2Jb", "e\u0301", "\u202egnp", "-1", "=1+1", "n" * 300)
_TYPES = ("<f8", ">f8", "<f4", "<i2", ">i4", "<u1", "<i8")


@dataclass(frozen=True)
class Truth:
    """What a reader may get from a file."""

    signal: np.ndarray
    rate: float
    unit: str


@dataclass(frozen=True)
class Case:
    """Channels and what is stated of each."""

    names: list[str]
    values: list[np.ndarray]
    rates: list[float | None]
    units: list[str]

    def truth(self) -> Truth | None:
        """What may be read; None where the file must be refused."""
        rate, lengths = self.rates[0], {len(values) for values in self.values}
        units = {"m/s^2" if unit not in ("Pa", "V") else unit for unit in self.units}
        plausible = isinstance(rate, float) and 1e-3 <= rate <= 1e9 and len(set(self.rates)) == 1
        if not plausible or len(lengths) > 1 or len(units) > 1 or any(unit not in FACTORS for unit in self.units):
            return None
        assert rate is not None
        rows = [FACTORS[unit] * values.astype(float) for unit, values in zip(self.units, self.values, strict=True)]
        return Truth(np.stack(rows), rate, units.pop())


def case(rng: np.random.Generator, *, types: tuple[str, ...] = _TYPES, same_length: bool = False) -> Case:
    """Channels of which something may be wrong."""
    count = int(rng.integers(1, 4))
    names = [str(name) for name in rng.choice(_NAMES, count, replace=False)]
    lengths = [60] * count if same_length or rng.random() < 0.85 else [int(n) for n in rng.integers(5, 70, count)]
    kind = str(rng.choice(types))
    values = [np.round(20 * rng.standard_normal(length)).clip(0, 200).astype(kind) for length in lengths]
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


def archive(folder: Path, rng: np.random.Generator) -> tuple[Path, Truth | None]:
    """NPZ."""
    lie = case(rng)
    content: dict[str, Any] = {}
    for number, (values, rate, unit) in enumerate(zip(lie.values, lie.rates, lie.units, strict=True)):
        content |= {f"s{number}": values, f"s{number}_unit": unit, **_stated(rate, f"s{number}_fs")}
    np.savez(folder / "lie.npz", **content)
    return folder / "lie.npz", lie.truth()


def matlab(folder: Path, rng: np.random.Generator) -> tuple[Path, Truth | None]:
    """MATLAB version 5."""
    from scipy.io import savemat

    lie = case(rng)
    content = {
        f"s{number}": {"x": values, "unit": unit, **_stated(rate)}
        for number, (values, rate, unit) in enumerate(zip(lie.values, lie.rates, lie.units, strict=True))
    }
    savemat(folder / "lie.mat", content, do_compression=bool(rng.random() < 0.5))
    return folder / "lie.mat", lie.truth()


def foreign(folder: Path, rng: np.random.Generator) -> tuple[Path, Truth | None]:
    """HDF5 of another program."""
    lie, truth = case(rng), None
    damage = str(rng.choice(["none", "none", "none", "unwritten", "virtual", "external", "link"]))
    with h5py.File(folder / "lie.h5", "w") as file:
        for number, (values, rate, unit) in enumerate(zip(lie.values, lie.rates, lie.units, strict=True)):
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


def measurement(folder: Path, rng: np.random.Generator) -> tuple[Path, Truth | None]:
    """TDMS."""
    import nptdms

    lie = case(rng, types=("<f8", "<f4", "<i2", "<i4", "<u1"))
    channels = []
    for name, values, rate, unit in zip(lie.names, lie.values, lie.rates, lie.units, strict=True):
        step = {} if rate is None else {"wf_increment": float(np.divide(1.0, rate))}
        channels.append(nptdms.ChannelObject("g", name, values, properties={**step, "unit_string": unit}))
    with nptdms.TdmsWriter(str(folder / "lie.tdms")) as writer:
        writer.write_segment(channels)
    return folder / "lie.tdms", lie.truth()


def universal(folder: Path, rng: np.random.Generator) -> tuple[Path, Truth | None]:
    """UFF 58."""
    import pyuff

    lie = case(rng, types=("<f8",))
    sets = []
    for number, (values, rate, unit) in enumerate(zip(lie.values, lie.rates, lie.units, strict=True)):
        step = 0.0 if rate is None else float(np.divide(1.0, rate))
        sets.append(
            pyuff.prepare_58(
                id1=f"s{number}", func_type=1, rsp_node=number, rsp_dir=1, ref_node=0, ref_dir=0, ord_data_type=4,
                num_pts=len(values), abscissa_spacing=1, abscissa_min=0.0, abscissa_inc=step,
                abscissa_spec_data_type=17, ordinate_spec_data_type=12, orddenom_spec_data_type=0,
                ordinate_axis_units_lab=unit[:20], data=values, x=np.arange(len(values)) * step,
            )
        )  # fmt: skip
    pyuff.UFF(str(folder / "lie.uff")).write_sets(sets, mode="overwrite")
    return folder / "lie.uff", lie.truth()


def _timed(lie: Case) -> tuple[dict[str, np.ndarray], Truth | None]:
    """A time column and channels; one that cannot be where the first rate is absurd."""
    rate = lie.rates[0]
    count = len(lie.values[0])
    columns = {} if rate is None else {"time [s]": np.arange(count) * float(np.divide(1.0, rate))}
    for number, (values, unit) in enumerate(zip(lie.values, lie.units, strict=True)):
        columns[f"s{number} [{unit}]"] = values.astype(float)
    return columns, Case(lie.names, lie.values, [rate] * len(lie.rates), lie.units).truth()


def parquet(folder: Path, rng: np.random.Generator) -> tuple[Path, Truth | None]:
    """Parquet."""
    import polars

    columns, truth = _timed(case(rng, same_length=True))
    polars.DataFrame(columns).write_parquet(folder / "lie.parquet")
    return folder / "lie.parquet", truth


def text(folder: Path, rng: np.random.Generator) -> tuple[Path, Truth | None]:
    """Text tables."""
    columns, truth = _timed(case(rng, same_length=True))
    separator = str(rng.choice([",", ";", "\t"]))
    rows = [separator.join(columns)]
    rows += [separator.join(repr(float(value)) for value in row) for row in zip(*columns.values(), strict=True)]
    (folder / "lie.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    return folder / "lie.csv", truth


def sound(folder: Path, rng: np.random.Generator) -> tuple[Path, Truth | None]:
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


def vehicle(folder: Path, rng: np.random.Generator) -> tuple[Path, Truth | None]:
    """MDF: each channel in a group of its own time."""
    import asammdf

    lie = case(rng, types=("<f8", "<f4", "<i2", "<u1"))
    with asammdf.MDF(version="4.10") as file:
        for number, (values, rate, unit) in enumerate(zip(lie.values, lie.rates, lie.units, strict=True)):
            time = np.arange(len(values)) * float(np.divide(1.0, rate if rate is not None else 0.0))
            file.append([asammdf.Signal(values, timestamps=time, name=f"s{number}", unit=unit)])
        file.save(folder / "lie.mf4", overwrite=True)
    return folder / "lie.mf4", lie.truth()


_FACTS: dict[str, tuple[Any, ...]] = {
    "channels": ('["x"]', '["x", 1]', '{"x": 1}', "[" * 3000, "1e999", '["x", "y", "z"]', '["x", "x"]'),
    "attributes": ("[]", "[" * 3000, "1", '{"a": 1}', '{"a": {"b": []}}'),
    "unit": ("bananas", "", "\x1b[31m", "g"),
    "sample_rate": (0.0, -1.0, float("nan"), float("inf"), 1e12, 12800.0, "fast", np.zeros(3)),
    "recording_id": ("", "../../x", "a\nb", 3),
    "label": (b"\xff\xfe", "", "l" * 10_000, 3.0),
    "synthetic": ("no", 7, np.zeros(0)),
    "condition.speed": (float("nan"), -1.0, 1e9, "fast"),
    "factor": (np.ones(5), np.array([np.nan, 1.0]), "x", np.zeros((2, 2))),
    "format": ("swashtwin recording 99", "swashtwin store x"),
}
"""Values that an attribute of our own format may be given."""


def _changed(group: h5py.Group, rng: np.random.Generator) -> bool:
    """Whether the group may still be read, after one of its facts or data sets was changed."""
    draw = rng.random()
    if draw < 0.25:
        shape, kind = [((60,), "f8"), ((3, 60), "f8"), ((2, 0), "f8"), ((2, 60), "S4")][int(rng.integers(4))]
        del group["signal"]
        group.create_dataset("signal", shape, kind, data=None if kind == "S4" else np.ones(shape, kind))
        return False
    name = str(rng.choice(list(_FACTS)))
    value = _FACTS[name][int(rng.integers(len(_FACTS[name])))]
    group.attrs[name] = np.bytes_(value.encode("utf-8")) if isinstance(value, str) else value
    harmless = name in ("label", "synthetic", "recording_id", "unit") or (name == "format" and group.name != "/")
    return harmless or (isinstance(value, str) and value == '["x", "x"]')


def _facts_of(group: h5py.Group) -> tuple[float, str]:
    """Rate and unit as the file states them; NaN where it states no number."""
    rate, unit = group.attrs["sample_rate"], group.attrs["unit"]
    return (float(rate) if np.ndim(rate) == 0 and isinstance(rate, float) else float("nan")), bytes(unit).decode()


def _altered(path: Path, rng: np.random.Generator, group: str, values: np.ndarray) -> Truth | None:
    with h5py.File(path, "r+") as file:
        readable = _changed(file[group], rng)
        rate, unit = _facts_of(file[group])
    if not readable and not (rate != 25600.0 and 1e-3 <= rate <= 1e9):
        return None
    if group == "/" and unit == "g":
        return Truth(values * FACTORS["g"], rate, "m/s^2")
    return Truth(values, rate, unit)


def lossless(folder: Path, rng: np.random.Generator) -> tuple[Path, Truth | None]:
    """Our own format, with one fact or data set changed."""
    values = np.round(20 * rng.standard_normal((2, 60)))
    recording = Recording(values, 25600.0, "a", channels=("x", "y"), label="normal")
    path = write_recording(recording, folder / "lie.h5")
    return path, _altered(path, rng, "/", values)


def store(folder: Path, rng: np.random.Generator) -> tuple[Path, Truth | None]:
    """A store of our own format, with one fact or data set changed."""
    values = np.round(20 * rng.standard_normal((2, 60)))
    recording = Recording(values, 25600.0, "a", channels=("x", "y"), label="normal")
    path = write_store([recording], folder / "lie.h5")
    return path, _altered(path, rng, "000000", values)


LIES: dict[str, Callable[[Path, np.random.Generator], tuple[Path, Truth | None]]] = {
    "csv": text,
    "mat5": matlab,
    "hdf5": lossless,
    "hdf5_foreign": foreign,
    "store": store,
    "wav": sound,
    "tdms": measurement,
    "uff": universal,
    "parquet": parquet,
    "npz": archive,
    "mdf": vehicle,
}
"""Writer of lying files of each format that has a structure to lie in; the others are these formats, packed."""
