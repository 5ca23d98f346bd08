"""What is looked at: recordings of an index, a folder, a store or a file, each with its facts,
level and findings.
"""

import json
import math
import threading
import time
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from fastapi import Query
from jaxtyping import Float32, Float64

from swashtwin.foundation import DataError, InputError, SwashTwinError
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
)

Name = Annotated[str, Query(max_length=1000)]
"""Name of a row, as an address states it."""
FACTS = ("label", "specimen", "speed", "pressure", "sensitivity", "unit", "sample_rate")
"""Facts that are edited."""
BIN = 64
"""Samples of the finest extremes that are kept of a whole recording."""
SPARK = 40
"""Levels of a recording's sparkline."""
_OPEN = 4
_AT_ONCE = 1 << 23
"""Samples of all channels that are read together."""
_SPEED, _PRESSURE = 0.03, 0.06
"""Relative differences up to which recordings are of one operating point."""


@dataclass
class Row:
    """One recording of the table."""

    name: str
    """Id of its entry, or its file."""
    stated: Mapping[str, Any] = field(default_factory=dict)
    """What the index states of it."""
    entry: Entry | None = None
    """The same, understood."""
    recording: Recording | None = None
    """The recording, its samples in the file; None until it is opened, and where it cannot be."""
    state: str = "waiting"
    """``waiting``, ``ready`` or ``broken``."""
    findings: list[dict[str, Any]] = field(default_factory=list)
    """What is wrong with it."""
    levels: list[float] = field(default_factory=list)
    """Root mean square over all channels, along the recording."""
    revision: int = 0
    """Number of the last change."""

    def to_dict(self) -> dict[str, Any]:
        """What the page shows."""
        shown: dict[str, Any] = {"name": self.name, "state": self.state, "findings": self.findings}
        shown |= {"levels": self.levels, "stated": {key: self.stated.get(key) for key in FACTS}}
        shown |= {key: self.stated.get(key) for key in ("label", "specimen", "file")}
        if (recording := self.recording) is not None:
            speed, pressure = specified_shaft_frequency(recording), specified_pressure(recording)
            shown |= {
                "label": recording.label,
                "specimen": recording.specimen,
                "id": recording.recording_id,
            }
            shown |= {
                "rpm": speed and 60 * speed,
                "mpa": None if math.isnan(pressure) else pressure / 1e6,
            }
            shown |= {
                "channels": recording.channels,
                "unit": recording.unit,
                "rate": recording.sample_rate,
            }
            shown |= {"duration": recording.duration, "samples": recording.n_samples}
        return shown


class Workspace:
    """Recordings of a source, opened and inspected in the background.

    Parameters
    ----------
    source : an index, a folder with or without one, a store, a file of a measurement, or a
        calibration, beside whose file an index may lie.

    Raises
    ------
    DataError
        There is nothing to look at.
    """

    def __init__(self, source: Path) -> None:
        self.source = source
        self.folder = source if source.is_dir() else source.parent
        self.calibration = source if source.suffix == ".json" else None
        is_index = source.is_dir() or source.suffix in (".toml", ".json")
        self.index = (
            (source if source.suffix == ".toml" else self.folder / INDEX_NAME) if is_index else None
        )
        self.rows: dict[str, Row] = {}
        self.findings: list[dict[str, Any]] = []
        self.skipped: Sequence[str] = ()
        self.questions: dict[str, str] = {}
        self.revision = 0
        self._proposed: dict[str, Any] | None = None
        self._stamp: tuple[int, int] | None = None
        self._lock = threading.RLock()
        self._opened: OrderedDict[str, Recording] = OrderedDict()
        self._extremes: OrderedDict[str, Float32[np.ndarray, "channel bin 2"]] = OrderedDict()
        self._worker: threading.Thread | None = None
        self._is_shown = False
        if self.index is None:
            self._take(
                {}, [Row(item.recording_id, recording=item) for item in load_recordings(source)]
            )
        elif source.is_dir() and not self.index.is_file():
            self.propose({})
        elif self.calibration is None or self.index.is_file():
            self.refresh()

    def propose(self, answers: Mapping[str, str]) -> None:
        """Propose an index of the folder, in memory; `questions` are what neither the files nor
        `answers` say.
        """
        self.questions = {}

        def ask(key: str, question: str) -> str | None:
            if not answers.get(key) and key != "label_pattern":
                self.questions[key] = question
            return answers.get(key) or None

        try:
            proposal = propose_index(self.folder, ask=ask)
        except DataError:
            if not self.questions:
                raise
            return
        self._proposed, self.skipped = dict(proposal.index), proposal.skipped
        self._take(self._proposed, None)

    def refresh(self) -> None:
        """Read the index again where its file changed."""
        if self.index is None or not self.index.is_file():
            return
        with self._lock:
            status = self.index.stat()
            if self._stamp != (stamp := (status.st_mtime_ns, status.st_ino)):
                self._take(read_index(self.index), None)
                self._stamp = stamp

    def _take(self, table: Mapping[str, Any], rows: list[Row] | None) -> None:
        with self._lock:
            old, self.rows = self.rows, {}
            self.revision += 1
            for values in table.get("recording", ()) if rows is None else ():
                row = _row({**table.get("defaults", {}), **values})
                self.rows[row.name] = row
            for row in rows or ():
                self.rows[row.name] = row
            for name, row in self.rows.items():
                row.revision = self.revision
                if (
                    (before := old.get(name)) is not None
                    and before.stated == row.stated
                    and before.stated
                ):
                    self.rows[name] = before
                else:
                    self._opened.pop(name, None)
                    self._extremes.pop(name, None)
            self._root = resolve_index_path(self.folder, str(table.get("root", "")))
            self._start()

    def _start(self) -> None:
        if self._is_shown and (self._worker is None or not self._worker.is_alive()):
            self._worker = threading.Thread(target=self._inspect, daemon=True)
            self._worker.start()

    def _inspect(self) -> None:
        """Open and inspect each recording that waits, then compare all of them."""
        while True:
            with self._lock:
                revision = self.revision
                row = next((row for row in self.rows.values() if row.state == "waiting"), None)
            if row is None:
                break
            recording = row.recording
            try:
                recording = recording or self._open_entry(row)
                (report,) = inspect_recordings([recording]).recordings
                findings, state = [asdict(finding) for finding in report.findings], "ready"
                power = np.mean([track**2 for track in level_track(recording, SPARK)], axis=0)
                levels = [
                    float(f"{value:.4g}") if math.isfinite(value) else 0.0
                    for value in np.sqrt(power)
                ]
            except (SwashTwinError, OSError) as cause:
                levels, state = [], "broken"
                findings = [
                    {
                        "kind": "unreadable",
                        "severity": "error",
                        "channel": None,
                        "message": str(cause),
                    }
                ]
            with self._lock:
                row.findings, row.levels, row.state = findings, levels, state
                row.recording = None if recording is None else recording.unloaded()
                self.revision += 1
                row.revision = self.revision
            time.sleep(0)  # who looks at a figure goes first
        ready = [
            row.recording
            for row in self.rows.values()
            if row.state == "ready" and row.recording is not None
        ]
        try:
            findings = (
                [asdict(finding) for finding in inspect_recordings(Recordings(ready)).findings]
                if ready
                else []
            )
        except (SwashTwinError, OSError) as cause:
            findings = [
                {
                    "kind": "comparison",
                    "severity": "warning",
                    "channel": None,
                    "message": str(cause),
                }
            ]
        with self._lock:
            self.findings = findings
            if self.revision > revision:
                self._worker = None
                self._start()
            self.revision += 1

    def _open_entry(self, row: Row) -> Recording:
        if row.entry is None:  # refused before
            Entry.from_mapping(row.stated, str(self.index))
        assert row.entry is not None
        return load_entry(resolve_index_path(self._root, row.entry.file), row.entry)

    def table(self, since: int = -1) -> dict[str, Any]:
        """Rows that changed after a revision, the names of all, and what is known of the whole."""
        self.refresh()
        with self._lock:
            rows = [row.to_dict() for row in self.rows.values() if row.revision > since]
            waiting = sum(row.state == "waiting" for row in self.rows.values())
            facts: dict[str, Any] = {"revision": self.revision, "waiting": waiting, "rows": rows}
            facts |= {
                "names": list(self.rows),
                "findings": self.findings,
                "skipped": list(self.skipped),
            }
            facts |= {"source": str(self.source), "questions": self.questions}
            editable = self.index is not None and bool(self.rows)
            if not self._is_shown:  # the first picture does not wait for the inspection
                self._is_shown = True
                self._start()
            return {**facts, "editable": editable, "unwritten": editable and self._stamp is None}

    def change(self, changes: Sequence[FactChange], *, undo: bool) -> None:
        """Write changed facts into the index."""
        if self.index is None:
            raise InputError(
                f"{self.source} is no index, and facts are edited in one; explore its folder instead."
            )
        change_facts(self.index, changes, proposed=self._proposed, undo=undo)
        self.refresh()

    def recording(self, name: str) -> Recording:
        """A recording by the name of its row, open; the last few stay so."""
        with self._lock:
            if name not in self.rows:
                raise InputError(f"there is no recording {name[:200]!r} any more.")
            if name in self._opened:
                self._opened.move_to_end(name)
                return self._opened[name]
            row = self.rows[name]
        recording = row.recording.unloaded() if row.recording is not None else self._open_entry(row)
        with self._lock:
            self._opened[name] = recording
            while len(self._opened) > _OPEN:
                self._opened.popitem(last=False)
        return recording

    def extremes(
        self, name: str, width: int, start: int, count: int
    ) -> Float32[np.ndarray, "channel bin 2"]:
        """Least and greatest sample of each of `count` bins of `width` samples from bin `start` on,
        fewer at the end.

        Parameters
        ----------
        width : samples of a bin: 1, or a multiple of `BIN`; of other widths there are none.
        """
        recording = self.recording(name)
        if width < BIN:
            first, last = start * width, min((start + count) * width, recording.n_samples)
            signal = (
                recording.slice(first, last).signal
                if first < last
                else np.zeros((recording.n_channels, 0))
            )
            return _binned(np.stack([signal, signal], axis=-1), width)
        with self._lock:
            whole = self._extremes.get(name)
        if whole is None:
            step = BIN << 14
            parts = [recording.slice(at, min(at + step, recording.n_samples)).signal
                     for at in range(0, recording.n_samples, step)]  # fmt: skip
            whole = np.concatenate(
                [_binned(np.stack([part, part], axis=-1), BIN) for part in parts], axis=1
            )
            with self._lock:
                self._extremes[name] = whole
                while len(self._extremes) > _OPEN:
                    self._extremes.popitem(last=False)
        ratio = width // BIN
        return _binned(whole[:, start * ratio : (start + count) * ratio], ratio)

    def alike(self, name: str, *, healthy: bool = False) -> list[str]:
        """Other recordings of the same machine, operating point and channels: of the same class, or
        healthy ones.
        """
        own = self.rows[name].recording
        return [
            row.name
            for row in list(self.rows.values())
            if own is not None and row.name != name and (other := row.recording) is not None and row.state == "ready"
            and (is_healthy(other.label or "") if healthy else other.label == own.label)
            and other.specimen == own.specimen
            and (other.channels, other.unit, other.sample_rate) == (own.channels, own.unit, own.sample_rate)
            and values_match(specified_shaft_frequency(other) or math.nan, specified_shaft_frequency(own) or math.nan, _SPEED)
            and values_match(specified_pressure(other), specified_pressure(own), _PRESSURE)
        ]  # fmt: skip


def _row(stated: Mapping[str, Any]) -> Row:
    name = str(stated.get("id") or stated.get("file"))
    stated = json.loads(json.dumps(stated, default=str))  # dates of TOML
    try:
        return Row(name, stated, Entry.from_mapping(stated, name))
    except SwashTwinError as cause:
        finding = {
            "kind": "unreadable",
            "severity": "error",
            "channel": None,
            "message": str(cause),
        }
        return Row(name, stated, state="broken", findings=[finding])


def level_track(recording: Recording, count: int) -> Float64[np.ndarray, "channel part"]:
    """Root mean square of each channel, its mean taken off, in `count` equal parts of a
    recording.
    """
    edges = np.linspace(0, recording.n_samples, min(count, recording.n_samples) + 1).astype(int)
    is_short = recording.n_samples * recording.n_channels <= _AT_ONCE
    whole = recording.slice(0, recording.n_samples).signal if is_short else None
    parts = (
        recording.slice(*ends).signal if whole is None else whole[:, slice(*ends)]
        for ends in pairwise(edges)
    )
    return np.stack([part.std(axis=1) for part in parts], axis=1)


def _binned(extremes: np.ndarray, width: int) -> Float32[np.ndarray, "channel bin 2"]:
    """Extremes of bins of `width` extremes, the last one of what is left."""
    at = np.arange(0, extremes.shape[1], width)
    if width == 1 or not at.size:
        return extremes.astype(np.float32)
    least = np.fmin.reduceat(extremes[..., 0], at, axis=1)
    return np.stack([least, np.fmax.reduceat(extremes[..., 1], at, axis=1)], axis=-1).astype(
        np.float32
    )
