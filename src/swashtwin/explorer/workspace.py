"""The recordings that an explorer shows, each with its facts and findings.

They come from an index, a folder, a store, a file or a calibration. They are opened and inspected
in the background.
"""

import json
import math
import threading
import time
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
from fastapi import Query

from swashtwin.explorer.pyramid import Pyramid
from swashtwin.foundation import DataError, FileStamp, InputError, SwashTwinError, file_stamp
from swashtwin.pump import is_healthy, values_match
from swashtwin.recordings import (
    INDEX_NAME,
    Entry,
    FactChange,
    Recording,
    Recordings,
    change_facts,
    inspect_recordings,
    load_entry,
    load_recordings,
    propose_index,
    read_index,
    resolve_index_path,
    specified_pressure,
    specified_shaft_frequency,
    summarize_recordings,
)

Name = Annotated[str, Query(max_length=1000)]
"""Name of a row in an address."""
FACTS = ("label", "specimen", "speed", "pressure", "sensitivity", "unit", "sample_rate")
"""Facts that can be edited."""
SPARKLINE_PARTS = 40
"""Values of a recording's sparkline."""

_MAX_CACHED_RECORDINGS = 4

# Relative differences up to which recordings share an operating point.
_SPEED_TOLERANCE = 0.03
_PRESSURE_TOLERANCE = 0.06


class RecordingVersion(NamedTuple):
    """What every result of a recording is cached by."""

    name: str
    """Name of its row."""
    facts: str
    """Facts that the index specifies."""
    stamp: FileStamp | None
    """Stamp of its file."""


@dataclass
class Row:
    """One recording of the table."""

    name: str
    """Id of its entry, or its file."""
    specified: Mapping[str, Any] = field(default_factory=dict)
    """Facts that the index specifies."""
    entry: Entry | None = None
    """The same facts, parsed."""
    stamp: FileStamp | None = None
    """Stamp of its file when it was last looked at; `None` if there was no file."""
    recording: Recording | None = None
    """The recording, its samples in the file; `None` until it is opened, or if it cannot be."""
    state: str = "waiting"
    """``waiting``, ``ready`` or ``broken``."""
    findings: list[dict[str, Any]] = field(default_factory=list)
    """What the inspection reported."""
    rms: list[float] = field(default_factory=list)
    """Root mean square over all channels, along the recording."""
    revision: int = 0
    """Number of its last change."""

    @property
    def version(self) -> RecordingVersion:
        """Facts and file of the recording, as they were last looked at."""
        return RecordingVersion(self.name, repr(self.specified), self.stamp)

    @property
    def label(self) -> str | None:
        """Class of the recording; until it is opened, the one that the index specifies."""
        recording = self.recording  # another thread may close it meanwhile
        if recording is not None:
            return recording.label
        return self.specified.get("label")

    def to_dict(self) -> dict[str, Any]:
        """Return the row as the page shows it."""
        content: dict[str, Any] = {
            "name": self.name,
            "state": self.state,
            "findings": self.findings,
            "rms": self.rms,
            "specified": {key: self.specified.get(key) for key in FACTS},
            "label": self.label,
            "specimen": self.specified.get("specimen"),
            "file": self.specified.get("file"),
            "stamp": repr(self.stamp),
        }
        if self.recording is not None:
            content |= _describe_recording(self.recording)
        content["healthy"] = is_healthy(self.label)
        return content


def _describe_recording(recording: Recording) -> dict[str, Any]:
    shaft_hz = specified_shaft_frequency(recording)
    pressure = specified_pressure(recording)
    return {
        "id": recording.recording_id,
        "specimen": recording.specimen,
        "rpm": None if shaft_hz is None else 60 * shaft_hz,
        "mpa": None if math.isnan(pressure) else pressure / 1e6,
        "pistons": summarize_recordings([recording]).pistons,
        "channels": recording.channels,
        "unit": recording.unit,
        "rate": recording.sample_rate,
        "duration": recording.duration,
        "samples": recording.n_samples,
    }


class Workspace:
    """Recordings of a source, opened and inspected in the background.

    Parameters
    ----------
    source : an index, a folder with or without one, a store, a file of a measurement, or a
        calibration, which may have an index in its folder.

    Raises
    ------
    DataError
        There is nothing to show.
    """

    def __init__(self, source: Path) -> None:
        self.source = source
        self.folder = source if source.is_dir() else source.parent
        self.calibration = source if source.suffix == ".json" else None
        self.index = self._find_index()
        self.rows: dict[str, Row] = {}
        self.findings: list[dict[str, Any]] = []
        self.skipped: Sequence[str] = ()
        self.questions: dict[str, str] = {}
        self.revision = 0
        self._proposed: dict[str, Any] | None = None
        # Of the index, or of the source if it has none.
        self._stamp: FileStamp | None = None
        self._lock = threading.RLock()
        self._opened: OrderedDict[RecordingVersion, Recording] = OrderedDict()
        self._pyramids: OrderedDict[RecordingVersion, Pyramid] = OrderedDict()
        self._worker: threading.Thread | None = None
        # What the worker inspects, whose pyramid it needs as a whole.
        self._inspected: RecordingVersion | None = None
        self._is_shown = False

        if self.index is None:
            self.refresh()
        elif source.is_dir() and not self.index.is_file():
            self.propose({})
        elif self.calibration is None or self.index.is_file():
            self.refresh()

    def _find_index(self) -> Path | None:
        """Return the path of the index, which need not exist; `None` for a store or a file."""
        if self.source.suffix == ".toml":
            return self.source
        if self.source.is_dir() or self.calibration is not None:
            return self.folder / INDEX_NAME
        return None

    def propose(self, answers: Mapping[str, str]) -> None:
        """Propose an index of the folder, in memory.

        Facts that are neither in the files nor in `answers` become `questions`.
        """
        self.questions = {}

        def ask(key: str, question: str) -> str | None:
            # Without a pattern, labels stay empty; every other question needs an answer.
            if not answers.get(key) and key != "label_pattern":
                self.questions[key] = question
            return answers.get(key) or None

        try:
            proposal = propose_index(self.folder, ask=ask)
        except DataError:
            if not self.questions:
                raise
            return

        self._proposed = dict(proposal.index)
        self.skipped = [finding.describe() for finding in proposal.skipped]
        self._replace_table(self._proposed)

    def refresh(self) -> None:
        """Read again what has changed: the index, a store, and files of recordings.

        Raises
        ------
        DataError
            The index or the store cannot be read any more.
        """
        with self._lock:
            if self.index is None:
                self._refresh_store()
                return

            if self.index.is_file():
                stamp = file_stamp(self.index)
                if stamp != self._stamp:
                    self._replace_table(read_index(self.index))
                    self._stamp = stamp
            for row in self.rows.values():
                self._renew(row)

    def _refresh_store(self) -> None:
        """Read the recordings of a source without an index again if its file changed."""
        stamp = file_stamp(self.source)
        if stamp != self._stamp:
            recordings = load_recordings(self.source)
            self._replace_rows(
                [Row(recording.recording_id, recording=recording) for recording in recordings]
            )
            self._stamp = stamp

    def _renew(self, row: Row) -> None:
        """Let a recording of the index be read again if its file was recorded anew."""
        stamp = self._file_stamp(row)
        if row.entry is None or stamp == row.stamp:
            return

        row.stamp = stamp
        row.recording = None
        row.state = "waiting"
        self.revision += 1
        row.revision = self.revision
        self._start_worker()

    def _file_stamp(self, row: Row) -> FileStamp | None:
        """Return the stamp of a recording's file; `None` if there is no such file."""
        path = self.source
        if row.entry is not None:
            path = resolve_index_path(self._root, row.entry.file)
        try:
            return file_stamp(path)
        except (SwashTwinError, OSError):
            return None

    def _replace_table(self, table: Mapping[str, Any]) -> None:
        defaults = table.get("defaults", {})
        rows = [_parse_row({**defaults, **values}) for values in table.get("recording", ())]
        self._replace_rows(rows, str(table.get("root", "")))

    def _replace_rows(self, rows: Sequence[Row], root: str = "") -> None:
        """Replace all rows; one whose facts are the same stays as it is, with its recording."""
        with self._lock:
            previous_rows = self.rows
            self._root = resolve_index_path(self.folder, root)
            self.rows = {row.name: row for row in rows}
            self.revision += 1
            for name, row in self.rows.items():
                row.revision = self.revision
                previous_row = previous_rows.get(name)
                is_unchanged = (
                    previous_row is not None
                    and bool(previous_row.specified)
                    and previous_row.specified == row.specified
                )
                if previous_row is not None and is_unchanged:
                    self.rows[name] = previous_row
                else:
                    row.stamp = self._file_stamp(row)
            self._start_worker()

    def _start_worker(self) -> None:
        if self._is_shown and (self._worker is None or not self._worker.is_alive()):
            self._worker = threading.Thread(target=self._inspect_all, daemon=True)
            self._worker.start()

    def _inspect_all(self) -> None:
        """Open and inspect each waiting recording, then compare all of them."""
        while True:
            with self._lock:
                revision = self.revision
                waiting_rows = [row for row in self.rows.values() if row.state == "waiting"]
            if not waiting_rows:
                break
            # A large file must not hold up the others.
            self._inspect(min(waiting_rows, key=_file_size))
            time.sleep(0)  # requests of the page go first

        findings = self._compare_recordings()
        with self._lock:
            self.findings = findings
            self._worker = None
            # Rows may have changed while they were compared.
            if self.revision > revision:
                self._start_worker()
            self.revision += 1

    def _inspect(self, row: Row) -> None:
        version = row.version
        recording = row.recording
        rms: list[float] = []
        self._inspected = version
        try:
            recording = recording or self._open_entry(row)
            self._show_opened(row, version, recording)
            rms = _sparkline(self._keep_pyramid(version, recording))
            (report,) = inspect_recordings([recording]).recordings
            findings = [finding.to_dict() for finding in report.findings]
            state = "ready"
        except Exception as cause:
            # No recording may end the worker, for which all others wait.
            findings = [_finding("unreadable", "error", cause)]
            state = "broken"

        with self._lock:
            self._inspected = None
            if row.version != version:
                return  # recorded anew meanwhile; it waits for its next inspection
            row.findings = findings
            row.rms = rms
            row.state = state
            row.recording = None if recording is None else recording.unloaded()
            self.revision += 1
            row.revision = self.revision

    def _show_opened(self, row: Row, version: RecordingVersion, recording: Recording) -> None:
        """Show the facts of a recording before it is inspected, which may take long."""
        with self._lock:
            if row.version == version:
                row.recording = recording
                self.revision += 1
                row.revision = self.revision

    def _compare_recordings(self) -> list[dict[str, Any]]:
        """Return findings that concern several recordings."""
        recordings = [recording for _, recording in self.ready_recordings()]
        if not recordings:
            return []
        try:
            return [
                finding.to_dict() for finding in inspect_recordings(Recordings(recordings)).findings
            ]
        except Exception as cause:
            return [_finding("comparison", "warning", cause)]

    def _open_entry(self, row: Row) -> Recording:
        # An entry that was refused is parsed again, which raises the error again.
        entry = row.entry or Entry.from_mapping(row.specified, str(self.index))
        return load_entry(resolve_index_path(self._root, entry.file), entry)

    def table(self, since: int = -1) -> dict[str, Any]:
        """Return rows that changed after a revision, the names of all, and facts of the whole."""
        self.refresh()
        with self._lock:
            is_editable = self.index is not None and bool(self.rows)
            content = {
                "revision": self.revision,
                "waiting": sum(row.state == "waiting" for row in self.rows.values()),
                "rows": [row.to_dict() for row in self.rows.values() if row.revision > since],
                "names": list(self.rows),
                "findings": self.findings,
                "skipped": list(self.skipped),
                "source": str(self.source),
                "questions": self.questions,
                "editable": is_editable,
                "unwritten": is_editable and self._stamp is None,
            }
            # The first table is sent before the inspection starts, so that it appears at once.
            if not self._is_shown:
                self._is_shown = True
                self._start_worker()
            return content

    def change(self, changes: Sequence[FactChange], *, undo: bool) -> None:
        """Write changed facts into the index."""
        if self.index is None:
            raise InputError(f"{self.source} is not an index. Explore its folder to edit facts.")
        change_facts(self.index, changes, proposed=self._proposed, undo=undo)
        self.refresh()

    def version(self, name: str) -> RecordingVersion:
        """Return the present facts and file of a recording."""
        return self._row(name).version

    def _row(self, name: str) -> Row:
        """Return a row by its name; its recording is opened again if its file has changed."""
        with self._lock:
            if self.index is None:
                self._refresh_store()
            row = self.rows.get(name)
            if row is None:
                raise InputError(f"There is no recording {name[:200]!r}.")
            self._renew(row)
            return row

    def recording(self, name: str) -> Recording:
        """Return an open recording by the name of its row; the last few stay open."""
        with self._lock:
            row = self._row(name)
            version = row.version
            recording = row.recording
            if version in self._opened:
                self._opened.move_to_end(version)
                return self._opened[version]

        # Read without the lock: a large file must not hold up other requests.
        recording = self._open_entry(row) if recording is None else recording.unloaded()
        with self._lock:
            self._opened[version] = recording
            while len(self._opened) > _MAX_CACHED_RECORDINGS:
                self._opened.popitem(last=False)
        return recording

    def ready_recordings(self) -> list[tuple[str, Recording]]:
        """Return name and recording of each row that was read without error."""
        return [
            (row.name, row.recording)
            for row in list(self.rows.values())
            if row.state == "ready" and row.recording is not None
        ]

    def healthy_versions(self) -> list[RecordingVersion]:
        """Return the present facts and file of each healthy recording that may be readable."""
        self.refresh()
        with self._lock:
            return [
                row.version
                for row in self.rows.values()
                if row.state != "broken" and is_healthy(row.label)
            ]

    def pyramid(self, name: str) -> Pyramid:
        """Return extremes and root mean square along a recording; the last few stay."""
        version = self.version(name)
        return self._keep_pyramid(version, self.recording(name))

    def _keep_pyramid(self, version: RecordingVersion, recording: Recording) -> Pyramid:
        with self._lock:
            pyramid = self._pyramids.pop(version, None) or Pyramid(recording)
            self._pyramids[version] = pyramid
            while len(self._pyramids) > _MAX_CACHED_RECORDINGS:
                oldest = next(key for key in self._pyramids if key != self._inspected)
                self._pyramids.pop(oldest).stop()
            return pyramid

    def comparable(self, name: str, *, healthy: bool = False) -> list[str]:
        """Return recordings of the same machine, operating point and channels.

        Parameters
        ----------
        healthy : whether healthy recordings are returned, or those of the same class.
        """
        reference = self.rows[name].recording
        if reference is None:
            return []

        names = []
        for candidate_name, candidate in self.ready_recordings():
            if healthy:
                has_class = is_healthy(candidate.label or "")
            else:
                has_class = candidate.label == reference.label
            if candidate_name != name and has_class and _are_comparable(candidate, reference):
                names.append(candidate_name)
        return names


def _are_comparable(a: Recording, b: Recording) -> bool:
    if a.specimen != b.specimen:
        return False
    if (a.channels, a.unit, a.sample_rate) != (b.channels, b.unit, b.sample_rate):
        return False

    speed_a = specified_shaft_frequency(a) or math.nan
    speed_b = specified_shaft_frequency(b) or math.nan
    is_same_pressure = values_match(
        specified_pressure(a), specified_pressure(b), _PRESSURE_TOLERANCE
    )
    return bool(values_match(speed_a, speed_b, _SPEED_TOLERANCE) and is_same_pressure)


def _parse_row(specified: Mapping[str, Any]) -> Row:
    name = str(specified.get("id") or specified.get("file"))
    # TOML has dates, which become text as in JSON.
    specified = json.loads(json.dumps(specified, default=str))
    try:
        return Row(name, specified, Entry.from_mapping(specified, name))
    except SwashTwinError as cause:
        findings = [_finding("unreadable", "error", cause)]
        return Row(name, specified, state="broken", findings=findings)


def _finding(kind: str, severity: str, cause: Exception) -> dict[str, Any]:
    message = str(cause)
    if not isinstance(cause, (SwashTwinError, OSError)):
        # Of an unexpected error, the text alone may be empty, as that of too little memory.
        message = repr(cause)
    return {"kind": kind, "severity": severity, "channel": None, "message": message}


def _file_size(row: Row) -> int:
    return 0 if row.stamp is None else row.stamp.size


def _sparkline(pyramid: Pyramid) -> list[float]:
    """Return the root mean square over all channels in equal parts of a recording."""
    pyramid.wait()
    power = pyramid.rms(SPARKLINE_PARTS) ** 2

    # A channel whose sensor failed hides no other one.
    is_known = np.isfinite(power)
    n_known = np.maximum(np.count_nonzero(is_known, axis=0), 1)
    mean_power = np.sum(power, axis=0, where=is_known) / n_known
    # Four digits are more than a sparkline shows.
    return [float(f"{value:.4g}") for value in np.sqrt(mean_power)]
