"""Cut recordings into windows of equal length."""

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float32

from swashtwin.foundation import DataError, InputError, closest_name
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


def cut_windows(
    recordings: Iterable[Recording],
    *,
    length: int,
    stride: int | None = None,
    classes: Sequence[str] | None = None,
    allow_partial_revolution: bool = False,
) -> WindowSet:
    """Cut recordings into windows of equal length, in the recordings' order.

    Samples left over at a recording's end are dropped. Cut first and split afterwards: the split
    keeps each recording on one side, however the windows overlap.

    Parameters
    ----------
    recordings : in memory or in their files. Files are read in blocks, and only windows are kept.
    length : samples per window.
    stride : samples from one window's start to the next one's; by default `length`, without
        overlap.
    classes : class names in their order, such as ``faults.CLASSES``; by default the labels of the
        recordings, sorted.
    allow_partial_revolution : accept windows shorter than one turn of the shaft. Not recommended:
        such a window covers some pistons only, and its label may rest on a part of the turn in
        which the fault is silent.

    Raises
    ------
    InputError
        Invalid lengths, classes or labels, or a window shorter than one revolution.
    DataError
        Recordings of different layouts, too short for one window, or unusable (NaN, a constant
        channel).

    Examples
    --------
    >>> noise = np.random.default_rng(0).normal(size=(1, 1000))
    >>> windows = cut_windows([Recording(noise, 1000.0, "a", label="normal")], length=300)
    >>> windows.signal.shape, windows.start.tolist()
    ((3, 1, 300), [0, 300, 600])
    """
    recordings = list(recordings)
    if not recordings:
        raise DataError(
            "There is no recording to cut windows from. Check the folder or the selection."
        )
    require_unique_ids(
        (recording.recording_id for recording in recordings), "a training and its test"
    )
    if length < 2:
        raise InputError(
            f"A window of {length} sample(s) is too short to learn from; length counts samples."
        )
    if stride is None:
        stride = length
    if stride < 1:
        raise InputError(
            f"stride ({stride} samples) must be at least 1; {length} gives windows without overlap."
        )
    for finding in layout_findings(recordings):
        raise DataError(finding.message)
    class_names = _class_order(recordings, classes)
    _require_long_enough(recordings, length, allow_partial_revolution)

    windows_by_recording: list[Float32[np.ndarray, "_window channel time"]] = []
    content: dict[str, tuple[str, ...]] = {}
    for stored in recordings:
        # Loaded for these steps only, so that memory does not keep the samples of all recordings.
        with stored.loaded() as recording:
            require_usable(recording)
            content.update(build_manifest([recording]))
            n_windows = _count_windows(recording, length, stride)
            windows_by_recording.append(_slices(recording, length, stride, 0, n_windows))
    return _assemble(recordings, windows_by_recording, stride, class_names, content)


def window_batches(
    recording: Recording,
    *,
    length: int,
    stride: int | None = None,
    classes: Sequence[str] | None = None,
    allow_partial_revolution: bool = False,
    batch: int = 1024,
) -> Iterator[WindowSet]:
    """Yield the windows of `cut_windows`, at most `batch` at a time.

    This is for a recording whose windows are larger than memory.

    Raises
    ------
    InputError, DataError
        As in `cut_windows`, before the first windows come.
    """
    if stride is None:
        stride = length
    class_names = _class_order([recording], classes)
    _require_long_enough([recording], length, allow_partial_revolution)
    with recording.loaded():
        require_usable(recording)
        n_windows = _count_windows(recording, length, stride)
        for first in range(0, n_windows, batch):
            end = min(first + batch, n_windows)
            windows = _slices(recording, length, stride, first, end)
            yield _assemble([recording], [windows], stride, class_names, {}, first * stride)


def _class_order(recordings: Sequence[Recording], classes: Sequence[str] | None) -> tuple[str, ...]:
    labels = {recording.label for recording in recordings if recording.label is not None}
    if classes is None:
        return tuple(sorted(labels))

    for recording in recordings:
        if recording.label is None or recording.label in classes:
            continue
        suggestion = closest_name(recording.label, classes)
        hint = f" Did you mean {suggestion!r}?" if suggestion else ""
        raise InputError(
            f"{recording.recording_id} has the label {recording.label!r}, which is not among the "
            f"classes {', '.join(classes)}.{hint}"
        )
    return tuple(classes)


def _require_long_enough(
    recordings: Sequence[Recording], length: int, allow_partial_revolution: bool
) -> None:
    findings = window_findings(
        recordings, length, allow_partial_revolution=allow_partial_revolution
    )
    for finding in findings:
        error = InputError if finding.kind == "partial_turn" else DataError
        raise error(finding.message)


def _count_windows(recording: Recording, length: int, stride: int) -> int:
    return 1 + (recording.n_samples - length) // stride


def _slices(
    recording: Recording, length: int, stride: int, first: int, end: int
) -> Float32[np.ndarray, "window channel time"]:
    """Return the windows from number `first` to before `end`; the file is read in blocks."""
    windows = np.empty((end - first, len(recording.channels), length), dtype=np.float32)
    block_size = max(1, BLOCK_SAMPLES // stride)
    for start in range(first, end, block_size):
        stop = min(start + block_size, end)
        signal = recording.samples.signal_part(start * stride, (stop - 1) * stride + length)
        views = np.lib.stride_tricks.sliding_window_view(signal, length, axis=1)[:, ::stride]
        windows[start - first : stop - first] = views.transpose(1, 0, 2)
    return windows


def _assemble(
    recordings: Sequence[Recording],
    windows_by_recording: Sequence[Float32[np.ndarray, "_window channel time"]],
    stride: int,
    classes: tuple[str, ...],
    content: Manifest,
    first_start: int = 0,
) -> WindowSet:
    """Join the windows of some recordings, each with the facts of its recording.

    Parameters
    ----------
    first_start : sample at which the first window of each recording starts.
    """
    class_index = {name: index for index, name in enumerate(classes)}
    targets = []
    pressures = []
    speeds = []
    for recording in recordings:
        targets.append(-1 if recording.label is None else class_index[recording.label])
        condition = recording.condition
        if condition is None:
            pressures.append(math.nan)
            speeds.append((specified_shaft_frequency(recording) or math.nan) * 2 * math.pi)
        else:
            pressures.append(condition.discharge_pressure)
            speeds.append(condition.speed)

    counts = [len(windows) for windows in windows_by_recording]
    if len(windows_by_recording) == 1:
        signal = windows_by_recording[0]  # a copy would double the memory
    else:
        signal = np.concatenate(windows_by_recording)

    def repeat(values: Sequence[Any], dtype: type) -> np.ndarray:
        """Return the value of each recording, once for each of its windows."""
        return np.repeat(np.array(values, dtype=dtype), counts)

    return WindowSet(
        signal=signal,
        target=repeat(targets, np.int64),
        classes=classes,
        recording_id=repeat([recording.recording_id for recording in recordings], np.str_),
        specimen=repeat([recording.specimen or "" for recording in recordings], np.str_),
        discharge_pressure=repeat(pressures, np.float64),
        speed=repeat(speeds, np.float64),
        start=np.concatenate(
            [first_start + np.arange(count, dtype=np.int64) * stride for count in counts]
        ),
        synthetic=repeat([recording.synthetic for recording in recordings], np.bool_),
        sample_rate=float(recordings[0].sample_rate),
        channels=recordings[0].channels,
        unit=recordings[0].unit,
        content=content,
    )
