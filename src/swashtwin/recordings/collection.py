"""Recordings of one data set, loaded from an index, a store or files, and the ways to select and
split them.
"""

import operator
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, overload

import numpy as np

from swashtwin.foundation import DataError, InputError, LeakError, as_path
from swashtwin.pump import PRESSURE_TOLERANCE, is_same_class, merge_close_values, values_match
from swashtwin.recordings.channel_checks import Finding, listed
from swashtwin.recordings.files import is_store, load_store
from swashtwin.recordings.grouping import (
    GROUP_SPEED_TOLERANCE,
    recording_groups,
    select_test_rows,
    specified_pressure,
    specified_speed,
    unknown_attribute,
)
from swashtwin.recordings.index import load_index
from swashtwin.recordings.loading import load_recording
from swashtwin.recordings.recording import Recording, require_unique_ids


class Recordings(Sequence[Recording]):
    """Recordings of one data set, each with an id of its own; `load_recordings` makes them.

    Every access gives a `Recording` that reads its samples when they are asked for, and forgets
    them with the last reference to it: a loop over the recordings has one signal in memory at a
    time.

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
    >>> recordings = Recordings(Recording(np.ones((1, 100)), 50.0, name, label=names[name]) for name in names)
    >>> recordings
    Recordings(4: 2 normal, 2 piston; 1 channel at 50 Hz)
    >>> train, test = recordings.split(test=0.5, seed=0)
    >>> sorted(test.labels)
    ['normal', 'piston']
    >>> recordings.where(label="piston").recording_ids
    ('c', 'd')
    """

    def __init__(self, recordings: Iterable[Recording]) -> None:
        recordings = list(recordings)
        for item in recordings:
            if not isinstance(item, Recording):
                raise InputError(f"{item!r} is no recording; a file is loaded by load_recordings.")
        self._recordings = tuple(recording.unloaded() for recording in recordings)
        require_unique_ids(self.recording_ids, "a data set")

    def __len__(self) -> int:
        return len(self._recordings)

    def __iter__(self) -> Iterator[Recording]:
        return (recording.unloaded() for recording in self._recordings)

    @overload
    def __getitem__(self, index: int) -> Recording: ...
    @overload
    def __getitem__(self, index: slice) -> "Recordings": ...
    def __getitem__(self, index: int | slice) -> "Recording | Recordings":
        if isinstance(index, slice):
            return Recordings(self._recordings[index])
        return self._recordings[operator.index(index)].unloaded()

    def __add__(self, other: Iterable[Recording]) -> "Recordings":
        return Recordings([*self._recordings, *other])

    def __repr__(self) -> str:
        """Short text: how many of each class, of how many specimens, and their channels."""
        labels = Counter(label or "no label" for label in self.labels)
        parts = [", ".join(f"{count} {label}" for label, count in labels.items())]
        if specimens := {name for name in self.specimens if name}:
            parts.append(f"{len(specimens)} specimen{'s' * (len(specimens) != 1)}")
        rates = {recording.sample_rate for recording in self._recordings}
        counts = {recording.n_channels for recording in self._recordings}
        rate = f"{next(iter(rates)):g} Hz" if len(rates) == 1 else f"{len(rates)} sample rates"
        channels = " or ".join(str(count) for count in sorted(counts))
        parts.append(f"{channels} channel{'s' * (counts != {1})} at {rate}")
        return (
            f"Recordings({len(self)}: {'; '.join(parts)})" if self._recordings else "Recordings(0)"
        )

    @property
    def recording_ids(self) -> tuple[str, ...]:
        """Id of each recording."""
        return tuple(recording.recording_id for recording in self._recordings)

    @property
    def labels(self) -> tuple[str | None, ...]:
        """Class of each recording, None where it is not known."""
        return tuple(recording.label for recording in self._recordings)

    @property
    def specimens(self) -> tuple[str | None, ...]:
        """Specimen of each recording, None where it is not known."""
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
        """Recordings that meet every condition given, in their order.

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
            No recording has an attribute of that name; the nearest name is offered.
        DataError
            No recording is left; the message lists the values that there are.
        """
        tests: list[tuple[str, str, Sequence[str | None], list[bool]]] = []
        if label is not None:
            are_met = [is_same_class(each, label) for each in self.labels]
            tests.append((f"the label {label!r}", "labels", self.labels, are_met))
        if specimen is not None:
            are_met = [each == specimen for each in self.specimens]
            tests.append((f"the specimen {specimen!r}", "specimens", self.specimens, are_met))
        for noun, wanted, stated, tolerance, factor, unit in (
            ("speed", speed, specified_speed, GROUP_SPEED_TOLERANCE, 30 / np.pi, "rev/min"),
            ("pressure", pressure, specified_pressure, PRESSURE_TOLERANCE, 1e-6, "MPa"),
        ):
            if wanted is not None:
                values = [stated(recording) for recording in self._recordings]
                are_met = [bool(values_match(value, wanted, tolerance)) for value in values]
                texts = [f"{value * factor:.4g}" for value in sorted(values)]
                tests.append(
                    (
                        f"the {noun} {wanted * factor:.4g} {unit}",
                        f"{noun}s [{unit}]",
                        texts,
                        are_met,
                    )
                )
        if ids is not None:
            names = sorted({str(name) for name in ids})
            are_met = [each in names for each in self.recording_ids]
            tests.append((f"the id {_listed(names)}", "ids", self.recording_ids, are_met))
        for name, value in attributes.items():
            if self._recordings and not any(
                name in recording.attributes for recording in self._recordings
            ):
                raise unknown_attribute(
                    self._recordings, name, ("label", "specimen", "speed", "pressure", "ids")
                )
            present = [recording.attributes.get(name) for recording in self._recordings]
            tests.append(
                (
                    f"{name} {value!r}",
                    f"{name}s",
                    present,
                    [str(each) == str(value) for each in present],
                )
            )
        left = [
            recording
            for recording, *are_met in zip(
                self._recordings, *(each[-1] for each in tests), strict=True
            )
            if all(are_met)
        ]
        if not left:
            conditions = " and ".join(words for words, *_ in tests) or "passed"
            values_there = (
                "; ".join(f"{noun} {_listed(values)}" for _, noun, values, _ in tests) or "none"
            )
            raise DataError(f"no recording has {conditions}; there are {values_there}.")
        return Recordings(left)

    def split(
        self, test: float = 0.2, *, by: str = "recording", seed: int = 0
    ) -> "tuple[Recordings, Recordings]":
        """(training recordings, test recordings), with the classes and conditions as alike on both
        sides as can be.

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
            A share that cannot be, or an attribute that no recording has.
        DataError
            There are fewer than two groups, some recordings state none, or every test set would
            take a class out of training.
        LeakError
            A recording is synthetic. Add these to the training recordings afterwards.
        """
        if not 0 < test <= 0.5:
            raise InputError(f"test ({test:g}) must be above 0 and at most 0.5; a fifth is 0.2.")
        for recording in self._recordings:
            if recording.synthetic:
                raise LeakError(
                    f"{recording.recording_id} is synthetic; split the measured recordings first, then add synthetic "
                    "ones to training."
                )
        groups = np.array(list(recording_groups(self._recordings, by).values()))
        if np.unique(groups).size < 2:
            raise DataError(
                f"there is only one {by}; a split by {by} needs two. Split by another group."
            )
        classes = np.unique([str(label or "") for label in self.labels], return_inverse=True)[1]
        speed = np.array([specified_speed(recording) for recording in self._recordings])
        pressure = np.array([specified_pressure(recording) for recording in self._recordings])
        levels = (
            merge_close_values(speed, GROUP_SPEED_TOLERANCE),
            merge_close_values(pressure, PRESSURE_TOLERANCE),
        )
        cells = np.unique(
            [f"{row}" for row in zip(classes, *levels, strict=True)], return_inverse=True
        )[1]
        rows = select_test_rows(classes, cells, groups, test, seed, every_class=False)
        if rows is None:
            raise DataError(
                f"every split by {by} takes a class out of training, because each {by} has classes of its own; split "
                "by another group."
            )
        tested = set(rows.tolist())
        sides: tuple[list[Recording], list[Recording]] = ([], [])
        for row, recording in enumerate(self._recordings):
            sides[row in tested].append(recording)
        return Recordings(sides[0]), Recordings(sides[1])


def load_recordings(
    path: str | Path | Iterable[str | Path],
    *,
    unreadable: list[Finding] | None = None,
    **facts: Any,
) -> Recordings:
    """Recordings of an index, a store or files; their samples are read when they are asked for.

    Parameters
    ----------
    path : index file, folder that holds ``recordings.toml``, store (`write_store`), one file of a
        measurement, or a list of these.
    unreadable : gets a finding for each file of an index that cannot be loaded, instead of an error
        for the first.
    facts : for single files what the file does not say, as in `load_recording`. Of an index or a
        store ``label`` and ``specimen`` select: only the files of these are opened.

    Raises
    ------
    MissingFileError
        A file or an index is missing. ``swashtwin index FOLDER`` proposes an index.
    DataError
        The index or a file is damaged, or one contradicts the other.
    InputError
        Two recordings have one id, or other facts were given for an index or a store.
    """
    recordings: list[Recording] = []
    for source in [path] if isinstance(path, str) or not isinstance(path, Iterable) else path:
        source = as_path(source)
        if not (source.is_dir() or source.suffix == ".toml" or is_store(source)):
            recordings.append(load_recording(source, **facts))
            continue
        chosen = {key: value for key, value in facts.items() if value is not None}
        for fact in chosen:
            if fact not in ("label", "specimen"):
                raise InputError(
                    f"{fact} is for single files, and {source} states it itself; edit the index, or write the store "
                    "again."
                )
        if is_store(source):
            found = load_store(source)
        else:
            found = load_index(source, unreadable, **chosen)
            if chosen and not found:
                found = load_index(source, unreadable)
        recordings += Recordings(found).where(**chosen) if chosen else found
    return Recordings(recordings)


def _listed(values: Iterable[str | None]) -> str:
    return listed(
        list(dict.fromkeys("none" if value in (None, "nan") else str(value) for value in values)),
        12,
    )
