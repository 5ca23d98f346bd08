"""Recordings in the cells of a study's plan, and as many windows of each as it asks for."""

from collections.abc import Sequence

import numpy as np

from swashtwin.foundation import DataError
from swashtwin.learning import WindowSet, cut_windows
from swashtwin.pump import CLASSES, PRESSURE_TOLERANCE, merge_close_values
from swashtwin.recordings import Recording


def recordings_by_cell(recordings: Sequence[Recording], study: str) -> list[list[Recording]]:
    """Recordings of each specimen, class and discharge pressure.

    Parameters
    ----------
    study : what the study is called where something is missing.

    Raises
    ------
    DataError
        A recording does not say what it is of.
    """
    recordings = sorted(recordings, key=lambda r: r.recording_id)
    cells: dict[tuple[str, str, float], list[Recording]] = {}
    for recording in recordings:
        if recording.label is None or recording.specimen is None or recording.condition is None:
            raise DataError(
                f"{recording.recording_id}: {study} needs label, specimen, speed and discharge_pressure of every "
                "recording; write them into the index."
            )
    stated = np.array(
        [r.condition.discharge_pressure for r in recordings if r.condition is not None]
    )
    for recording, pressure in zip(
        recordings, merge_close_values(stated, PRESSURE_TOLERANCE), strict=True
    ):
        cells.setdefault(
            (str(recording.specimen), str(recording.label), float(pressure)), []
        ).append(recording)
    return list(cells.values())


def order_classes(recordings: Sequence[Recording]) -> tuple[str, ...]:
    """Classes of the recordings: the paper's order where it knows them all, else the alphabet's."""
    labels = {str(r.label) for r in recordings}
    in_order = tuple(name for name in CLASSES if name in labels)
    return in_order if len(in_order) == len(labels) else tuple(sorted(labels))


def cut_evenly(
    recordings: Sequence[Recording],
    *,
    length: int,
    count: int,
    like: WindowSet | None = None,
    classes: Sequence[str] = CLASSES,
) -> WindowSet:
    """About `count` windows of each recording, evenly spaced and never overlapping.

    Parameters
    ----------
    length : samples per window.
    count : windows of the shortest recording.
    like : windows whose length and classes are taken over.
    classes : class names, where there is no `like`.
    """
    shortest = min(r.signal.shape[1] for r in recordings)
    stride = max(length, (shortest - length) // max(1, count - 1))
    if like is not None:
        length, classes = like.length, like.classes
    return cut_windows(list(recordings), length=length, stride=stride, classes=tuple(classes))
