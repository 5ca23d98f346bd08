"""A first index for a folder of files, from their names, a table that came with them, and what they
carry.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence, Set
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from swashtwin.foundation import DataError, MissingFileError, parse_quantity, plain_text
from swashtwin.recordings.channel_checks import listed
from swashtwin.recordings.entry import QUANTITIES, Entry
from swashtwin.recordings.fact_extraction import (
    find_single_label,
    label_hints,
    move_machines_out_of_labels,
    parse_header_facts,
    parse_path_facts,
    pressures_without_unit,
    read_fact_table,
)
from swashtwin.recordings.files import open_raw, stem_of, suffix_of, suffixes
from swashtwin.recordings.formats.raw_file import RawFile
from swashtwin.recordings.formats.sample_units import require_sample_unit
from swashtwin.recordings.index import relative_path
from swashtwin.recordings.loading import rate_in_file, resolve_sample_rate, select_columns
from swashtwin.recordings.scaling import resolve_scaling, vibration_columns

Facts = dict[str, tuple[str, str]]
"""Value and origin of each fact of one file."""


@dataclass(frozen=True)
class IndexProposal:
    """An index to look over and correct."""

    index: Mapping[str, Any]
    """The index as `save_index` writes it."""
    skipped: tuple[str, ...]
    """Files that are left out, each with the reason."""
    facts: tuple[str, ...]
    """For each fact its values with their number of files and their origin: what to look over
    first.
    """
    notes: tuple[str, ...] = ()
    """What looks odd about the facts."""


def propose_index(
    folder: str | Path,
    *,
    label_pattern: str | None = None,
    table: str | Path | None = None,
    columns: Mapping[str, str] | None = None,
    include: Sequence[str] = (),
    pressure_unit: str | None = None,
    index_folder: str | Path | None = None,
    ask: Callable[[str, str], str | None] | None = None,
    **facts: Any,
) -> IndexProposal:
    """Index of every file below `folder` that can be read.

    Parameters
    ----------
    folder : where the files are; it is only read.
    label_pattern : regular expression that is searched in each relative path; its named groups
        ``label``, ``specimen``, ``speed``, ``pressure``, ``temperature`` and any other (an
        attribute) become facts. A number takes the unit that stands beside it in the name. Without
        a pattern the label is the parent folder's name, or the file name's words that hold no
        digit.
    table : CSV table with one row per file, as public data sets have; its files are relative to the
        table, to `folder` or to the current folder. `label_pattern` adds what it lacks.
    columns : which column of the table holds which key of an entry, such as ``{"specimen":
        "bearing_id"}``; keys that no entry has become attributes. ``file`` and ``label`` need no
        naming. A number takes the unit in the heading.
    include : patterns of relative paths to keep, such as ``"normal_48k/*"``; all where empty.
    pressure_unit : unit of pressures in names, tables and headers that have none; bare speeds are
        in rpm, rates in Hz, temperatures in degC.
    index_folder : where the index will lie, if not in `folder`.
    ask : called with the name of an argument, such as ``unit``, and a question, where
        that fact is missing; gives the answer, or None. By default a missing fact is an error.
    facts : keys of an entry for every file that does not say them itself, such as ``unit="g"``.

    Raises
    ------
    DataError
        A fact is missing that neither the files nor the arguments say.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise MissingFileError(f"{folder} is not a folder.")
    stated_facts = ((key, value) for key, value in facts.items() if value is not None)
    defaults: dict[str, Any] = {
        key: [*value] if isinstance(value, tuple) else value for key, value in stated_facts
    }
    Entry.from_mapping({"file": "every file", **defaults}, "the facts of every file")
    for name in QUANTITIES.keys() & defaults.keys():
        parse_quantity(defaults[name], QUANTITIES[name], name=name)
    if "unit" in defaults:
        require_sample_unit(defaults["unit"])
    if pressure_unit is not None:
        parse_quantity(f"1 {pressure_unit}", "Pa", name="pressure_unit")
    stated = None if table is None else read_fact_table(folder, Path(table), columns or {})
    found = sorted(
        path for path in folder.rglob("*") if path.is_file() and not path.name.startswith(".")
    )
    known = suffixes()
    readable = [path.relative_to(folder).as_posix() for path in found if suffix_of(path) in known]
    files = [
        name
        for name in (readable if stated is None else stated)
        if not include or any(fnmatchcase(name, pattern) for pattern in include)
    ]
    if include and not files:
        raise DataError(
            f"{folder} holds no file whose path matches include = {', '.join(include)}."
        )
    asked: set[str] = set()
    while True:
        survey = _Survey(folder, stated, defaults, label_pattern, pressure_unit)
        survey.read(files)
        questions = {key: text for key, text in survey.questions().items() if key not in asked}
        answers = {
            key: answer
            for key, text in questions.items()
            if ask is not None and (answer := ask(key, text))
        }
        if not answers:
            break
        asked |= questions.keys()
        label_pattern = answers.pop("label_pattern", label_pattern)
        pressure_unit = answers.pop("pressure_unit", pressure_unit)
        defaults |= answers
    survey.require_complete()
    hints = (
        [] if label_pattern or stated is not None else move_machines_out_of_labels(survey.entries)
    )
    for origins, entry in zip(survey.facts, survey.entries, strict=True) if hints else ():
        origins |= {key: (entry[key], "its name") for key in ("label", "specimen") if key in entry}
    index: dict[str, Any] = {"format": 1}
    if index_folder is not None and Path(index_folder).resolve() != folder.resolve():
        index["root"] = relative_path(Path(index_folder).resolve(), folder.resolve())
    index |= _content(survey.entries, defaults)
    hints += label_hints(survey.entries)
    notes = tuple(dict.fromkeys([*survey.notes, *hints]))
    return IndexProposal(index, tuple(survey.skipped), _sentences(survey.facts), notes)


@dataclass
class _Survey:
    """What the files of a folder state, and what nobody does."""

    folder: Path
    stated: Mapping[str, dict[str, Any]] | None
    """Facts of each file from a table; None where they are in the names."""
    defaults: Mapping[str, Any]
    pattern: str | None
    pressure_unit: str | None
    entries: list[dict[str, Any]] = field(default_factory=list)
    skipped: list[str] = field(default_factory=list)
    missing: dict[str, list[str]] = field(default_factory=dict)
    """Files in which nobody states a fact."""
    facts: list[Facts] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def read(self, names: Sequence[str]) -> None:
        """Take up the files that can be read, or why they cannot."""
        for name in names:
            path = self.folder / name
            try:
                raw = open_raw(path, self._entry({"file": name}).options)
            except MissingFileError:
                raise
            except DataError as cause:
                if self.stated is not None and path.stat().st_size:
                    raise
                self.skipped.append(str(cause))
                continue
            if (
                self.stated is None
                and "text_columns" in raw.attributes
                and (other := _named_within(path, names))
            ):
                self.skipped.append(f"{path} names {other}: a table of facts, for --table.")
                continue
            self._add(name, raw)

    def _entry(self, values: Mapping[str, Any]) -> Entry:
        return Entry.from_mapping({**self.defaults, **values}, str(self.folder / values["file"]))

    def _add(self, name: str, raw: RawFile) -> None:
        """Take up a file: what it states itself counts for more than its name, and for less than a
        table.
        """
        fact, found = (
            parse_path_facts(name, self.pattern)
            if self.stated is None or self.pattern
            else ({}, frozenset())
        )
        if self.stated is not None:  # a pattern adds what the table lacks
            found = frozenset(found - self.stated[name].keys())
            fact = {**{key: fact[key] for key in found}, **self.stated[name]}
        values = {
            key: value
            for key, value in fact.items()
            if key != "label" or not raw.facts.get("label")
        }
        values |= {key: plain_text(values[key]) for key in ("label", "specimen") if key in values}
        header, counts = parse_header_facts(raw), "header's" if self.stated is None else "table's"
        both = [key for key in header if key in values and header[key] != values[key]]
        self.notes.extend(
            f"{name} states {key} = {values[key]}, its header {header[key]}; the {counts} counts."
            for key in both[:1]
        )
        in_file = {
            key: text for key, text in header.items() if self.stated is None or key not in values
        }
        values |= in_file
        bare = pressures_without_unit(values)
        if bare and self.pressure_unit is None:
            self.missing.setdefault("pressure_unit", []).append(name)
        values |= {
            key: f"{values[key]} {self.pressure_unit}"
            for key in bare
            if self.pressure_unit is not None
        }
        for part in self._entries_within(raw, {"file": name, **values}):
            entry = self._entry(part)
            columns = list(select_columns(raw, entry, str(self.folder / name)))
            for key in _missing_facts(
                raw, columns, entry, self.defaults.keys(), str(self.folder / name)
            ):
                self.missing.setdefault(key, []).append(name)
            origins = {**dict.fromkeys(found, "the pattern"), **dict.fromkeys(in_file, "the file")}
            self.facts.append(self._origins(raw, columns, part, origins))
            self.entries.append(part)
            if entry.channels is None and (
                others := [column for column in raw.columns if column not in columns]
            ):
                self.notes.append(
                    f"columns that are no vibration are left out: {', '.join(others)}."
                )
            if entry.pressure is not None and entry.speed is None and "condition" not in raw.facts:
                self.notes.append(
                    'files state a pressure and no speed; add --speed "860 rpm" where it is known: calibration and '
                    "shaft orders need it."
                )

    def _entries_within(self, raw: RawFile, values: dict[str, Any]) -> list[dict[str, Any]]:
        """Entries of a file: one for each start of its channels, where they start apart and are not
        named.
        """
        entry = self._entry(values)
        starts: dict[str, list[str]] = {}
        for name in vibration_columns(raw, entry) if entry.channels is None else ():
            starts.setdefault(raw.starts.get(name, ""), []).append(name)
        if len(starts) < 2:
            return [values]
        stem = stem_of(Path(values["file"]))
        return [
            {**values, "id": f"{stem}_{n}", "channels": names}
            for n, names in enumerate(starts.values(), 1)
        ]

    def _origins(
        self,
        raw: RawFile,
        columns: Sequence[str],
        entry: Mapping[str, Any],
        origins: Mapping[str, str],
    ) -> Facts:
        """Value and origin of each fact that the entry of a file will have; `origins` are those not
        of its name.
        """
        usual = "its name" if self.stated is None else "the table"
        told = {
            key: value
            for key, value in entry.items()
            if key not in ("file", "attributes", "id", "sha256")
        }
        facts: Facts = {key: (_words(value), "the option") for key, value in self.defaults.items()}
        facts |= {key: (_words(value), origins.get(key, usual)) for key, value in told.items()}
        for key, value in entry.get("attributes", {}).items():
            facts[f"attribute {key}"] = (value, origins.get(key, usual))
        if facts.get("label") == (
            plain_text(Path(entry["file"]).parent.name).strip("_-. "),
            "its name",
        ):
            facts["label"] = (entry["label"], "the folder's name")
        rates = {raw.rates.get(column, raw.sample_rate) for column in columns} - {None}
        if len(rates) == 1:
            facts["sample_rate"] = (f"{rates.pop():.10g} Hz", "the file")
        units = {raw.units[column] for column in columns if column in raw.units}
        if len(units) == 1 and "unit" not in self.defaults:
            facts["unit"] = (units.pop(), "the file")
        if raw.facts.get("label"):
            facts["label"] = (raw.facts["label"], "the file")
        facts.setdefault("channels", (", ".join(columns), "the file"))
        return facts

    def questions(self) -> dict[str, str]:
        """A question for each fact that is missing, and for a class that all files have."""
        questions = {
            key: f"{len(names)} files (as {names[0]}) do not say their {key}. {_QUESTIONS[key][1]}?"
            for key, names in self.missing.items()
        }
        if "label" in questions:
            questions["label_pattern"] = questions.pop("label")
        elif (
            self.pattern is None
            and self.stated is None
            and (only := find_single_label(self.entries))
        ):
            reason = f"All files are of the class {only!r}, as their names say"
            questions["label_pattern"] = f"{reason}. {_QUESTIONS['label'][1]}?"
        return questions

    def require_complete(self) -> None:
        """Refuse files that lack a fact, or a folder without any."""
        words = "; ".join(
            f"{key} of {len(names)} files (as {names[0]}): {_QUESTIONS[key][0]}"
            for key, names in self.missing.items()
        )
        if words:
            raise DataError(f"{self.folder}: neither the files nor the options state {words}.")
        if not self.entries:
            reason = self.skipped[0] if self.skipped else f"supported are {', '.join(suffixes())}."
            raise DataError(f"{self.folder} holds no file to index: {reason}")


def _named_within(path: Path, names: Sequence[str]) -> str | None:
    """A file of the folder that another one names in its first lines."""
    with path.open("rb") as file:
        head = file.read(1 << 16).decode(errors="replace")
    return next(
        (name for name in names if Path(name).name in head and Path(name).name != path.name), None
    )


_QUESTIONS = {
    "sample_rate": (
        '--sample-rate "25.6 kHz"',
        "How many samples per second and channel do they have, with the unit",
    ),
    "unit": (
        '--unit "g" (or "V", "1")',
        'In which unit are their samples: g, m/s^2, V, or "1" where it is not known',
    ),
    "sensitivity": (
        '--sensitivity "50 m/s^2" (what full scale stands for), or --unit "1" where nobody knows',
        "Which quantity does full scale of their integers stand for, such as 50 m/s^2",
    ),
    "pressure_unit": (
        "--pressure-unit bar",
        "Their pressures have no unit: is it MPa, bar, kPa or psi",
    ),
    "label": (
        "--label-pattern",
        "Which regular expression finds the class in their paths, as (?P<label>...)",
    ),
}


def _missing_facts(
    raw: RawFile, columns: list[str], entry: Entry, given: Set[str], where: str
) -> list[str]:
    """Facts that nobody states; one of those `given` for all files that the file contradicts is
    refused.
    """
    has_units = all(name in raw.units for name in columns)
    missing = []
    if entry.sample_rate is None and rate_in_file(raw, columns, where) is None:
        missing.append("sample_rate")
    elif "sample_rate" in given:
        resolve_sample_rate(raw, columns, entry, where)
    if not has_units and entry.unit is None and entry.sensitivity is None:
        missing.append("sensitivity" if raw.full_scale else "unit")
    elif given & {"sensitivity", "unit"}:
        resolve_scaling(raw, entry, columns, where)
    return missing if entry.label or raw.facts.get("label") else [*missing, "label"]


def _content(entries: list[dict[str, Any]], defaults: dict[str, Any]) -> dict[str, Any]:
    """What an index holds: unique ids, the occurring classes, common facts as defaults."""
    stems = [stem_of(Path(entry["file"])) for entry in entries]
    for entry, stem in zip(entries, stems, strict=True):
        if stems.count(stem) > 1 and "id" not in entry:
            entry["id"] = entry["file"].replace("/", "_")
    labels = list(dict.fromkeys(entry.get("label") for entry in entries))
    for key in sorted(entries[0].keys() - {"file", "id", "label", "attributes", "sha256"}):
        if len(entries) > 1 and all(entry.get(key) == entries[0][key] for entry in entries):
            defaults = {**defaults, key: entries[0][key]}
            for entry in entries:
                del entry[key]
    return {
        **({} if None in labels else {"classes": labels}),
        **({"defaults": defaults} if defaults else {}),
        "recording": entries,
    }


_FACTS_FIRST = ("label", "specimen", "speed", "pressure", "sample_rate", "unit", "channels")
"""Facts that are listed before the others."""
_MOST = 6
"""Values that a sentence lists."""


def _sentences(files: Iterable[Facts]) -> tuple[str, ...]:
    """One sentence for each fact: its values with their number of files, by origin."""
    counts: dict[str, dict[str, Counter[str]]] = {}
    for facts in files:
        for key, (value, origin) in facts.items():
            counts.setdefault(key, {}).setdefault(origin, Counter())[value] += 1
    sentences = []
    for key in sorted(
        counts, key=lambda key: (_FACTS_FIRST.index(key) if key in _FACTS_FIRST else 9, key)
    ):
        parts = []
        for origin, values in counts[key].items():
            parts.append(
                f"{listed([f'{value} ({count})' for value, count in values.items()], _MOST)}, says {origin}"
            )
        sentences.append(f"{key}: {'; '.join(parts)}")
    return tuple(sentences)


def _words(value: Any) -> str:
    return ", ".join(map(str, value)) if isinstance(value, list | tuple) else str(value)
