"""Numeric vectors of HDF5 files that other programs wrote."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from swashtwin.recordings.columns import Column, matrix_columns, number_type
from swashtwin.recordings.formats.array_shapes import describe_shape, require_small_arrays
from swashtwin.recordings.formats.clock import extract_time
from swashtwin.recordings.formats.column_names import is_foreign_unit
from swashtwin.recordings.formats.hdf5_access import require_local_data
from swashtwin.recordings.formats.named_arrays import NAME_LISTS, UNIT_LISTS, attach_facts
from swashtwin.recordings.formats.raw_file import RawFile, ReadOptions
from swashtwin.recordings.formats.sample_units import recognize_unit

# Vectors of a matrix; more make it an image, or a table of something else.
_MAX_COLUMNS = 10_000

# Characters of a text that is kept as an attribute; a longer one is a file within the file.
_MAX_FACT_LENGTH = 200


def read_vectors(path: Path, file: h5py.File, options: ReadOptions) -> RawFile:
    """Return every numeric vector of a file as a column, with the facts around it."""
    vectors = _Vectors(path)
    vectors.facts.update({name.lower(): _fact(value) for name, value in file.attrs.items()})
    file.visititems(vectors.add_object)

    attributes: dict[str, str] = {}
    for name, fact in vectors.facts.items():
        if "/" not in name and isinstance(fact, str) and len(fact) < _MAX_FACT_LENGTH:
            attributes[name] = fact
    if vectors.excluded:
        attributes["left_out"] = ", ".join(vectors.excluded)

    require_small_arrays(path, vectors.shapes, vectors.columns, options)
    raw = RawFile(
        vectors.columns, None, vectors.units, attributes, foreign_units=vectors.foreign_units
    )
    counts = {name for name, column in raw.columns.items() if number_type(column).kind in "iu"}
    raw = attach_facts(path, raw, vectors.facts, options, vectors.sources, counts)
    return extract_time(path, raw, options)


class _Vectors:
    """Columns and facts of the groups and data sets that were visited."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.columns: dict[str, Column] = {}
        self.units: dict[str, str] = {}
        self.foreign_units: dict[str, str] = {}
        self.facts: dict[str, Any] = {}
        """Attributes and single numbers by their paths."""
        self.sources: dict[str, tuple[str, int, int]] = {}
        """(data set, number of the vector, number of its vectors) of each column."""
        self.excluded: list[str] = []
        self.shapes: dict[str, tuple[int, ...]] = {}
        """Shapes of data sets of more than two axes."""

    def add_object(self, name: str, item: Any) -> None:
        attributes = {key.lower(): value for key, value in item.attrs.items()}
        for key, value in attributes.items():
            self.facts[f"{name}/{key}"] = _fact(value)

        if not isinstance(item, h5py.Dataset) or not item.size:
            return
        if item.size == 1:
            self.facts[name.lower()] = _fact(item[()])
            return

        field_names = item.dtype.names or ("",)  # a table has fields; another data set has none
        kinds = {field: (item.dtype[field] if field else item.dtype).kind for field in field_names}
        self.excluded += [f"{name} (complex numbers)" for kind in kinds.values() if kind == "c"]
        numeric_fields = [field for field, kind in kinds.items() if kind in "fiu"]
        if not numeric_fields:
            return

        if sum(length > 1 for length in item.shape) > 2:
            self.shapes[name] = item.shape
            self.excluded.append(describe_shape(name, item.shape))
            return
        require_local_data(self._path, item)
        for field in numeric_fields:
            self._add_vectors(name, field, _vectors_of(item, field), attributes)

    def _add_vectors(
        self, name: str, field: str, vectors: Sequence[Column], attributes: Mapping[str, Any]
    ) -> None:
        """Add the vectors of a data set, with the names and units that its attributes list."""
        count = len(vectors)
        names = _listed_texts(attributes, NAME_LISTS, count)
        units = _listed_texts(attributes, UNIT_LISTS, count)
        if len(set(names)) < len(names):
            names = []

        for number, column in enumerate(vectors):
            part = ""
            if count > 1:
                part = names[number] if names else str(number)
            key = "/".join(text for text in (name, field, part) if text)
            self.columns[key] = column
            self.sources[key] = (name, number, count)
            unit = recognize_unit(units[number]) if units else None
            if unit:
                self.units[key] = unit
            elif units and is_foreign_unit(units[number]):
                self.foreign_units[key] = units[number]


def decode_text(value: Any) -> str | None:
    """Return an attribute's text, or None if it is not a text."""
    if isinstance(value, bytes):
        return value.decode()
    return value if isinstance(value, str) else None


def _listed_texts(attributes: Mapping[str, Any], keys: Sequence[str], count: int) -> list[str]:
    """Return the first list of one text for each of several vectors, or an empty list."""
    for key in keys:
        value = attributes.get(key)
        if isinstance(value, np.ndarray) and value.size == count > 1:
            return [str(decode_text(text)) for text in value.ravel()]
    return []


def _fact(value: Any) -> Any:
    """Return a text, or an array of several values."""
    array = np.asarray(value)
    if array.size != 1:
        return array
    return str(decode_text(array.item()) or array.item())


def _vectors_of(dataset: h5py.Dataset, field: str) -> Sequence[Column]:
    """Return the vectors along the longer axis of a data set, or of one of its fields.

    Without one or two axes of more than one sample it has no vectors.
    """
    axes = [axis for axis, length in enumerate(dataset.shape) if length > 1]
    if len(axes) == 1:
        time_axis, channel_axis = axes[0], None
    elif len(axes) == 2:
        channel_axis, time_axis = sorted(axes, key=lambda axis: dataset.shape[axis])
    else:
        return []

    count = 1 if channel_axis is None else dataset.shape[channel_axis]
    if count > _MAX_COLUMNS:
        return []

    def read(start: int, stop: int) -> np.ndarray:
        index: list[Any] = [0] * dataset.ndim
        index[time_axis] = slice(start, stop)
        if channel_axis is not None:
            index[channel_axis] = slice(None)
        block: np.ndarray = dataset[field, *index] if field else dataset[tuple(index)]

        if channel_axis is None:
            return block[None]
        return block if channel_axis < time_axis else block.T

    dtype = dataset.dtype[field] if field else dataset.dtype
    return matrix_columns(read, (count, dataset.shape[time_axis]), dtype)
