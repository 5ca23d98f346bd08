"""Recordings in the cells of a study's plan, and as many windows of each as it asks for."""

from collections.abc import Sequence

from swashtwin.errors import DataError
from swashtwin.faults import CLASSES
from swashtwin.recording import Recording
from swashtwin.windows import WindowSet, cut_windows


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
    cells: dict[tuple[str, str, float], list[Recording]] = {}
    for recording in sorted(recordings, key=lambda r: r.recording_id):
        if recording.label is None or recording.specimen is None or recording.condition is None:
            raise DataError(
                f"{recording.recording_id}: {study} needs label, specimen, speed and discharge_pressure of every "
                "recording; write them into the index."
            )
        pressure = round(recording.condition.discharge_pressure, -4)
        cells.setdefault((recording.specimen, recording.label, pressure), []).append(recording)
    return list(cells.values())


def cut_evenly(recordings: Sequence[Recording], *, length: int, count: int, like: WindowSet | None = None) -> WindowSet:
    """About `count` windows of each recording, evenly spaced and never overlapping.

    Parameters
    ----------
    length : readings per window.
    count : windows of the shortest recording.
    like : windows whose length and classes are taken over; by default the classes are the paper's, or, where one has
        another name, those found.
    """
    shortest = min(r.signal.shape[1] for r in recordings)
    stride = max(length, (shortest - length) // max(1, count - 1))
    if like is not None:
        return cut_windows(list(recordings), like=like, stride=stride)
    labels = {str(r.label) for r in recordings}
    classes = CLASSES if labels <= set(CLASSES) else tuple(sorted(labels))
    return cut_windows(list(recordings), length=length, stride=stride, classes=classes)
