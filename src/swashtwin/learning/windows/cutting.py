"""Recordings to windows."""

import difflib
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float32

from swashtwin.foundation import DataError, InputError
from swashtwin.learning.windows.window_set import WindowSet
from swashtwin.recordings import (
    BLOCK_SAMPLES,
    Manifest,
    Recording,
    build_manifest,
    layout_findings,
    require_unique_ids,
    require_usable,
    specified_shaft_frequency,
    window_findings,
)

_WHOLE = 1 << 21
"""Samples of all channels up to which a recording is read once and held in memory while it is
cut.
"""


def cut_windows(
    recordings: Iterable[Recording],
    *,
    length: int,
    stride: int | None = None,
    classes: Sequence[str] | None = None,
    allow_partial_revolution: bool = False,
) -> WindowSet:
    """Windows of equal length, in the recordings' order; samples left over at a recording's end are
    dropped.

    Cut first and split afterwards: the split keeps each recording on one side, however the windows
    overlap.

    Parameters
    ----------
    recordings : in memory or in their files: these are read in blocks, and only windows are kept.
    length : samples per window.
    stride : samples from one window's start to the next one's; the default, `length`, lets none
        overlap.
    classes : class names in the order wanted, such as ``faults.CLASSES``; by default the labels
        found, sorted.
    allow_partial_revolution : accept windows shorter than one turn of the shaft. Not advised: such
        a window sees some pistons only, and its label may rest on a part of the turn where the
        fault is silent.

    Raises
    ------
    InputError
        Lengths, classes or labels that cannot be, or a window shorter than one revolution.
    DataError
        Recordings that do not fit together, are too short for one window, or are unfit (NaN, a
        constant channel).

    Examples
    --------
    >>> noise = np.random.default_rng(0).normal(size=(1, 1000))
    >>> windows = cut_windows([Recording(noise, 1000.0, "a", label="normal")], length=300)
    >>> windows.signal.shape, windows.start.tolist()
    ((3, 1, 300), [0, 300, 600])
    """
    recordings = list(recordings)
    if not recordings:
        raise DataError("no recording to cut windows from; check the folder or the selection.")
    require_unique_ids(
        (recording.recording_id for recording in recordings), "a training and its test"
    )
    if length < 2:
        raise InputError(
            f"a window of {length} sample(s) is too short to learn from; length counts samples."
        )
    stride = length if stride is None else stride
    if stride < 1:
        raise InputError(
            f"stride ({stride} samples) must be at least 1; {length} lets no window overlap."
        )
    for finding in layout_findings(recordings):
        raise DataError(finding.message)
    classes = _class_order(recordings, classes)
    _require_long_enough(recordings, length, allow_partial_revolution)
    parts: list[Float32[np.ndarray, "_window channel time"]] = []
    content: dict[str, tuple[str, ...]] = {}
    for stored in recordings:
        recording = _read_once(stored.unloaded())
        require_usable(recording)
        content |= build_manifest([recording])
        parts.append(_slices(recording, length, stride))
    return _assembled(recordings, parts, stride, classes, content)


def window_batches(
    recording: Recording,
    *,
    length: int,
    stride: int | None = None,
    classes: Sequence[str] | None = None,
    allow_partial_revolution: bool = False,
    batch: int = 1024,
) -> Iterator[WindowSet]:
    """The windows of `cut_windows`, at most `batch` at a time, for a recording whose windows are
    larger than memory.

    Raises
    ------
    InputError, DataError
        As in `cut_windows`, before the first windows come.
    """
    stride = length if stride is None else stride
    class_names = _class_order([recording], classes)
    _require_long_enough([recording], length, allow_partial_revolution)
    recording = _read_once(recording)
    require_usable(recording)
    count = 1 + (recording.n_samples - length) // stride
    for first in range(0, count, batch):
        last = min(first + batch, count)
        part = recording.slice(first * stride, (last - 1) * stride + length)
        windows = _assembled([part], [_slices(part, length, stride)], stride, class_names, {})
        yield replace(windows, start=windows.start + first * stride)


def _read_once(recording: Recording) -> Recording:
    """The recording, with its samples in memory where they are few, so that what follows does not
    read them again.
    """
    if recording.n_samples * recording.n_channels <= _WHOLE:
        recording.signal  # noqa: B018 - stays in memory
    return recording


def _class_order(recordings: Sequence[Recording], classes: Sequence[str] | None) -> tuple[str, ...]:
    if classes is None:
        return tuple(
            sorted({recording.label for recording in recordings if recording.label is not None})
        )
    for recording in recordings:
        if recording.label is not None and recording.label not in classes:
            near = difflib.get_close_matches(recording.label, classes, n=1, cutoff=0.3)
            hint = f" Did you mean {near[0]!r}?" if near else ""
            raise InputError(
                f"{recording.recording_id} has the label {recording.label!r}; the classes are "
                f"{', '.join(classes)}.{hint}"
            )
    return tuple(classes)


def _require_long_enough(
    recordings: Sequence[Recording], length: int, allow_partial_revolution: bool
) -> None:
    for finding in window_findings(
        recordings, length, allow_partial_revolution=allow_partial_revolution
    ):
        raise (InputError if finding.kind == "partial_turn" else DataError)(finding.message)


def _slices(
    recording: Recording, length: int, stride: int
) -> Float32[np.ndarray, "window channel time"]:
    count = 1 + (recording.n_samples - length) // stride
    windows = np.empty((count, len(recording.channels), length), dtype=np.float32)
    at_once = max(1, BLOCK_SAMPLES // stride)
    for first in range(0, count, at_once):
        last = min(first + at_once, count)
        signal = recording.slice(first * stride, (last - 1) * stride + length).signal
        views = np.lib.stride_tricks.sliding_window_view(signal, length, axis=1)[:, ::stride]
        windows[first:last] = views.transpose(1, 0, 2)
    return windows


def _assembled(
    recordings: Sequence[Recording],
    slices: Sequence[Float32[np.ndarray, "_window channel time"]],
    stride: int,
    classes: tuple[str, ...],
    content: Manifest,
) -> WindowSet:
    repeats = [len(part) for part in slices]
    index = {name: position for position, name in enumerate(classes)}
    conditions = [recording.condition for recording in recordings]
    pressure = [
        math.nan if condition is None else condition.discharge_pressure for condition in conditions
    ]
    speed = [
        (specified_shaft_frequency(recording) or math.nan) * 2 * math.pi
        if condition is None
        else condition.speed
        for recording, condition in zip(recordings, conditions, strict=True)
    ]
    target = [-1 if recording.label is None else index[recording.label] for recording in recordings]
    return WindowSet(
        signal=slices[0] if len(slices) == 1 else np.concatenate(slices),
        target=np.repeat(np.array(target, dtype=np.int64), repeats),
        classes=classes,
        recording_id=np.repeat(
            np.array([recording.recording_id for recording in recordings], dtype=np.str_), repeats
        ),
        specimen=np.repeat(
            np.array([recording.specimen or "" for recording in recordings], dtype=np.str_), repeats
        ),
        discharge_pressure=np.repeat(np.array(pressure, dtype=np.float64), repeats),
        speed=np.repeat(np.array(speed, dtype=np.float64), repeats),
        start=np.concatenate([np.arange(count, dtype=np.int64) * stride for count in repeats]),
        synthetic=np.repeat(
            np.array([recording.synthetic for recording in recordings], dtype=np.bool_), repeats
        ),
        sample_rate=float(recordings[0].sample_rate),
        channels=recordings[0].channels,
        unit=recordings[0].unit,
        content=content,
    )
