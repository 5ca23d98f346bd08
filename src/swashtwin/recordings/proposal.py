"""A first index for a folder, from file names, a table that came with them, and file contents."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from swashtwin.foundation import DataError, MissingFileError, parse_quantity, plain_text, plural
from swashtwin.recordings.column_roles import (
    EXCLUDED_COLUMNS,
    NoVibrationError,
    describe_excluded,
    vibration_columns,
)
from swashtwin.recordings.column_selection import (
    rate_in_file,
    resolve_sample_rate,
    select_columns,
)
from swashtwin.recordings.dataset_checks import class_name_findings
from swashtwin.recordings.entry import QUANTITIES, Entry
from swashtwin.recordings.fact_extraction import (
    are_equal_quantities,
    describe_contradictions,
    describe_header_label,
    parse_header_facts,
    parse_header_machine,
    parse_path_facts,
    pressures_without_unit,
    read_fact_table,
)
from swashtwin.recordings.fact_listing import Facts, describe_facts, value_text
from swashtwin.recordings.file_formats import find_readable_files, open_raw, stem_of, suffixes
from swashtwin.recordings.findings import FileNote, Finding, join_names, merge_notes
from swashtwin.recordings.formats.raw_file import RawFile
from swashtwin.recordings.formats.sample_units import require_sample_unit
from swashtwin.recordings.index_questions import QUESTIONS
from swashtwin.recordings.index_writing import relative_path
from swashtwin.recordings.label_hints import (
    find_single_label,
    label_hints,
    move_machines_out_of_labels,
)
from swashtwin.recordings.path_labels import (
    PathClasses,
    machine_code_notes,
    number_notes,
    unclear_machine_notes,
    unused_number_notes,
)
from swashtwin.recordings.scaling import resolve_scaling
from swashtwin.recordings.side_files import (
    Doubt,
    describe_doubt,
    describe_other_files,
    find_named_file,
    find_side_files,
    find_unreadable_files,
)

# File names that a note lists.
_MAX_LISTED_NAMES = 6


@dataclass(frozen=True)
class IndexProposal:
    """An index to check and correct."""

    index: Mapping[str, Any]
    """The index as `save_index` writes it."""
    skipped: tuple[Finding, ...]
    """Files that are not in it, each with the reason."""
    facts: tuple[str, ...]
    """For each fact its values with their number of files and their origin: check them first."""
    notes: tuple[Finding, ...] = ()
    """What looks wrong about the facts."""


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
    """Return an index of every file below `folder` that can be read.

    Parameters
    ----------
    folder : folder with the files; it is only read.
    label_pattern : regular expression that is searched in each relative path; its named groups
        ``label``, ``specimen``, ``speed``, ``pressure``, ``temperature`` and any other (an
        attribute) become facts. A number gets the unit that stands next to it in the name. Without
        a pattern the label is the parent folder's name, or the file name's words that hold no
        digit.
    table : CSV table with one row per file, as public data sets have; its files are relative to the
        table, to `folder` or to the current folder. `label_pattern` adds what it lacks.
    columns : column of the table for each key of an entry, such as ``{"specimen": "bearing_id"}``;
        other keys become attributes. ``file`` and ``label`` need no naming. A number gets the unit
        in the heading.
    include : patterns of relative paths to keep, such as ``"normal_48k/*"``; empty keeps all.
    pressure_unit : unit of pressures in names, tables and headers that have none; bare speeds are
        in rpm, rates in Hz, temperatures in degC.
    index_folder : folder of the index, if not `folder`.
    ask : called with the name of an argument, such as ``unit``, and a question, if that fact is
        missing; returns the answer, or None. By default a missing fact is an error.
    facts : keys of an entry for every file, such as ``unit="g"``. A quantity, such as ``speed``,
        overrides names and headers, which a note reports; a table or a pattern overrides it.

    Raises
    ------
    DataError
        A fact is missing in the files and the arguments.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise MissingFileError(f"{folder} is not a folder.")
    defaults = _checked_defaults(facts)
    if pressure_unit is not None:
        parse_quantity(f"1 {pressure_unit}", "Pa", name="pressure_unit")
    table_facts = None
    if table is not None:
        table_facts = read_fact_table(folder, Path(table), columns or {})
    files = _select_files(folder, table_facts, include)

    survey = _Survey(folder, table_facts, defaults, label_pattern, pressure_unit)
    survey.read(files)
    survey = _complete_by_questions(survey, files, ask)
    survey.require_complete()
    skipped = list(survey.skipped)
    if table_facts is None:  # else the table selects the files
        skipped += _skip_unreadable_files(folder, include)

    notes = survey.unused_line_notes()
    if survey.pattern is None and table_facts is None:
        machine_notes = move_machines_out_of_labels(survey.entries)
        if machine_notes:
            survey.update_label_facts()
        notes += machine_notes
        notes += number_notes(survey.entries, survey.path_classes)
        notes += unclear_machine_notes(survey.path_classes)
        notes += unused_number_notes(survey.path_classes)
        notes += machine_code_notes(survey.entries)
    labels = [entry.get("label") for entry in survey.entries]
    notes += [note for note in class_name_findings(labels) if note.kind == "similar_classes"]

    index: dict[str, Any] = {"format": 1}
    if index_folder is not None and Path(index_folder).resolve() != folder.resolve():
        index["root"] = relative_path(Path(index_folder).resolve(), folder.resolve())
    index.update(_index_content(survey.entries, survey.defaults))
    notes += label_hints(survey.entries)
    return IndexProposal(
        index=index,
        skipped=tuple(skipped),
        facts=describe_facts(survey.facts),
        notes=merge_notes([*survey.notes, *(("", note) for note in notes)]),
    )


def _checked_defaults(facts: Mapping[str, Any]) -> dict[str, Any]:
    """Return the facts of every file, refused if one is invalid."""
    defaults: dict[str, Any] = {}
    for key, value in facts.items():
        if value is not None:
            defaults[key] = list(value) if isinstance(value, tuple) else value

    Entry.from_mapping({"file": "every file", **defaults}, "the facts of every file")
    for name in QUANTITIES.keys() & defaults.keys():
        parse_quantity(defaults[name], QUANTITIES[name], name=name)
    if "unit" in defaults:
        require_sample_unit(defaults["unit"])
    return defaults


def _select_files(
    folder: Path, table_facts: Mapping[str, Any] | None, include: Sequence[str]
) -> list[str]:
    """Return the relative paths of the files to read: those of the table, or all readable ones."""
    if table_facts is not None:
        names = list(table_facts)
    else:
        names = [path.relative_to(folder).as_posix() for path in find_readable_files(folder)]

    selected = [name for name in names if _is_included(name, include)]
    if include and not selected:
        raise DataError(
            f"{folder} holds no file whose path matches include = {', '.join(include)}."
        )
    return selected


def _is_included(name: str, include: Sequence[str]) -> bool:
    return not include or any(fnmatchcase(name, pattern) for pattern in include)


def _skip_unreadable_files(folder: Path, include: Sequence[str]) -> list[Finding]:
    """Return one note about the files whose format cannot be read."""
    names = [name for name in find_unreadable_files(folder) if _is_included(name, include)]
    if not names:
        return []

    listed = join_names(names, _MAX_LISTED_NAMES)
    message = f"{listed}: files of formats that cannot be read."
    remedy = "If they hold recordings, save these as CSV, and unpack archives."
    return [Finding("skipped", "note", None, message, remedy)]


def _complete_by_questions(
    survey: "_Survey", files: Sequence[str], ask: Callable[[str, str], str | None] | None
) -> "_Survey":
    """Return a survey with the answers to its questions; each question is asked once."""
    asked_keys: set[str] = set()
    while ask is not None:
        answers: dict[str, str] = {}
        for key, text in survey.questions().items():
            if key in asked_keys:
                continue
            asked_keys.add(key)
            if answer := ask(key, text):
                answers[key] = answer
        if not answers:
            break

        # An answer may reveal further missing facts, so that the files are read again.
        survey = _Survey(
            folder=survey.folder,
            table_facts=survey.table_facts,
            pattern=answers.pop("label_pattern", survey.pattern),
            pressure_unit=answers.pop("pressure_unit", survey.pressure_unit),
            defaults={**survey.defaults, **answers},
        )
        survey.read(files)
    return survey


@dataclass
class _Survey:
    """Facts that the files of a folder state, and facts that are missing."""

    folder: Path
    table_facts: Mapping[str, dict[str, Any]] | None
    """Facts of each file from a table; None if they are in the names."""
    defaults: Mapping[str, Any]
    pattern: str | None
    pressure_unit: str | None
    entries: list[dict[str, Any]] = field(default_factory=list)
    skipped: list[Finding] = field(default_factory=list)
    missing: dict[str, list[str]] = field(default_factory=dict)
    """Files that lack a fact."""
    facts: list[Facts] = field(default_factory=list)
    notes: list[FileNote] = field(default_factory=list)

    unused_lines: dict[str, None] = field(default_factory=dict)
    """Lines of headers that may name a machine, or a logger or a type."""

    path_classes: PathClasses = field(default_factory=PathClasses)
    """What tells classes apart in the paths."""

    max_rows: int = 0
    """Rows of the longest recording that is not doubtful."""
    doubtful: list["_DoubtfulFile"] = field(default_factory=list)

    def read(self, names: Sequence[str]) -> None:
        """Read the facts of files, or why they cannot be read."""
        names = self._without_side_files(names)
        self.path_classes = PathClasses.find(names)
        for name in names:
            path = self.folder / name
            try:
                raw = open_raw(path, self._entry({"file": name}).options)
            except MissingFileError:
                raise
            except DataError as cause:
                # A table names recordings: one that is damaged is an error, an empty one is not.
                if self.table_facts is not None and path.stat().st_size:
                    raise
                self._skip(cause.message, cause.remedy)
                continue

            named_file = None
            if self.table_facts is None and "text_columns" in raw.attributes:
                named_file = find_named_file(path, names)
            if named_file is None:
                self._add_or_skip(name, raw)
            else:
                self._skip(
                    f"{path} names {named_file}.", "To take facts from it, specify it as {table}."
                )
        self._decide_doubtful()
        self._sort_entries(names)

    def _add_or_skip(self, name: str, raw: RawFile) -> None:
        """Add a file, or skip one of other sensors, such as the gyroscope of a telephone."""
        entry = self._entry({"file": name})
        doubt = None
        if self.table_facts is None and entry.channels is None:
            doubt = describe_doubt(self.folder / name, raw, entry)
        if doubt is not None:
            self._add_doubtful(name, raw, doubt)
            return

        self._add_unless_other(name, raw)
        n_rows = len(next(iter(raw.columns.values())))
        self.max_rows = max(self.max_rows, n_rows)

    def _add_unless_other(self, name: str, raw: RawFile) -> None:
        try:
            self._add(name, raw)
        except NoVibrationError as cause:
            if self.table_facts is not None:
                raise
            self._skip(cause.message, cause.remedy)

    def _add_doubtful(self, name: str, raw: RawFile, doubt: Doubt) -> None:
        """Read a file that may hold no recording into a separate survey."""
        survey = replace(
            self,
            entries=[],
            skipped=[],
            missing={},
            facts=[],
            notes=[],
            unused_lines={},
            doubtful=[],
        )
        error = None
        try:
            survey._add_unless_other(name, raw)
        except DataError as cause:
            error = cause
        self.doubtful.append(_DoubtfulFile(name, doubt, survey, error))

    def _decide_doubtful(self) -> None:
        """Skip the files that may hold no recording, unless there are no others."""
        has_recordings = bool(self.entries)
        for file in self.doubtful:
            if has_recordings and file.doubt.holds_beside(self.max_rows):
                self._skip(
                    f"{self.folder / file.name} {file.doubt.reason}.",
                    "If it is a recording, add it to the index.",
                )
                continue
            if file.error is not None:
                raise file.error

            self.entries += file.survey.entries
            self.skipped += file.survey.skipped
            self.facts += file.survey.facts
            self.notes += file.survey.notes
            self.unused_lines.update(file.survey.unused_lines)
            for key, names in file.survey.missing.items():
                self.missing.setdefault(key, []).extend(names)

    def _sort_entries(self, names: Sequence[str]) -> None:
        """Sort the entries of files that were decided last among the others."""
        positions = {name: position for position, name in enumerate(names)}
        order = sorted(
            range(len(self.entries)), key=lambda row: positions[self.entries[row]["file"]]
        )
        self.entries = [self.entries[row] for row in order]
        self.facts = [self.facts[row] for row in order]

    def _without_side_files(self, names: Sequence[str]) -> list[str]:
        """Return the files that may be recordings, and skip event logs and the like."""
        if self.table_facts is not None:
            return list(names)

        side_files = []
        for name in find_side_files(self.folder, names):
            if find_named_file(self.folder / name, names) is None:  # else it is a table of facts
                side_files.append(name)
        if side_files:
            self._skip(
                f"{join_names(side_files, _MAX_LISTED_NAMES)}: text and few numbers, such as an "
                "event log or a device description."
            )
        return [name for name in names if name not in side_files]

    def _skip(self, reason: str, remedy: str = "") -> None:
        self.skipped.append(Finding("skipped", "note", None, reason, remedy))

    def _note(self, file: str, kind: str, message: str, remedy: str = "") -> None:
        self.notes.append((file, Finding(kind, "note", None, message, remedy)))

    def _entry(self, values: Mapping[str, Any]) -> Entry:
        return Entry.from_mapping({**self.defaults, **values}, str(self.folder / values["file"]))

    def _add(self, name: str, raw: RawFile) -> None:
        """Add the entries of a file."""
        values, origins = self._collect_values(name, raw)
        machine, unused_lines = parse_header_machine(raw)
        if machine and "specimen" not in values:
            values["specimen"] = plain_text(machine)
            origins["specimen"] = "the file"
        if "specimen" not in values:
            self.unused_lines.update(dict.fromkeys(map(plain_text, unused_lines)))
        for key in pressures_without_unit(values):
            if self.pressure_unit is not None:
                values[key] = f"{values[key]} {self.pressure_unit}"
        self._apply_settings(name, values, origins)
        if self.pressure_unit is None and pressures_without_unit(values):
            self.missing.setdefault("pressure_unit", []).append(name)

        if label_text := describe_header_label(raw, values.get("label", "")):
            self._note(name, "contradicted_label", f"{name}: {plain_text(label_text)}.")

        for entry_values in self._part_entries(raw, {"file": name, **values}):
            self._add_entry(raw, entry_values, origins)

    def _collect_values(self, name: str, raw: RawFile) -> tuple[dict[str, Any], dict[str, str]]:
        """Return the facts of a file, and the origin of those not of its name (or the table).

        The file itself overrides its name, and the table overrides the file. Settings of all files
        override the file and its name (`_apply_settings`).
        """
        values: dict[str, Any] = {}
        pattern_keys: Set[str] = frozenset()
        if self.table_facts is None:
            values, pattern_keys = parse_path_facts(name, self.pattern, self.path_classes)
        else:
            row = self.table_facts[name]
            if self.pattern:  # it adds what the table lacks
                path_facts, pattern_keys = parse_path_facts(name, self.pattern, self.path_classes)
                pattern_keys = pattern_keys - row.keys()
                values = {key: path_facts[key] for key in pattern_keys & path_facts.keys()}
                # A group that is not a key of an entry is an attribute.
                row_attributes = row.get("attributes", {})
                attributes = {**path_facts.get("attributes", {}), **row_attributes}
                if attributes:
                    row = {**row, "attributes": attributes}
            values.update(row)
        if raw.facts.get("label"):
            values.pop("label", None)
        for key in ("label", "specimen"):
            if key in values:
                values[key] = plain_text(values[key])

        header = parse_header_facts(raw)
        differing = [
            key
            for key in header
            if key in values and header[key] != values[key] and key not in self.defaults
        ]
        if differing:
            key = differing[0]
            winner = "header's" if self.table_facts is None else "table's"
            self._note(
                name,
                "contradicted",
                f"{name} states {key} = {values[key]}, its header {header[key]}; "
                f"the {winner} counts.",
            )

        origins = dict.fromkeys(pattern_keys, "the pattern")
        for key, text in header.items():
            if self.table_facts is None or key not in values:
                values[key] = text
                origins[key] = "the file"
        return values, origins

    def _apply_settings(
        self, name: str, values: dict[str, Any], origins: Mapping[str, str]
    ) -> None:
        """Remove quantities that a setting of all files overrides, and note what differs.

        A table or a pattern states them for each file, and overrides the setting.
        """
        entry = self._entry({"file": name})
        overridden: dict[str, dict[str, Any]] = {}
        for key in QUANTITIES:
            is_set = key in self.defaults and key in values
            if not is_set or are_equal_quantities(values[key], self.defaults[key], key):
                continue

            origin = origins.get(key, self._default_origin)
            if origin in ("the table", "the pattern"):
                self._note(
                    name,
                    "contradicted",
                    f"{name}: {key} = {values[key]} of {origin} counts, and not "
                    f"{self.defaults[key]}, which is specified for all files.",
                )
            else:
                overridden.setdefault(origin, {})[key] = values.pop(key)

        for origin, facts in overridden.items():
            contradictions = describe_contradictions(entry, facts, origin)
            if contradictions:
                self._note(name, "contradicted", f"{name}: {contradictions}.")

    @property
    def _default_origin(self) -> str:
        return "its name" if self.table_facts is None else "the table"

    def _part_entries(self, raw: RawFile, values: dict[str, Any]) -> list[dict[str, Any]]:
        """Return the entries of a file: one for each start time of its unnamed channels."""
        entry = self._entry(values)
        if entry.channels is not None:
            return [values]

        channels_by_start: dict[str, list[str]] = {}
        for name in vibration_columns(raw, entry, str(self.folder / values["file"])):
            channels_by_start.setdefault(raw.starts.get(name, ""), []).append(name)
        if len(channels_by_start) < 2:
            return [values]

        stem = stem_of(Path(values["file"]))
        return [
            {**values, "id": f"{stem}_{number}", "channels": names}
            for number, names in enumerate(channels_by_start.values(), 1)
        ]

    def _add_entry(self, raw: RawFile, values: dict[str, Any], origins: Mapping[str, str]) -> None:
        entry = self._entry(values)
        name = values["file"]
        source_name = str(self.folder / name)
        columns = list(select_columns(raw, entry, source_name))
        for key in _find_missing_facts(raw, columns, entry, self.defaults.keys(), source_name):
            self.missing.setdefault(key, []).append(name)
        self.facts.append(self._collect_origins(raw, columns, values, origins))
        self.entries.append(values)

        if entry.channels is None:
            excluded = [column for column in raw.columns if column not in columns]
            for kind, listed in describe_excluded(raw, entry, excluded).items():
                self._note(name, kind, f"{EXCLUDED_COLUMNS[kind]} are skipped: {listed}.")
        if entry.pressure is not None and entry.speed is None and "condition" not in raw.facts:
            self._note(
                name,
                "no_speed",
                "files state a pressure and no speed, which calibration and shaft orders require.",
                "Set {speed='860 rpm'} if it is known.",
            )

    def _collect_origins(
        self,
        raw: RawFile,
        columns: Sequence[str],
        entry: Mapping[str, Any],
        origins: Mapping[str, str],
    ) -> Facts:
        """Return value and origin of each fact that the entry of a file will have.

        Parameters
        ----------
        origins : origin of the facts that are not of its name (or the table).
        """
        default_origin = self._default_origin
        facts: Facts = {}
        for key, value in self.defaults.items():
            facts[key] = (value_text(value), "the settings")
        for key, value in entry.items():
            if key not in ("file", "attributes", "id", "sha256"):
                facts[key] = (value_text(value), origins.get(key, default_origin))
        for key, value in entry.get("attributes", {}).items():
            facts[f"attribute {key}"] = (value, origins.get(key, default_origin))

        folder_name = plain_text(Path(entry["file"]).parent.name).strip("_-. ")
        if facts.get("label") == (folder_name, "its name"):
            facts["label"] = (entry["label"], "the folder's name")
        if raw.facts.get("label"):
            facts["label"] = (raw.facts["label"], "the file")

        rates = {raw.rates.get(column, raw.sample_rate) for column in columns} - {None}
        if len(rates) == 1:
            facts["sample_rate"] = (f"{rates.pop():.10g} Hz", "the file")
        units = {raw.units[column] for column in columns if column in raw.units}
        if len(units) == 1 and "unit" not in self.defaults:
            facts["unit"] = (units.pop(), "the file")
        facts.setdefault("channels", (", ".join(columns), "the file"))
        return facts

    def unused_line_notes(self) -> list[Finding]:
        """Return a note that lists the lines of headers which may name a machine."""
        if not self.unused_lines:
            return []

        listed = join_names(list(self.unused_lines), _MAX_LISTED_NAMES)
        message = f"found in headers, not used: {listed}."
        remedy = "If they name machines, write them as specimen into the index."
        return [Finding("header_machines", "note", None, message, remedy)]

    def update_label_facts(self) -> None:
        """Take over labels and specimens of the entries after they were changed."""
        for facts, entry in zip(self.facts, self.entries, strict=True):
            for key in ("label", "specimen"):
                if key in entry:
                    facts[key] = (entry[key], "its name")

    def questions(self) -> dict[str, str]:
        """Return a question for each missing fact, and for a class that all files have."""
        questions = {}
        for key, names in self.missing.items():
            argument = "label_pattern" if key == "label" else key
            questions[argument] = (
                f"The {key} of {plural(len(names), 'file')} is missing, such as that of "
                f"{names[0]}. {QUESTIONS[key].text}?"
            )

        single_label = find_single_label(self.entries)
        has_label_source = self.pattern is not None or self.table_facts is not None
        if "label" not in self.missing and not has_label_source and single_label:
            questions["label_pattern"] = (
                f"All files are of the class {single_label!r}, according to their names. "
                f"{QUESTIONS['label'].text}?"
            )
        return questions

    def require_complete(self) -> None:
        """Refuse files that lack a fact, or a folder without any."""
        facts = []
        settings = []
        for key, names in self.missing.items():
            facts.append(f"{key} of {plural(len(names), 'file')} (such as {names[0]})")
            settings.append(QUESTIONS[key].setting)
        if facts:
            raise DataError(
                f"{self.folder}: neither the files nor the settings state {'; '.join(facts)}.",
                field=next(iter(self.missing)),
                remedy=f"Set {'; '.join(settings)}.",
            )

        if self.skipped and not self.entries:
            reason = self.skipped[0]
            raise DataError(
                f"{self.folder} holds no file to index: {reason.message}", remedy=reason.remedy
            )
        if not self.entries:
            raise DataError(
                f"{self.folder} holds no file to index{describe_other_files(self.folder)}: "
                f"supported are {', '.join(suffixes())}."
            )


@dataclass(frozen=True)
class _DoubtfulFile:
    """A file that is a recording only if there are no others."""

    name: str
    doubt: Doubt
    survey: _Survey
    """What an index states about this file alone."""
    error: DataError | None
    """Why it cannot be indexed."""


def _find_missing_facts(
    raw: RawFile, columns: list[str], entry: Entry, default_keys: Set[str], source_name: str
) -> list[str]:
    """Return the facts that neither the file nor the entry states.

    A default of all files that contradicts this one is refused.
    """
    missing = []
    if entry.sample_rate is None and rate_in_file(raw, columns, source_name) is None:
        missing.append("sample_rate")
    elif "sample_rate" in default_keys:
        resolve_sample_rate(raw, columns, entry, source_name)

    has_units = all(name in raw.units for name in columns)
    if not has_units and entry.unit is None and entry.sensitivity is None:
        missing.append("sensitivity" if raw.full_scale else "unit")
    elif default_keys & {"sensitivity", "unit"}:
        resolve_scaling(raw, entry, columns, source_name)

    if not (entry.label or raw.facts.get("label")):
        missing.append("label")
    return missing


def _index_content(entries: list[dict[str, Any]], defaults: Mapping[str, Any]) -> dict[str, Any]:
    """Return the content of an index: unique ids, classes, and common facts as defaults."""
    stem_counts = Counter(stem_of(Path(entry["file"])) for entry in entries)
    for entry in entries:
        if stem_counts[stem_of(Path(entry["file"]))] > 1 and "id" not in entry:
            entry["id"] = entry["file"].replace("/", "_")

    labels = list(dict.fromkeys(entry.get("label") for entry in entries))
    common_facts = dict(defaults)
    for key in sorted(entries[0].keys() - {"file", "id", "label", "attributes", "sha256"}):
        value = entries[0][key]
        if len(entries) > 1 and all(entry.get(key) == value for entry in entries):
            common_facts[key] = value
            for entry in entries:
                del entry[key]

    content: dict[str, Any] = {}
    if None not in labels:
        content["classes"] = labels
    if common_facts:
        content["defaults"] = common_facts
    content["recording"] = entries
    return content
