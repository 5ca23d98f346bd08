"""Recordings and labels as arguments: what is accepted, and what fits a model."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from swashtwin.foundation import DataError, InputError
from swashtwin.learning import WindowLayout, WindowSet
from swashtwin.recordings import Recording, Recordings


def as_recordings(X: Any) -> Sequence[Recording] | None:
    """Return `X` as a sequence of recordings, or None if it is a window set or an array.

    Raises
    ------
    InputError
        `X` is empty, or neither recordings, nor a window set, nor an array.
    """
    if X is None or isinstance(X, (str, Path)):
        raise InputError(
            f"X is {X!r}; recordings are expected, such as load_recordings(folder) returns, or an "
            "array."
        )
    if isinstance(X, Recording):
        return [X]
    if isinstance(X, WindowSet) or hasattr(X, "shape") or not isinstance(X, Iterable):
        return None

    # `Recordings` opens its files when they are read, so it is not made a list.
    entries = X if isinstance(X, Recordings) else list(X)
    if not len(entries):
        raise InputError("X holds no recording and no window; give at least one.")
    if all(isinstance(entry, Recording) for entry in entries):
        return entries
    if isinstance(X, Iterator) or isinstance(entries[0], (str, Path)):
        raise InputError(
            f"X is a {type(X).__name__} over other objects than recordings; give an array or a "
            "list of recordings."
        )
    return None


def require_recordings(X: Any) -> Sequence[Recording]:
    """Return `X` as a sequence of recordings; raise an `InputError` if it is something else."""
    recordings = as_recordings(X)
    if recordings is None:
        raise InputError(
            f"X is a {type(X).__name__}; recordings are expected, which specify machine and "
            "operating point."
        )
    return recordings


def relabel_recordings(recordings: Sequence[Recording], y: Any) -> Sequence[Recording]:
    """Return the recordings with the classes `y`, or with their own labels if `y` is None."""
    if y is None:
        return recordings
    if isinstance(y, str):
        raise InputError(f"y is the text {y!r}; give a list with the class of each recording.")

    labels = list(y)
    if len(labels) != len(recordings):
        raise InputError(
            f"y has {len(labels)} labels for {len(recordings)} recordings; give one for each."
        )
    for index, label in enumerate(labels):
        is_nan = label != label
        if label is None or is_nan or not str(label).strip():
            raise InputError(
                f"y[{index}] ({label!r}) is not a class; give one for each recording, or leave y "
                "out."
            )
    return [
        recording.replace(label=str(label))
        for recording, label in zip(recordings, labels, strict=True)
    ]


def require_recording(recording: object) -> None:
    """Raise an `InputError` if the argument is not a single recording."""
    if not isinstance(recording, Recording):
        raise InputError(
            f"A {type(recording).__name__} is not a recording; give one Recording, such as "
            "load_recording returns for a file."
        )


def require_layout(layout: WindowLayout, recording: Recording) -> None:
    """Raise a `DataError` if sample rate, channels or unit of a recording differ from a model's."""
    require_recording(recording)
    recording_layout = replace(
        layout,
        sample_rate=float(recording.sample_rate),
        channels=recording.channels,
        unit=recording.unit,
    )
    difference = layout.difference(recording_layout)
    if not difference:
        return

    if difference.startswith("sample rate"):
        field = "resample"
        remedy = (
            f"If {recording.sample_rate:g} Hz is right, set "
            f"{{resample='{layout.sample_rate:g} Hz'}}; otherwise correct {{sample_rate}}."
        )
    elif difference.startswith("unit"):
        field = "sensitivity"
        remedy = (
            "Specify what a number in the file means: {sensitivity='100 mV/g'} for volts, "
            "{sensitivity='1 g'} for a plain number."
        )
    elif len(recording.channels) < len(layout.channels):
        missing = [channel for channel in layout.channels if channel not in recording.channels]
        difference += f"; not among its channels: {', '.join(missing)}"
        field = "channels"
        remedy = "Read all channels of the file, or record the missing ones too."
    else:
        field = "names"
        remedy = (
            "Name the channels of the file with {names}, once for each, or select some of them "
            "with {channels}, once for each."
        )
    raise DataError(
        f"{recording.recording_id} does not fit the model (training against this recording): "
        f"{difference}.",
        field=field,
        remedy=remedy,
    )
