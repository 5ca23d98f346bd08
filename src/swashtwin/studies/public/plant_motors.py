"""Plant motors, blocks apart: standard statistics without a level, since one machine of each class is all there is."""

from collections.abc import Sequence

import numpy as np
from scipy.signal import hilbert

from swashtwin.features import ENVELOPE_STATISTICS
from swashtwin.indicators.statistics import TIME_STATISTICS, time_statistics
from swashtwin.recording import Recording
from swashtwin.studies.public.question import Fold, Question, Setting
from swashtwin.studies.public.usual import units_of, usual_windows

_PAIRS = (
    (("hA", "fA"), ("hB", "fB")),
    (("hB", "fB"), ("hA", "fA")),
    (("hB", "fA"), ("hA", "fB")),
    (("hA", "fB"), ("hB", "fA")),
)
"""Blocks to learn from, and blocks to be told apart."""
_OF_LEVEL = ("mean", "deviation", "rms", "peak", "peak_to_peak", "mean_absolute")
_QUARTERS = 4


def motor_questions(recordings: Sequence[Recording], jobs: int) -> list[Question]:
    """The question ``motor_pump_industrial/block``."""
    del jobs  # nothing here takes long
    signal = np.stack([recording.signal for recording in recordings])
    statistics = np.concatenate([_shape_statistics(signal[:, axis]) for axis in range(signal.shape[1])], axis=1)
    quarter = _quarters(recordings)
    units = units_of(recordings, _block, lambda one: quarter[one.recording_id], {"shape statistics": statistics})
    estimators = ("linear discriminant", "shrunk discriminant", "logistic 0.1", "logistic 1")
    settings = tuple(Setting("shape statistics", name) for name in estimators)
    folds = tuple(Fold(" + ".join(test), frozenset(train), frozenset(test)) for train, test in _PAIRS)
    windows = usual_windows(recordings, signal.shape[2], _block)
    return [Question("motor_pump_industrial/block", units, settings, folds, windows)]


def _shape_statistics(signal: np.ndarray) -> np.ndarray:
    """Statistics of the signal and of its envelope that no gain changes."""
    centered = signal - signal.mean(axis=1, keepdims=True)
    kept = [TIME_STATISTICS.index(name) for name in TIME_STATISTICS if name not in _OF_LEVEL]
    of_envelope = [TIME_STATISTICS.index(name) for name in ENVELOPE_STATISTICS if name not in _OF_LEVEL]
    envelope = time_statistics(np.abs(hilbert(centered, axis=1)))
    spread = envelope[:, [TIME_STATISTICS.index("deviation")]] / envelope[:, [TIME_STATISTICS.index("mean")]]
    return np.concatenate([time_statistics(centered)[:, kept], envelope[:, of_envelope], spread], axis=1)


def _block(recording: Recording) -> str:
    return recording.attributes["block"]


def _quarters(recordings: Sequence[Recording]) -> dict[str, str]:
    """Block and quarter of it, in the order of measurement: inner groups where a class has one block only."""
    blocks: dict[str, list[Recording]] = {}
    for recording in recordings:
        blocks.setdefault(_block(recording), []).append(recording)
    return {
        recording.recording_id: f"{block} {place * _QUARTERS // len(members)}"
        for block, members in blocks.items()
        for place, recording in enumerate(sorted(members, key=lambda one: int(one.recording_id.split("_")[-1])))
    }
