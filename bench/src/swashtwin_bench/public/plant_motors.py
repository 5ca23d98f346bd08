"""Plant motors, blocks apart: textbook signs of faults that may only grow, since one machine of each class is there.

With one block of each class to learn from, nothing in training tells the machine from the fault. What does is known
beforehand: bad bearings and shafts out of line make harmonics, half orders, peaks and beats grow, never shrink.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from swashtwin.recordings import Recording
from swashtwin.signals import (
    TIME_STATISTICS,
    band_limited,
    hann_taper,
    line_frequencies,
    signal_envelope,
    time_statistics,
    transform,
)
from swashtwin_bench.public.question import Fold, Question, Setting, Split, units_of, usual_windows

_PAIRS = (
    (("hA", "fA"), ("hB", "fB")),
    (("hB", "fB"), ("hA", "fA")),
    (("hB", "fA"), ("hA", "fB")),
    (("hA", "fB"), ("hB", "fA")),
)
"""Training blocks and test blocks."""
_QUARTERS = 4
_HIGH = 200.0
"""Where the band of the bearings begins [Hz]."""
_SHAFT = (47.0, 51.0)
_LINE, _BESIDE, _NEAR = 0.6, 1.5, 8.0
"""Half-width of a line, how far its neighborhood keeps off it, and how far it reaches [Hz]."""


def motor_splits(recordings: Sequence[Recording]) -> list[Split]:
    """The split ``motor_pump_industrial/block``: a block of each class on either side."""
    folds = tuple(Fold(" + ".join(test), frozenset(train), frozenset(test)) for train, test in _PAIRS)
    return [Split("motor_pump_industrial/block", tuple(recordings), _block, folds)]


def motor_questions(recordings: Sequence[Recording], jobs: int) -> list[Question]:
    """The question ``motor_pump_industrial/block``."""
    del jobs  # nothing here takes long
    signs = np.stack([_fault_signs(recording) for recording in recordings])
    quarter = _quarters(recordings)
    units = units_of(recordings, _block, lambda recording: quarter[recording.recording_id], {"signs of faults": signs})
    settings = tuple(Setting("signs of faults", name) for name in ("growing signs 0.1", "growing signs 1"))
    (split,) = motor_splits(recordings)
    windows = usual_windows(recordings, recordings[0].signal.shape[1], _block)
    return [Question(split.name, units, settings, split.folds, windows)]


def _fault_signs(recording: Recording) -> Float[np.ndarray, " sign"]:
    """Logarithms of what grows with a faulty bearing, a misaligned or a loose shaft; the greatest of the axes."""
    rate, centered = recording.sample_rate, recording.signal - recording.signal.mean(axis=1, keepdims=True)
    lines = _Lines.of(centered, rate)
    high = band_limited(centered, rate, _HIGH, rate / 2)
    envelope = signal_envelope(high)
    beats = _Lines.of(envelope - envelope.mean(axis=1, keepdims=True), rate, lines.shaft)
    raw, fast = time_statistics(centered), time_statistics(high)
    kurtosis, crest = TIME_STATISTICS.index("kurtosis"), TIME_STATISTICS.index("crest_factor")
    first, above = lines.line(1), lines.frequency > _HIGH
    signs = (
        lines.line(2) / first,
        lines.line(3) / first,
        sum(lines.line(order) for order in range(4, 10)) / first,
        sum(lines.line(order) / lines.beside(order) for order in (0.5, 1.5, 2.5, 3.5)),
        raw[:, kurtosis],
        fast[:, kurtosis],
        fast[:, crest],
        sum(beats.line(order) / beats.around(order) for order in (1, 2, 3)),
        lines.power[:, above].sum(axis=1) / lines.power[:, 1:].sum(axis=1),
        envelope.std(axis=1) / envelope.mean(axis=1),
    )
    return np.log([np.max(sign) for sign in signs])


@dataclass(frozen=True, eq=False)
class _Lines:
    """Spectrum with the shaft's line found in it."""

    frequency: np.ndarray
    power: np.ndarray
    shaft: float

    @classmethod
    def of(cls, signal: np.ndarray, rate: float, shaft: float | None = None) -> "_Lines":
        """Spectrum of a signal; the shaft is the highest line that a two-pole motor on 50 Hz can have."""
        count = signal.shape[1]
        frequency = line_frequencies(count, rate)
        power = np.abs(transform(signal * hann_taper(count, symmetric=True))) ** 2
        if shaft is None:
            possible = (frequency > _SHAFT[0]) & (frequency < _SHAFT[1])
            relative = power / signal.var(axis=1, keepdims=True)
            shaft = float(frequency[possible][relative[:, possible].sum(axis=0).argmax()])
        return cls(frequency, power, shaft)

    def line(self, order: float) -> np.ndarray:
        """Power of a line of the shaft, for each axis."""
        return self.power[:, np.abs(self.frequency - order * self.shaft) <= _LINE].sum(axis=1)

    def beside(self, order: float) -> np.ndarray:
        """Median power within 8 Hz of a line, the line itself left out."""
        distance = np.abs(self.frequency - order * self.shaft)
        return np.median(self.power[:, (distance <= _NEAR) & (distance > _BESIDE)], axis=1)

    def around(self, order: float) -> np.ndarray:
        """Median power within 8 Hz of a line."""
        return np.median(self.power[:, np.abs(self.frequency - order * self.shaft) <= _NEAR], axis=1)


def _block(recording: Recording) -> str:
    return recording.attributes["block"]


def _quarters(recordings: Sequence[Recording]) -> dict[str, str]:
    """Block and quarter of it, in the order of measurement: inner groups where a class has one block only."""
    blocks: dict[str, list[Recording]] = {}
    for recording in recordings:
        blocks.setdefault(_block(recording), []).append(recording)
    return {
        recording.recording_id: f"{block} {index * _QUARTERS // len(members)}"
        for block, members in blocks.items()
        for index, recording in enumerate(sorted(members, key=lambda member: int(member.recording_id.split("_")[-1])))
    }
