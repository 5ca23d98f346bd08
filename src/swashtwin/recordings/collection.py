"""Recordings of one data set: loading, selecting and splitting them."""

import operator
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, overload

import numpy as np

from swashtwin.foundation import (
    DataError,
    InputError,
    LeakError,
    as_path,
    data_frame,
    html_table,
    plural,
    shorten,
)
from swashtwin.pump import PRESSURE_TOLERANCE, is_same_class, merge_close_values, values_match
from swashtwin.recordings.entry import CONDITION_FIELDS
from swashtwin.recordings.file_loading import load_recording
from swashtwin.recordings.findings import Finding, join_names
from swashtwin.recordings.group_split import select_test_rows
from swashtwin.recordings.grouping import (
    GROUP_SPEED_TOLERANCE,
    recording_groups,
    unknown_attribute_error,
)
from swashtwin.recordings.hdf5_store import is_store, load_store
from swashtwin.recordings.index_reading import load_index
from swashtwin.recordings.recording import Recording, require_unique_ids
from swashtwin.recordings.recording_facts import specified_pressure, specified_speed
from swashtwin.recordings.table_rows import table_rows

# Values that a message lists.
_MAX_LISTED_VALUES = 12


@dataclass(frozen=True)
class _Criterion:
    """One condition of `Recordings.where`."""

    description: str
    """Condition, such as ``"the label 'piston'"``."""
    noun: str
    """Plural of what is compared, with its unit."""
    values: Sequence[str | None]
    """Value of each recording, for messages."""
    are_met: Sequence[bool]
    """Whether each recording meets the condition."""


class Recordings(Sequence[Recording]):
    """Recordings of one data set, each with a unique id; `load_recordings` makes them.

    Samples in files are read on demand. A loop over the recordings has one signal in memory at a
    time: it forgets the signal that it read when it goes on. A recording that is taken by its
    number is a copy that keeps its signal.

    Parameters
    ----------
    recordings : in memory or in their files.

    Raises
    ------
    InputError
        Two recordings have one id.

    Examples
    --------
    >>> names = {"a": "normal", "b": "normal", "c": "piston", "d": "piston"}
    >>> signal = np.ones((1, 100))
    >>> recordings = Recordings(Recording(signal, 50.0, name, label=names[name]) for name in names)
    >>> recordings
    Recordings(4: 2 normal, 2 piston; 1 channel at 50 Hz)
    >>> train, test = recordings.split(test=0.5, seed=0)
    >>> sorted(test.labels)
    ['normal', 'piston']
    >>> recordings.where(label="piston").recording_ids
    ('c', 'd')
    """

    def __init__(self, recordings: Iterable[Recording]) -> None:
        self._recordings: tuple[Recording, ...] = ()
        unloaded = []
        for recording in recordings:
            if not isinstance(recording, Recording):
                raise InputError(
                    f"{recording!r} is not a recording; load a file with load_recordings."
                )
            unloaded.append(recording.unloaded())
        self._take(unloaded)

    @classmethod
    def _owning(cls, recordings: Iterable[Recording]) -> "Recordings":
        """Return a collection of recordings that only collections hold, without copying them."""
        collection = cls(())
        collection._take(recordings)
        return collection

    def _take(self, recordings: Iterable[Recording]) -> None:
        self._recordings = tuple(recordings)
        require_unique_ids(self.recording_ids, "a data set")

    def __len__(self) -> int:
        return len(self._recordings)

    def __iter__(self) -> Iterator[Recording]:
        for recording in self._recordings:
            was_loaded = recording.samples.is_loaded
            yield recording
            if not was_loaded:
                recording.samples.release()

    @overload
    def __getitem__(self, index: int) -> Recording: ...
    @overload
    def __getitem__(self, index: slice) -> "Recordings": ...
    def __getitem__(self, index: int | slice) -> "Recording | Recordings":
        if isinstance(index, slice):
            return Recordings._owning(self._recordings[index])
        return self._recordings[operator.index(index)].unloaded()

    def __add__(self, other: Iterable[Recording]) -> "Recordings":
        return Recordings([*self._recordings, *other])

    def __repr__(self) -> str:
        """Return a short text: recordings of each class, specimens, and channels."""
        if not self._recordings:
            return "Recordings(0)"

        labels = Counter(label or "no label" for label in self.labels)
        parts = [", ".join(f"{count} {label}" for label, count in labels.items())]
        specimens = {name for name in self.specimens if name}
        if specimens:
            parts.append(plural(len(specimens), "specimen"))

        rates = {recording.sample_rate for recording in self._recordings}
        rate = f"{min(rates):g} Hz" if len(rates) == 1 else f"{len(rates)} sample rates"
        counts = {recording.n_channels for recording in self._recordings}
        channels = " or ".join(str(count) for count in sorted(counts))
        parts.append(f"{channels} channel{'s' * (counts != {1})} at {rate}")
        return shorten(f"Recordings({len(self)}: {'; '.join(parts)})")

    def _repr_html_(self) -> str:
        header = (
            "recording",
            "class",
            "specimen",
            "speed",
            "pressure",
            "channels",
            "rate",
            "length",
        )
        rows = []
        for recording in self._recordings:
            speed = specified_speed(recording) * 30 / np.pi
            pressure = specified_pressure(recording) / 1e6

            cells = (
                recording.recording_id,
                recording.label,
                recording.specimen,
                "" if np.isnan(speed) else f"{speed:.5g} rev/min",
                "" if np.isnan(pressure) else f"{pressure:.4g} MPa",
                recording.n_channels,
                f"{recording.sample_rate:g} Hz",
                f"{recording.duration:.4g} s",
            )
            rows.append(cells)
        return html_table(repr(self), header, rows)

    def to_pandas(self) -> Any:
        """Return the facts as a ``pandas.DataFrame``, one row for each recording, in SI units.

        The columns are named as the attributes of `Recording` and `OperatingCondition`; each
        further attribute has a column. ``where(ids=frame.recording_id)`` returns the recordings of
        selected rows.

        Raises
        ------
        MissingExtraError
            pandas is not installed.

        Examples
        --------
        >>> Recordings([Recording(np.ones((1, 100)), 50.0, "a")]).to_pandas().duration.tolist()
        [2.0]
        """
        rows = []
        for recording in self._recordings:
            condition = dict.fromkeys(CONDITION_FIELDS.values(), np.nan)
            if recording.condition is not None:
                condition = asdict(recording.condition)

            facts = {
                "recording_id": recording.recording_id,
                "label": recording.label,
                "specimen": recording.specimen,
                **condition,
                "speed": specified_speed(recording),
                "discharge_pressure": specified_pressure(recording),
                "sample_rate": recording.sample_rate,
                "duration": recording.duration,
                "channels": recording.channels,
                "unit": recording.unit,
                "synthetic": recording.synthetic,
            }
            # An attribute of the same name does not replace a fact; the columns of facts are first.
            rows.append({**facts, **recording.attributes, **facts})
        return data_frame(rows)

    @classmethod
    def from_frame(cls, frame: Any, folder: str | Path = ".", **facts: Any) -> "Recordings":
        """Return the recordings of the files that a table lists; their samples are read on demand.

        Parameters
        ----------
        frame : data frame of pandas or polars, one row for each file. The column ``file`` names it,
            and other columns are facts as in `load_recording`: ``label``, ``specimen``, ``speed``,
            ``pressure``. Numbers are in SI units, texts have a unit (``"860 rpm"``), and blank
            cells are unknown. A column of another name becomes an attribute.
        folder : folder of the files.
        facts : facts of all files, such as ``unit="g"``.

        Raises
        ------
        InputError
            It is no such table, a name of a column is misspelt, or two recordings have one id.
        DataError
            A file is missing or damaged, or contradicts a fact.
        """
        recordings = []
        for row in table_rows(frame):
            path = Path(folder, row.pop("file"))
            recordings.append(load_recording(path, **{**facts, **row}))
        return cls._owning(recordings)

    @property
    def recording_ids(self) -> tuple[str, ...]:
        """Id of each recording."""
        return tuple(recording.recording_id for recording in self._recordings)

    @property
    def labels(self) -> tuple[str | None, ...]:
        """Class of each recording, None if it is unknown."""
        return tuple(recording.label for recording in self._recordings)

    @property
    def specimens(self) -> tuple[str | None, ...]:
        """Specimen of each recording, None if it is unknown."""
        return tuple(recording.specimen for recording in self._recordings)

    def where(
        self,
        *,
        label: str | None = None,
        specimen: str | None = None,
        speed: float | None = None,
        pressure: float | None = None,
        ids: Iterable[str] | None = None,
        **attributes: str,
    ) -> "Recordings":
        """Return the recordings that meet all conditions, in their order.

        Parameters
        ----------
        label : class; ``"healthy"``, ``"normal"`` and ``"ok"`` are the same.
        specimen : machine that was measured.
        speed : angular speed [rad/s], within 3 %, such as ``rpm(860)``.
        pressure : discharge pressure [Pa], within 6 %, such as ``MPa(15)``.
        ids : recording ids, such as those of a training set.
        attributes : further facts by name, such as ``day="Monday"``.

        Raises
        ------
        InputError
            No recording has an attribute of that name; the message names the nearest one.
        DataError
            No recording meets all conditions; the message lists the existing values.
        """
        criteria: list[_Criterion] = []
        if label is not None:
            are_met = [is_same_class(known_label, label) for known_label in self.labels]
            criteria.append(_Criterion(f"the label {label!r}", "labels", self.labels, are_met))
        if specimen is not None:
            are_met = [name == specimen for name in self.specimens]
            criteria.append(
                _Criterion(f"the specimen {specimen!r}", "specimens", self.specimens, are_met)
            )
        if speed is not None:
            speeds = [specified_speed(recording) for recording in self._recordings]
            criteria.append(
                _quantity_criterion(
                    "speed", "rev/min", 30 / np.pi, speed, speeds, GROUP_SPEED_TOLERANCE
                )
            )
        if pressure is not None:
            pressures = [specified_pressure(recording) for recording in self._recordings]
            criteria.append(
                _quantity_criterion(
                    "pressure", "MPa", 1e-6, pressure, pressures, PRESSURE_TOLERANCE
                )
            )
        if ids is not None:
            names = sorted({str(name) for name in ids})
            are_met = [name in names for name in self.recording_ids]
            criteria.append(
                _Criterion(f"the id {_join_values(names)}", "ids", self.recording_ids, are_met)
            )
        for name, value in attributes.items():
            criteria.append(self._attribute_criterion(name, value))

        selected = []
        for row, recording in enumerate(self._recordings):
            if all(criterion.are_met[row] for criterion in criteria):
                selected.append(recording)
        if not selected:
            raise _no_match_error(criteria)
        return Recordings._owning(selected)

    def _attribute_criterion(self, name: str, value: str) -> _Criterion:
        values = [recording.attributes.get(name) for recording in self._recordings]
        is_known = any(name in recording.attributes for recording in self._recordings)
        if self._recordings and not is_known:
            arguments = ("label", "specimen", "speed", "pressure", "ids")
            raise unknown_attribute_error(self._recordings, name, arguments)

        are_met = [str(known_value) == str(value) for known_value in values]
        return _Criterion(f"{name} {value!r}", f"{name}s", values, are_met)

    def split(
        self, test: float = 0.2, *, by: str = "recording", seed: int = 0
    ) -> "tuple[Recordings, Recordings]":
        """Return (training recordings, test recordings).

        Classes and operating points are as similar on both sides as possible.

        Parameters
        ----------
        test : share of the recordings to test on, above 0 and at most 0.5. With few groups it may
            be larger.
        by : what is kept whole: ``"recording"``, ``"specimen"``, ``"condition"`` (speed and
            pressure), or an attribute.
        seed : seed of the draw.

        Raises
        ------
        InputError
            The share is invalid, or no recording has the attribute.
        DataError
            There are fewer than two groups, some recordings specify none, or every test set would
            remove a class from training.
        LeakError
            A recording is synthetic. Add these to the training recordings afterwards.
        """
        if not 0 < test <= 0.5:
            raise InputError(f"test ({test:g}) must be above 0 and at most 0.5; a fifth is 0.2.")
        for recording in self._recordings:
            if recording.synthetic:
                raise LeakError(
                    f"{recording.recording_id} is synthetic; split the measured recordings first, "
                    "then add synthetic ones to training."
                )

        groups = np.array(list(recording_groups(self._recordings, by).values()))
        if np.unique(groups).size < 2:
            raise DataError(
                f"There is only one {by}; a split by {by} needs two. Split by another group."
            )
        labels = [str(label or "") for label in self.labels]
        classes = np.unique(labels, return_inverse=True)[1]
        rows = select_test_rows(
            classes, self._strata(classes), groups, test, seed, every_class=False
        )
        if rows is None:
            raise DataError(
                f"Every split by {by} removes a class from training, because no {by} shares its "
                "classes with another; split by another group."
            )

        test_rows = set(rows.tolist())
        training_recordings: list[Recording] = []
        test_recordings: list[Recording] = []
        for row, recording in enumerate(self._recordings):
            (test_recordings if row in test_rows else training_recordings).append(recording)
        return Recordings._owning(training_recordings), Recordings._owning(test_recordings)

    def _strata(self, classes: np.ndarray) -> np.ndarray:
        """Return the number of each combination of class and operating point."""
        speed = np.array([specified_speed(recording) for recording in self._recordings])
        pressure = np.array([specified_pressure(recording) for recording in self._recordings])
        columns = (
            classes,
            merge_close_values(speed, GROUP_SPEED_TOLERANCE),
            merge_close_values(pressure, PRESSURE_TOLERANCE),
        )
        combinations = [f"{row}" for row in zip(*columns, strict=True)]
        strata: np.ndarray = np.unique(combinations, return_inverse=True)[1]
        return strata


def load_recordings(
    path: str | Path | Iterable[str | Path],
    *,
    unreadable: list[Finding] | None = None,
    **facts: Any,
) -> Recordings:
    """Return the recordings of an index, a store or files; their samples are read on demand.

    Parameters
    ----------
    path : index file, folder that holds ``recordings.toml``, store (`write_store`), one file of a
        measurement, or a list of these.
    unreadable : receives a finding for each file of an index that cannot be loaded; by default the
        first one is an error.
    facts : for single files the facts that the file does not state, as in `load_recording`. For an
        index or a store, ``label`` and ``specimen`` select: only the files of these are opened.

    Raises
    ------
    MissingFileError
        A file or an index is missing. ``swashtwin index FOLDER`` proposes an index.
    DataError
        The index or a file is damaged, or one contradicts the other.
    InputError
        Two recordings have one id, or other facts were given for an index or a store.
    """
    if isinstance(path, str) or not isinstance(path, Iterable):
        path = [path]

    recordings: list[Recording] = []
    for source in path:
        source = as_path(source)
        if source.is_dir() or source.suffix == ".toml" or is_store(source):
            selection = {key: value for key, value in facts.items() if value is not None}
            recordings += _load_collection(source, unreadable, selection)
        else:
            recordings.append(load_recording(source, **facts))

    for recording in recordings:
        recording.samples.release()
    return Recordings._owning(recordings)


def _load_collection(
    source: Path, unreadable: list[Finding] | None, selection: dict[str, Any]
) -> Iterable[Recording]:
    """Return the selected recordings of an index or a store."""
    for fact in selection:
        if fact not in ("label", "specimen"):
            raise InputError(
                f"{fact} is for single files, and {source} states it itself; edit the index, or "
                "write the store again.",
                field=fact,
            )

    if is_store(source):
        recordings = load_store(source)
    else:
        recordings = load_index(source, unreadable, **selection)
        if selection and not recordings:  # load all, for the message that lists their values
            recordings = load_index(source, unreadable)
    return Recordings._owning(recordings).where(**selection) if selection else recordings


def _quantity_criterion(
    name: str,
    unit: str,
    scale: float,
    required_value: float,
    values: Sequence[float],
    tolerance: float,
) -> _Criterion:
    """Return the condition of a quantity; `scale` converts SI to `unit`."""
    return _Criterion(
        description=f"the {name} {required_value * scale:.4g} {unit}",
        noun=f"{name}s [{unit}]",
        values=[f"{value * scale:.4g}" for value in sorted(values)],
        are_met=[bool(values_match(value, required_value, tolerance)) for value in values],
    )


def _no_match_error(criteria: Sequence[_Criterion]) -> DataError:
    conditions = " and ".join(criterion.description for criterion in criteria)
    existing = "; ".join(
        f"{criterion.noun} {_join_values(criterion.values)}" for criterion in criteria
    )
    return DataError(f"No recording has {conditions or 'passed'}; there are {existing or 'none'}.")


def _join_values(values: Iterable[str | None]) -> str:
    texts = ["none" if value in (None, "nan") else str(value) for value in values]
    return join_names(list(dict.fromkeys(texts)), _MAX_LISTED_VALUES)
