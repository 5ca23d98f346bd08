"""HDF5: our own form of one recording or of many (a store), and anybody else's vectors.

A file of one recording holds ``signal`` (channel by time) and, where it was measured, ``speed`` [rad/s]; its attributes
are ``sample_rate`` [Hz], ``unit``, ``channels``, ``factor``, ``recording_id``, ``label``, ``specimen``, ``synthetic``,
``condition.*`` (SI) and ``attributes``, which holds all else as JSON. A store holds the same in each of the groups
``000000``, ``000001``, ...
"""

import json
from collections.abc import Sequence
from math import prod
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from swashtwin.foundation import ArtifactError, DataError, memory_limit, require_memory
from swashtwin.recordings.formats.clock import named_as_time, timed
from swashtwin.recordings.formats.raw import (
    STORE_KIND,
    Column,
    Options,
    RawFile,
    known_unit,
    require_plausible_size,
    side_by_side,
)
from swashtwin.recordings.formats.tables import (
    LISTS,
    SCALE_NAMES,
    header_rate,
    obeyed,
    stated_sensitivities,
    unknown_scale,
)

KIND = "swashtwin recording "
"""What every version of a file of one recording begins its name with."""
FORMAT = f"{KIND}3"
STORE_FORMAT = f"{STORE_KIND}2"
CONDITION = ("speed", "discharge_pressure", "suction_pressure", "case_pressure", "oil_temperature")
_CACHE = 1 << 24
"""Bytes of a file's chunks that are kept: those of a slice of all channels."""
_COLUMNS = 10_000
"""Most vectors that a matrix has."""


def read(path: Path, options: Options) -> RawFile:
    """A recording of our own format, or every numeric vector of another HDF5 file."""
    file = _open(path, _CACHE)
    if (chunk := _largest_chunk(file)) > _CACHE:
        file.close()
        file = _open(path, 2 * min(chunk, memory_limit() // 4))  # a chunk that is not kept is unpacked for each slice
    name = _text(file.attrs.get("format")) or ""
    if name.startswith(STORE_KIND):
        raise DataError(f"{path} is a store of {len(file)} recordings; name a file of one recording.")
    if not name.startswith(KIND):
        return timed(path, _foreign(path, file, options), options)
    _require_format(path, file, FORMAT)
    return _complete(path, file)


def read_store(path: Path, options: Options) -> dict[str, RawFile]:
    """Every recording of a store, by the name of its group."""
    file = _open(path, 0)  # slices are of whole chunks, and no chunk is read twice
    _require_format(path, file, STORE_FORMAT)
    return {name: _complete(path, file[name]) for name in sorted(file)}


def _largest_chunk(file: h5py.File) -> int:
    """Bytes of the largest chunk of any data set."""
    sizes = [0]

    def visit(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and item.chunks:
            sizes.append(prod(item.chunks) * item.dtype.itemsize)

    file.visititems(visit)
    return max(sizes)


def _open(path: Path, cache: int) -> h5py.File:
    file = h5py.File(path, "r", rdcc_nbytes=cache, locking=False)  # writers of this process are not kept out
    require_links_within(path, file)
    return file


def require_links_within(path: Path, file: h5py.File) -> None:
    """Refuse a file whose names lead to other files."""

    def outside(name: str, link: Any) -> str | None:
        return f"{name!r} is a link to another file ({link.filename})" if isinstance(link, h5py.ExternalLink) else None

    if words := file.visititems_links(outside):
        raise DataError(f"{path}: {words}; put its data into this file, for example with h5copy.")


def require_data_within(path: Path, dataset: h5py.Dataset) -> None:
    """Refuse a data set whose samples are not all in this file, or do not fit in memory block by block.

    Raises
    ------
    DataError
        It is virtual or external, parts of it were never written, its chunks are too large, or what it unpacks to is
        too much for the size of the file.
    """
    if not dataset.size:
        return
    name, size = dataset.name, prod(dataset.shape) * dataset.dtype.itemsize
    if dataset.is_virtual or dataset.external:
        kind = "virtual" if dataset.is_virtual else "external"
        raise DataError(
            f"{path}: the data set {name} is {kind}: its samples are in other files; copy them into this file."
        )
    require_plausible_size(path, size, f"{name}, {dataset.shape}")
    if dataset.chunks is None:
        stored, expected, parts = dataset.id.get_storage_size(), size, "bytes"
    else:
        chunk = 2 * prod(dataset.chunks) * dataset.dtype.itemsize  # as stored, and unpacked
        require_memory(path, chunk, reason=f"has chunks of {name} that take")
        grid = zip(dataset.shape, dataset.chunks, strict=True)
        stored, expected = dataset.id.get_num_chunks(), prod(-(-length // chunk) for length, chunk in grid)
        parts = "chunks"
    if stored < expected:
        raise DataError(
            f"{path}: of the data set {name} only {stored} of {expected} {parts} were written; the rest would be read "
            "as zeros that nobody measured."
        )


def _require_format(path: Path, file: h5py.File, current: str) -> None:
    """Refuse a file that calls itself by another name than `current`, such as ``"swashtwin store 2"``.

    Raises
    ------
    ArtifactError
        An earlier or a newer version of swashtwin wrote it.
    """
    name = _text(file.attrs.get("format")) or ""
    if name == current:
        return
    kind, _, number = current.rpartition(" ")
    stated = name.removeprefix(f"{kind} ")
    newer = stated.isdecimal() and int(stated) > int(number)
    advice = "read it with a newer swashtwin" if newer else "make it again from its source with this swashtwin"
    raise ArtifactError(f"{path} has the format {name[:40]!r}, this swashtwin reads {current!r}; {advice}.")


def _complete(path: Path, group: h5py.Group) -> RawFile:
    """A recording of our own format, in a file or a group of it."""
    signal, speed, stated = group["signal"], group.get("speed"), group.attrs
    for dataset in (signal,) if speed is None else (signal, speed):
        require_data_within(path, dataset)
    channels, attributes = json.loads(stated["channels"]), json.loads(stated["attributes"])
    factors = [float(factor) for factor in stated.get("factor", np.ones(len(channels)))]
    hashes = json.loads(stated["hashes"]) if "hashes" in stated else []
    lengths = {len(channels), len(factors), len(hashes or channels), *signal.shape[:1]}
    if not np.isfinite(factors).all():
        raise ArtifactError(f"{path} is damaged: a factor of its channels is no number ({factors}).")
    texts = isinstance(channels, list) and isinstance(attributes, dict) and isinstance(hashes, list)
    texts = texts and all(isinstance(text, str) for text in (*channels, *hashes, *attributes.values()))
    if not (texts and signal.ndim == 2 and len(lengths) == 1):
        raise ArtifactError(f"{path} is damaged: its channels, factors or attributes are not what they should be.")
    facts: dict[str, Any] = {
        "recording_id": str(_text(stated["recording_id"])),
        "channels": channels,
        "unit": str(_text(stated["unit"])),
        "label": _text(stated.get("label")),
        "specimen": _text(stated.get("specimen")),
        "synthetic": bool(stated["synthetic"]),
        "factors": factors,
        "hashes": hashes,
    }
    if "condition.speed" in stated:
        facts["condition"] = {name: float(stated[f"condition.{name}"]) for name in CONDITION}
    columns = side_by_side(lambda start, stop: signal[:, start:stop], signal.shape, signal.dtype)
    named = dict(zip(channels, columns, strict=True))
    if len(named) < len(channels):  # the same name twice
        named = {
            f"{number} {name}": column for number, (name, column) in enumerate(zip(channels, columns, strict=True))
        }
    units = dict.fromkeys(named, facts["unit"])
    return RawFile(named, float(stated["sample_rate"]), units, attributes, facts, speed)


def _text(value: Any) -> str | None:
    return value.decode() if isinstance(value, bytes) else value if isinstance(value, str) else None


def _texts(value: Any) -> list[str]:
    return [str(_text(each)) for each in value.ravel()] if isinstance(value, np.ndarray) else []


def _foreign(path: Path, file: h5py.File, options: Options) -> RawFile:
    columns: dict[str, Column] = {}
    units: dict[str, str] = {}
    rates: dict[str, float] = {}
    starts: dict[str, str] = {}
    sensitivities: dict[str, str] = {}
    left_out: list[str] = []

    def visit(name: str, item: Any) -> None:
        if not isinstance(item, h5py.Dataset) or item.size is None or item.size < 2:
            return
        fields = item.dtype.names or ("",)
        kinds = {field: (item.dtype[field] if field else item.dtype).kind for field in fields}
        left_out.extend(f"{name} (complex numbers)" for kind in kinds.values() if kind == "c")
        if not set(kinds.values()) & set("fiu"):
            return
        require_data_within(path, item)
        holder, facts = item, [_attributes(item)]
        while holder.name != "/":
            holder = holder.parent
            facts.append(_attributes(holder))
        stated = (each.get(key) for each in (facts[0], facts[-1]) for key in ("unit", "units"))
        unit = next((unit for text in stated if (unit := known_unit(text or ""))), None)
        rate = next((rate for each in facts if (rate := _rate(path, item.name, each)) is not None), None)
        own = {key.lower(): value for key, value in item.attrs.items()}
        around = [] if named_as_time(name) else reversed(facts[1:])
        scales = {key: value for each in around for key, value in each.items() if key in SCALE_NAMES} | own
        for field in (field for field in fields if kinds[field] in "fiu"):
            vectors = _vectors_in(item, field)
            names, listed = (
                next((texts for each in keys if len(texts := _texts(own.get(each))) == len(vectors) > 1), [])
                for keys in LISTS
            )
            names = names if len(set(names)) == len(names) else []
            for number, column in enumerate(vectors):
                part = (names[number] if names else str(number)) if len(vectors) > 1 else ""
                key = "/".join(filter(None, (name, field, part)))
                columns[key] = obeyed(f"{path}: {item.name}", column, scales, options, number, len(vectors))
                for values, value in (
                    (units, None if unknown_scale(scales) else known_unit(listed[number]) if listed else unit),
                    (rates, rate),
                    (starts, next((each[of] for each in facts for of in _STARTS if of in each), None)),
                    (sensitivities, next(iter(stated_sensitivities(facts[0].items())), None)),
                ):
                    if value is not None:
                        values[key] = value  # type: ignore[assignment]

    file.visititems(visit)
    attributes = {name: text for name, text in _attributes(file).items() if len(text) < _LONGEST_FACT}
    attributes |= {"left_out": ", ".join(left_out)} if left_out else {}
    return RawFile(columns, None, units, attributes, rates=rates, starts=starts, sensitivities=sensitivities)


_LONGEST_FACT = 200
"""Letters of a fact of the file that is kept; a longer one is another file within it."""
_STARTS = ("start_time", "starttime", "wf_start_time", "t0", "start")


def _attributes(holder: h5py.Group | h5py.Dataset) -> dict[str, str]:
    """Attributes of a data set or a group as texts, by their names in small letters, with a group's single values."""
    pairs = dict(holder.attrs)
    if isinstance(holder, h5py.Group):
        pairs |= {name: item[()] for name, item in holder.items() if isinstance(item, h5py.Dataset) and item.size == 1}
    singles = {name.lower(): np.asarray(value) for name, value in pairs.items()}
    singles = {name: value.reshape(()) for name, value in singles.items() if value.size == 1}
    return {name: str(_text(value.item()) or value.item()) for name, value in singles.items()}


def _rate(path: Path, name: str, facts: dict[str, str]) -> float | None:
    """Sample rate [Hz] among the attributes of a group or a data set, or None."""
    rates = {each: rate for each, text in facts.items() if (rate := header_rate([(each, text)])) is not None}
    if len(set(rates.values())) > 1:
        listed = ", ".join(f"{name} = {rate:g} Hz" for name, rate in rates.items())
        raise DataError(f"{path} states two sample rates for {name} ({listed}); remove the wrong one.")
    return next(iter(rates.values()), None)


def _vectors_in(item: h5py.Dataset, field: str) -> Sequence[Column]:
    """Vectors along the longer side of a data set of one or two sides, or of one of its fields; none of another."""
    sides = [axis for axis, length in enumerate(item.shape) if length > 1]
    if len(sides) == 1:
        along, across = sides[0], None
    elif len(sides) == 2:
        across, along = sides if item.shape[sides[0]] <= item.shape[sides[1]] else sides[::-1]
    else:
        return []
    count = 1 if across is None else item.shape[across]
    if count > _COLUMNS:
        return []  # an image, or a table of something else

    def vectors(start: int, stop: int) -> np.ndarray:
        index: list[Any] = [0] * item.ndim
        index[along] = slice(start, stop)
        if across is not None:
            index[across] = slice(None)
        block = item[field, *index] if field else item[tuple(index)]
        if across is None:
            return block[None]
        return block if across < along else block.T

    return side_by_side(vectors, (count, item.shape[along]), item.dtype[field] if field else item.dtype)
