"""Recordings by cell (specimen, class and pressure), and windows cut evenly from them."""

from collections.abc import Sequence

import numpy as np

from swashtwin.foundation import DataError
from swashtwin.learning import WindowSet, cut_windows
from swashtwin.pump import CLASSES, PRESSURE_TOLERANCE, merge_close_values
from swashtwin.recordings import Recording


def recordings_by_cell(recordings: Sequence[Recording], study: str) -> list[list[Recording]]:
    """Return the recordings of each specimen, class and discharge pressure.

    Parameters
    ----------
    study : name of the study in error messages.

    Raises
    ------
    DataError
        A recording does not specify its label, specimen or operating point.
    """
    ordered = sorted(recordings, key=lambda recording: recording.recording_id)
    pressures = []
    for recording in ordered:
        if recording.label is None or recording.specimen is None or recording.condition is None:
            raise DataError(
                f"{recording.recording_id}: {study} needs label, specimen, speed and "
                "discharge_pressure of every recording. Write them into the index."
            )
        pressures.append(recording.condition.discharge_pressure)

    # Set pressures scatter from recording to recording: close ones are the same cell.
    cell_pressures = merge_close_values(np.array(pressures), PRESSURE_TOLERANCE)

    cells: dict[tuple[str, str, float], list[Recording]] = {}
    for recording, pressure in zip(ordered, cell_pressures, strict=True):
        cell = (str(recording.specimen), str(recording.label), float(pressure))
        cells.setdefault(cell, []).append(recording)

    return list(cells.values())


def order_classes(recordings: Sequence[Recording]) -> tuple[str, ...]:
    """Return the classes in the order of the paper if it has all of them, else alphabetically."""
    labels = {str(recording.label) for recording in recordings}
    paper_classes = tuple(name for name in CLASSES if name in labels)
    if len(paper_classes) == len(labels):
        return paper_classes
    return tuple(sorted(labels))


def cut_evenly(
    recordings: Sequence[Recording],
    *,
    length: int,
    count: int,
    like: WindowSet | None = None,
    classes: Sequence[str] = CLASSES,
) -> WindowSet:
    """Cut about `count` windows of each recording, evenly spaced and never overlapping.

    Parameters
    ----------
    length : samples per window.
    count : number of windows of the shortest recording.
    like : windows that specify length and classes.
    classes : class names, without `like`.
    """
    shortest = min(recording.signal.shape[1] for recording in recordings)
    stride = max(length, (shortest - length) // max(1, count - 1))
    if like is not None:
        length = like.length
        classes = like.classes

    return cut_windows(list(recordings), length=length, stride=stride, classes=tuple(classes))
