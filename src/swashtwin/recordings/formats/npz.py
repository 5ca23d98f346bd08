"""NumPy archives, and what any file of named arrays says of them: rates, units, scales, starts,
sensitivities.
"""

import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np

from swashtwin.foundation import DataError, require_memory
from swashtwin.recordings.formats.clock import extract_time, match_time_name
from swashtwin.recordings.formats.columns import Column
from swashtwin.recordings.formats.headings import (
    BARE_RATE,
    LISTS,
    SCALE_NAMES,
    apply_scales,
    header_rate,
    read_sensitivities,
    unknown_scale,
)
from swashtwin.recordings.formats.raw_file import RawFile, ReadOptions
from swashtwin.recordings.formats.sample_units import recognize_unit
from swashtwin.recordings.recording import Recording

_REFERENCE = 0xDD000000
"""First number of a field of a MATLAB file that stands for an object elsewhere in the file."""
_STARTS = ("start_time", "starttime", "wf_start_time", "t0", "start")
_PARTS = re.compile(r"[./]")
_CELL = re.compile(r"(.*)\((\d+)\)")
_INDEX = re.compile(r"\(.*\)$")
_NO_RATE = re.compile(r"-\d+(\.\d+)?(e[+-]?\d+)?|0(\.0)?")


def read(path: Path, options: ReadOptions) -> RawFile:
    """Vectors of an archive as columns, its single numbers and texts as attributes; an array of
    objects is refused.
    """
    with ZipFile(path) as members:
        require_memory(path, 2 * sum(member.file_size for member in members.infolist()))
    with np.load(path, allow_pickle=False) as archive:
        raw = sort_variables(path, [(name, archive[name]) for name in archive.files], options)
    return extract_time(path, raw, options)


def write(recording: Recording, path: Path) -> None:
    """Write ``signal`` (time by channel), ``sample_rate``, ``unit`` and ``channels``."""
    with path.open("wb") as file:
        np.savez_compressed(
            file,
            allow_pickle=False,
            signal=recording.signal.T,
            sample_rate=recording.sample_rate,
            unit=recording.unit,
            channels=np.array(recording.channels),
        )


def sort_variables(
    path: Path, variables: Iterable[tuple[str, Any]], options: ReadOptions
) -> RawFile:
    """Vectors as columns, with what the single numbers and texts around them state; these are
    attributes.

    A matrix yields one column for each of its longer side's vectors, called as a list of as many
    names says, or ``H(:,1)`` as MATLAB writes it.
    """
    found = _Variables(variables)
    attributes = {name: text for name, text in found.facts.items() if name != "unit"}
    attributes |= {"left_out": ", ".join(found.left_out)} if found.left_out else {}
    return attach_facts(
        path, RawFile(found.columns, None, found.units, attributes), found.facts, options
    )


def attach_facts(
    path: Path,
    raw: RawFile,
    facts: Mapping[str, Any],
    options: ReadOptions,
    sources: Mapping[str, tuple[str, int, int]] | None = None,
) -> RawFile:
    """The columns with the rate, the unit, the scale, the start and the sensitivity that facts
    state of them.

    A fact holds for the vectors of its structure or group (``a.fs`` for ``a.x``) and of those
    within; one with the name of a vector (``x_fs``, ``fs_x``), or an attribute of a data set
    (``x/fs``), for that only. The only rate in a file holds for all its vectors where none has one
    of its own.

    Parameters
    ----------
    facts : numbers, texts and lists of them by their paths, such as ``a.fs``.
    sources : data set of each column, and which of how many vectors of it the column is; None where
        each is its own.
    """
    scopes: dict[str, dict[str, Any]] = {}
    for name, value in facts.items():
        scope, last = _split(name.lower())
        scopes.setdefault(scope, {})[last] = value

    def rate_of(name: str, text: Any) -> float | None:
        if not isinstance(text, str) or (sources is None and BARE_RATE.fullmatch(name)):
            return None
        is_none = _NO_RATE.fullmatch(text) and header_rate([(name, "1")])
        return (
            float(text) if is_none else header_rate([(name, text)])
        )  # what is none is refused where all files are

    def unit_of(name: str, text: Any) -> str | None:
        return recognize_unit(text) if name in LISTS[1] and isinstance(text, str) else None

    columns: dict[str, Column] = {}
    stated: dict[str, Any] = {"rates": {}, "units": {}, "starts": {}, "sensitivities": {}}
    for key, column in raw.columns.items():
        source, number, count = (key, 0, 1) if sources is None else sources[key]
        levels = list(_levels(source, scopes))
        own = levels[:2] if match_time_name(source) else levels
        scales = {
            name: value
            for level in reversed(own)
            for name, value in level.items()
            if name in SCALE_NAMES
        }
        columns[key] = apply_scales(f"{path}: {source}", column, scales, options, number, count)
        values = {
            "rates": _nearest(path, source, levels, rate_of, "sample rates"),
            "units": None
            if unknown_scale(scales)
            else _nearest(path, source, levels, unit_of, "units"),
            "starts": _nearest(
                path, source, levels, lambda name, text: text if name in _STARTS else None, "starts"
            ),
            "sensitivities": _sensitivity(levels),
        }
        for name, value in values.items():
            stated[name] |= {} if value is None else {key: value}
    general = {
        rate
        for name, text in facts.items()
        if not BARE_RATE.fullmatch(last := _split(name.lower())[1])
        and (rate := rate_of(last, text)) is not None
    }
    if len(general) == 1 and not stated["rates"]:
        stated["rates"] = dict.fromkeys(columns, general.pop())
    stated["units"] |= raw.units
    return replace(raw, columns=columns, **stated)


def _split(name: str) -> tuple[str, str]:
    last = _PARTS.split(name)[-1]
    return name[: len(name) - len(last)], last


def _levels(name: str, scopes: Mapping[str, Mapping[str, Any]]) -> Iterator[Mapping[str, Any]]:
    """Facts that may hold for a vector: its attributes, those with its name, and those of each
    structure around.
    """
    name = _INDEX.sub("", name).lower()
    scope, last = _split(name)
    yield scopes.get(f"{name}/", {})
    beside = scopes.get(scope, {})
    yield {key.removeprefix(f"{last}_").removesuffix(f"_{last}"): value for key, value in beside.items()
           if key.startswith(f"{last}_") or key.endswith(f"_{last}")}  # fmt: skip
    yield beside
    while scope:
        scope = _split(scope[:-1])[0]
        yield scopes.get(scope, {})


def _nearest(
    path: Path,
    name: str,
    levels: Iterable[Mapping[str, Any]],
    read: Callable[[str, Any], Any],
    what: str,
) -> Any:
    """The value that `read` finds for a vector in the nearest level that has one."""
    for level in levels:
        found = {
            key: value for key, text in level.items() if (value := read(key, text)) is not None
        }
        meant = {key: value for key, value in found.items() if isinstance(value, str) or value > 0}
        found = meant or found  # a rate of none is refused only where no other is stated
        if len(set(found.values())) > 1:
            listed = ", ".join(f"{key} = {value}" for key, value in found.items())
            raise DataError(
                f"{path} states two {what} for {name} ({listed}); remove the wrong one from the file."
            )
        if found:
            return next(iter(found.values()))
    return None


def _sensitivity(levels: Iterable[Mapping[str, Any]]) -> str | None:
    for number, level in enumerate(levels):
        pairs = [(name, text) for name, text in level.items() if isinstance(text, str)]
        if texts := read_sensitivities(
            pair for pair in pairs if not number or pair[0].startswith("sensitivit")
        ):
            return texts[0]
    return None


def _texts(value: Any) -> list[str]:
    if isinstance(value, np.ndarray) and value.ndim == 1 and value.dtype.kind in "UO":
        value = value.tolist()
    return (
        value
        if isinstance(value, list) and value and all(isinstance(each, str) for each in value)
        else []
    )


class _Variables:
    """Variables of a workspace, sorted into columns, facts, and what is neither."""

    def __init__(self, variables: Iterable[tuple[str, Any]]) -> None:
        self.columns: dict[str, Column] = {}
        self.units: dict[str, str] = {}
        self.facts: dict[str, str] = {}
        self.left_out: list[str] = []
        variables = list(variables)
        self._cells = Counter(cell[1] for name, _ in variables if (cell := _CELL.fullmatch(name)))
        self._lists = {name.lower(): texts for name, value in variables if (texts := _texts(value))}
        for name, value in variables:
            if isinstance(value, str):
                self.facts[name] = value
            elif name.lower() not in self._lists:
                self._sort(name, value)

    def _sort(self, name: str, value: Any) -> None:
        try:
            array = np.squeeze(np.asarray(value.toarray() if hasattr(value, "toarray") else value))
        except ValueError:
            return  # a ragged cell array
        kind = array.dtype.kind
        is_reference = array.dtype == np.uint32 and array.size > 5 and array.flat[0] == _REFERENCE
        if kind == "c" or is_reference:
            self.left_out.append(
                f"{name} ({'a MATLAB object' if is_reference else 'complex numbers'})"
            )
        elif array.dtype.names:
            for field in array.dtype.names:
                self._sort(f"{name}.{field}", array[field])
        elif kind in "mM" and array.ndim == 1:
            self.columns[name], self.units[name] = (
                array.astype(f"{kind}8[ns]").astype(np.int64),
                "ns",
            )
        elif array.ndim == 0 and kind in "fiubU":
            self.facts[name] = str(array.item()) if kind == "U" else f"{array.item():.12g}"
        elif array.ndim == 1 and array.size > 1 and kind in "fiub":
            cell = _CELL.fullmatch(name)
            of = cell[1] if cell else name
            self._add(
                of, name, int(cell[2]) - 1 if cell else 0, self._cells[of], array.astype(np.float64)
            )
        elif array.ndim == 2 and array.size and kind in "fiub":
            tall = array.shape[0] >= array.shape[1]
            vectors = (array.T if tall else array).astype(np.float64)
            for number, vector in enumerate(vectors):
                key = f"{name}(:,{number + 1})" if tall else f"{name}({number + 1},:)"
                self._add(name, key, number, len(vectors), vector)

    def _add(self, name: str, key: str, number: int, count: int, vector: np.ndarray) -> None:
        """One of `count` vectors, with the name and the unit that lists beside them of as many
        texts say.
        """
        scope = _split(name)[0]
        names, units = (
            next((texts for each in keys if (texts := self._lists.get((scope + each).lower()))), [])
            for keys in LISTS
        )
        key = scope + names[number] if names and len(set(names)) == count else key
        if units and len(units) == count and (unit := recognize_unit(units[number])):
            self.units[key] = unit
        self.columns[key] = vector
