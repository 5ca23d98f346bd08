"""Recordings and labels as arguments: what is accepted, and what fits a model."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from swashtwin.foundation import DataError, InputError
from swashtwin.learning import WindowLayout, WindowSet
from swashtwin.recordings import Recording, Recordings


def as_recordings(X: Any) -> Sequence[Recording] | None:
    """Recordings in a sequence, or None where `X` is something else; an `InputError` where it is
    nothing at all.
    """
    if X is None or isinstance(X, (str, Path)):
        raise InputError(
            f"X is {X!r}; recordings are expected, as load_recordings(folder) gives them, or an array."
        )
    if isinstance(X, Recording):
        return [X]
    if isinstance(X, WindowSet) or hasattr(X, "shape") or not isinstance(X, Iterable):
        return None
    entries = X if isinstance(X, Recordings) else list(X)
    if not len(entries):
        raise InputError("X holds no recording and no window; give at least one.")
    if all(isinstance(entry, Recording) for entry in entries):
        return entries
    if isinstance(X, Iterator) or isinstance(entries[0], (str, Path)):
        raise InputError(
            f"X is a {type(X).__name__} over other things than recordings; give an array or a list."
        )
    return None


def require_recordings(X: Any) -> Sequence[Recording]:
    """Recordings in a sequence; an `InputError` where `X` is something else, which states no
    machine.
    """
    recordings = as_recordings(X)
    if recordings is None:
        raise InputError(
            f"X is a {type(X).__name__}; recordings are expected, which state machine and operating point."
        )
    return recordings


def relabeled(recordings: Sequence[Recording], y: Any) -> Sequence[Recording]:
    """The recordings with the classes `y`, or with their own labels where `y` is None."""
    if y is None:
        return recordings
    if isinstance(y, str):
        raise InputError(f"y is the one text {y!r}; give a list with a class for each recording.")
    y = list(y)
    if len(y) != len(recordings):
        raise InputError(
            f"y has {len(y)} labels for {len(recordings)} recordings; give one for each."
        )
    for index, label in enumerate(y):
        if label is None or label != label or not str(label).strip():
            raise InputError(
                f"y[{index}] ({label!r}) is no class; give one for each recording, or leave y out."
            )
    return [
        recording.replace(label=str(label)) for recording, label in zip(recordings, y, strict=True)
    ]


def require_recording(thing: object) -> None:
    """Refuse what is no single recording with an `InputError`."""
    if not isinstance(thing, Recording):
        raise InputError(
            f"a {type(thing).__name__} is no recording; give one Recording, such as load_recording makes of a file."
        )


def require_layout(layout: WindowLayout, recording: Recording) -> None:
    """Refuse a recording whose rate, channels or unit are not a model's with a `DataError` that
    says what to do.
    """
    require_recording(recording)
    actual = replace(
        layout,
        sample_rate=float(recording.sample_rate),
        channels=recording.channels,
        unit=recording.unit,
    )
    difference = layout.difference(actual)
    if not difference:
        return
    advice = (
        "say what the channels of the file are with --names, once for each, or take some of them with --channels, once "
        "for each"
    )
    if difference.startswith("sample rate"):
        advice = (
            f'if {recording.sample_rate:g} Hz is right, add --resample "{layout.sample_rate:g} Hz", or else correct '
            "--sample-rate"
        )
    elif difference.startswith("unit"):
        advice = 'state what a number in the file is: --sensitivity "100 mV/g" for volts, "1 g" for a plain number'
    raise DataError(
        f"{recording.recording_id} does not fit the model (what it was trained on against this recording): "
        f"{difference}; {advice}."
    )
