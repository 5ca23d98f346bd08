"""Disturb recordings as sensors, cables, loggers and indexes do, and count wrong answers.

    python benchmarks/disturbances.py --recordings 15

Each disturbance changes recordings of the virtual rig that no model has learned from, a healthy one
or one of each fault. A classifier, an anomaly detector and the shipped pump prior diagnose them. An
answer is a failure if it is sure (probability above 0.8), wrong, and without a warning that the
undisturbed recording lacks. A detector names no fault, so its alarm is right for any disturbed
recording; it fails if it misses a fault that it reports without the disturbance.

It prints each failure, and a table of the totals. With 15 recordings of each disturbance it takes
little more than a minute of processor time.
"""

import argparse
import sys
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.signal
from jaxtyping import Float

from swashtwin.diagnosis import AnomalyDetector, Diagnosis, FaultClassifier, PriorClassifier
from swashtwin.foundation import DataError, random_stream
from swashtwin.pump import is_healthy
from swashtwin.recordings import Recording
from swashtwin_bench import rig_recordings
from swashtwin_bench.rigs.writing import RigSize

SIZE = RigSize(specimens=2, repeats=5, duration=2.0)
"""Recordings of the rig: four of each class and pressure teach, the fifth tests."""
FLEET = 40
"""Seed of the rig's pumps, which no study uses."""
SURE = 0.8
"""Probability from which an answer is sure."""

Samples = Float[np.ndarray, "channel time"]
Disturbance = Callable[[Recording, int, np.random.Generator], Recording]
"""Changes a recording; takes the index of the channel that is hit, and a source of randomness."""


def on_channel(change: Callable[..., np.ndarray], *settings: Any) -> Disturbance:
    """Return the disturbance that changes the samples of one channel."""

    def disturb(recording: Recording, channel: int, rng: np.random.Generator) -> Recording:
        signal = recording.signal.astype(np.float64)
        signal[channel] = change(signal[channel], recording.sample_rate, rng, *settings)
        return recording.replace(signal=signal)

    return disturb


def on_all(change: Callable[..., np.ndarray], *settings: Any) -> Disturbance:
    """Return the disturbance that changes the samples of every channel alike."""

    def disturb(recording: Recording, channel: int, rng: np.random.Generator) -> Recording:
        rows = [
            change(row, recording.sample_rate, rng, *settings)
            for row in recording.signal.astype(np.float64)
        ]
        return recording.replace(signal=np.stack(rows))

    return disturb


def stated(**changes: Callable[[Recording], Any]) -> Disturbance:
    """Return the disturbance that states other facts of a recording."""

    def disturb(recording: Recording, channel: int, rng: np.random.Generator) -> Recording:
        return recording.replace(**{name: value(recording) for name, value in changes.items()})

    return disturb


def doubled(delay: int, gain: float) -> Disturbance:
    """Return the disturbance that records one channel in another one too, some samples late."""

    def disturb(recording: Recording, channel: int, rng: np.random.Generator) -> Recording:
        signal = recording.signal.astype(np.float64)
        signal[channel] = gain * np.roll(signal[channel - 1], delay)
        return recording.replace(signal=signal)

    return disturb


def reordered(shift: int, count: int) -> Disturbance:
    """Return the disturbance that rotates the cables of the first channels."""

    def disturb(recording: Recording, channel: int, rng: np.random.Generator) -> Recording:
        signal = recording.signal.copy()
        signal[:count] = np.roll(signal[:count], shift, axis=0)
        return recording.replace(signal=signal)

    return disturb


def constant(row: np.ndarray, rate: float, rng: np.random.Generator) -> np.ndarray:
    return np.zeros_like(row)


def faint_noise(row: np.ndarray, rate: float, rng: np.random.Generator, share: float) -> np.ndarray:
    return rng.normal(0, share * row.std(), row.size)


def clipped(row: np.ndarray, rate: float, rng: np.random.Generator, limit: float) -> np.ndarray:
    return np.clip(row, -limit * row.std(), limit * row.std())


def filtered(
    row: np.ndarray, rate: float, rng: np.random.Generator, kind: str, edge_hz: float
) -> np.ndarray:
    sections = scipy.signal.butter(4, edge_hz, kind, fs=rate, output="sos")
    return np.asarray(scipy.signal.sosfilt(sections, row))


def scaled(row: np.ndarray, rate: float, rng: np.random.Generator, gain: float) -> np.ndarray:
    return gain * row


def with_offset(row: np.ndarray, rate: float, rng: np.random.Generator, size: float) -> np.ndarray:
    return row + size * row.std()


def with_drift(row: np.ndarray, rate: float, rng: np.random.Generator, size: float) -> np.ndarray:
    return row + np.linspace(0, size * row.std(), row.size)


def with_hum(
    row: np.ndarray, rate: float, rng: np.random.Generator, size: float, harmonics: int
) -> np.ndarray:
    time = np.arange(row.size) / rate
    hum = [np.sin(2 * np.pi * 50 * number * time) / number for number in range(1, harmonics + 1)]
    return row + size * row.std() * np.sum(hum, axis=0)


def with_noise(row: np.ndarray, rate: float, rng: np.random.Generator, size: float) -> np.ndarray:
    return row + rng.normal(0, size * row.std(), row.size)


def with_spikes(
    row: np.ndarray, rate: float, rng: np.random.Generator, count: int, size: float
) -> np.ndarray:
    changed = row.copy()
    numbers = rng.choice(row.size, count, replace=False)
    changed[numbers] += size * row.std() * rng.choice([-1, 1], count)
    return changed


def with_marks(
    row: np.ndarray, rate: float, rng: np.random.Generator, count: int, mark: float
) -> np.ndarray:
    changed = row.copy()
    changed[rng.choice(row.size, count, replace=False)] = mark
    return changed


def with_gap(row: np.ndarray, rate: float, rng: np.random.Generator, share: float) -> np.ndarray:
    changed = row.copy()
    changed[: int(share * row.size)] = 0
    return changed


def stuck(row: np.ndarray, rate: float, rng: np.random.Generator, share: float) -> np.ndarray:
    changed = row.copy()
    start = int((1 - share) * row.size)
    changed[start:] = row[start]
    return changed


def held(row: np.ndarray, rate: float, rng: np.random.Generator, times: int) -> np.ndarray:
    return np.repeat(row[::times], times)[: row.size]


def quantized(row: np.ndarray, rate: float, rng: np.random.Generator, step: float) -> np.ndarray:
    size = step * row.std()
    return np.asarray(size * np.round(row / size))


def dropped(row: np.ndarray, rate: float, rng: np.random.Generator, interval: int) -> np.ndarray:
    return np.delete(row, np.arange(0, row.size, interval))


def interpolated(row: np.ndarray, rate: float, rng: np.random.Generator, times: int) -> np.ndarray:
    numbers = np.arange(row.size)
    return np.interp(numbers, numbers[::times], row[::times])


def reversed_time(row: np.ndarray, rate: float, rng: np.random.Generator) -> np.ndarray:
    return row[::-1].copy()


def integrated(row: np.ndarray, rate: float, rng: np.random.Generator) -> np.ndarray:
    return np.cumsum(row - row.mean()) / rate * 1000


def stretched(row: np.ndarray, rate: float, rng: np.random.Generator, ratio: float) -> np.ndarray:
    numbers = np.arange(0, row.size - 1, ratio)
    return np.interp(numbers, np.arange(row.size), row)


def other_condition(name: str, ratio: float) -> Callable[[Recording], Any]:
    """Return the function that gives a recording's operating point with another value."""

    def change(recording: Recording) -> Any:
        assert recording.condition is not None
        return recording.condition.replace(**{name: ratio * getattr(recording.condition, name)})

    return change


DISTURBANCES: Mapping[str, Disturbance] = {
    "dead": on_channel(constant),
    "dead, with noise": on_channel(faint_noise, 1e-4),
    "nearly dead": on_channel(faint_noise, 1e-2),
    "only noise": on_channel(faint_noise, 1.0),
    "clipped": on_channel(clipped, 1.5),
    "clipped hard": on_channel(clipped, 0.5),
    "clipped everywhere": on_all(clipped, 1.0),
    "low-pass 300 Hz": on_channel(filtered, "lowpass", 300.0),
    "low-pass 1 kHz": on_channel(filtered, "lowpass", 1000.0),
    "low-pass 3 kHz": on_channel(filtered, "lowpass", 3000.0),
    "low-pass 1 kHz everywhere": on_all(filtered, "lowpass", 1000.0),
    "low-pass 3 kHz everywhere": on_all(filtered, "lowpass", 3000.0),
    "high-pass 100 Hz": on_channel(filtered, "highpass", 100.0),
    "high-pass 500 Hz": on_channel(filtered, "highpass", 500.0),
    "high-pass 500 Hz everywhere": on_all(filtered, "highpass", 500.0),
    "gain 10": on_channel(scaled, 10.0),
    "gain 1/10": on_channel(scaled, 0.1),
    "gain 10 everywhere": on_all(scaled, 10.0),
    "gain 1/10 everywhere": on_all(scaled, 0.1),
    "sign": on_channel(scaled, -1.0),
    "swapped": reordered(1, 2),
    "all cables rotated": reordered(1, 3),
    "doubled": doubled(0, 1.0),
    "doubled, one sample late": doubled(1, 1.0),
    "doubled, three samples late, inverted": doubled(3, -0.5),
    "one sample of 100 dropped": on_all(dropped, 100),
    "gap of a tenth": on_channel(with_gap, 0.1),
    "stuck for a tenth": on_channel(stuck, 0.1),
    "held": on_all(held, 4),
    "offset": on_channel(with_offset, 20.0),
    "drift": on_channel(with_drift, 10.0),
    "hum": on_channel(with_hum, 1.0, 1),
    "hum with harmonics everywhere": on_all(with_hum, 1.0, 9),
    "noise": on_channel(with_noise, 1.0),
    "noise everywhere": on_all(with_noise, 0.5),
    "spikes": on_channel(with_spikes, 20, 100.0),
    "many spikes": on_channel(with_spikes, 500, 10.0),
    "marks": on_channel(with_marks, 5, -9999.0),
    "quantized": on_all(quantized, 1.0),
    "interpolated": on_all(interpolated, 2),
    "reversed": on_all(reversed_time),
    "integrated": on_all(integrated),
    "other speed": on_all(stretched, 1.1),
    "rate stated 2 % too high": stated(sample_rate=lambda recording: 1.02 * recording.sample_rate),
    "speed stated 10 % too high": stated(condition=other_condition("speed", 1.1)),
    "pressure stated twice": stated(condition=other_condition("discharge_pressure", 2.0)),
    "other machine stated": stated(specimen=lambda recording: "B"),
}


Model = FaultClassifier | AnomalyDetector | PriorClassifier


@dataclass(frozen=True)
class Models:
    """The three models, and the recordings that none of them has learned from."""

    by_name: Mapping[str, Model]
    tests: tuple[Recording, ...]


def train_models(n_tests: int) -> Models:
    """Return the three models, trained on a small rig, and recordings of its first pump."""
    rig = [pair[0] for pair in rig_recordings(FLEET, SIZE, version="1")]
    last = f"_{SIZE.repeats}"
    tests = [item for item in rig if item.specimen == "A" and item.recording_id.endswith(last)]
    training = [item for item in rig if not item.recording_id.endswith(last)]
    healthy = [item for item in training if is_healthy(str(item.label))]

    models: dict[str, Model] = {
        "classifier": FaultClassifier().fit(training),
        "detector": AnomalyDetector().fit(healthy),
        "prior": PriorClassifier.load("25scy14-1b").fit(healthy),
    }
    return Models(models, tuple(tests[:n_tests]))


def is_failure(answer: Diagnosis, undisturbed: Diagnosis, truth: str) -> bool:
    """Whether an answer is sure, wrong, and without a warning that the undisturbed one lacks."""
    if answer.label is None or answer.unknown or set(answer.notes) - set(undisturbed.notes):
        return False
    if answer.kind == "detector":
        return not is_healthy(truth) and bool(undisturbed.alarm) and not answer.alarm
    is_sure = answer.probabilities[answer.label] > SURE and len(answer.prediction_set) <= 1
    return is_sure and answer.label != truth


def diagnose(model: Model, recording: Recording) -> Diagnosis:
    """Return the answer of a model; no verdict if it refuses the layout of the recording."""
    try:
        return model.diagnose(recording)
    except DataError as cause:
        return Diagnosis(recording.recording_id, no_verdict=str(cause))


def describe(answer: Diagnosis) -> str:
    """Return an answer in a few words."""
    if answer.label is None or answer.kind == "detector":
        return answer.verdict
    return f"{answer.verdict} {answer.probabilities[answer.label]:.2f}"


def count_failures(models: Models, names: Sequence[str]) -> int:
    """Print the failures of each disturbance and model, and return their number."""
    originals = {
        (name, test.recording_id): model.diagnose(test)
        for name, model in models.by_name.items()
        for test in models.tests
    }
    totals: Counter[str] = Counter()
    answers: Counter[tuple[str, str]] = Counter()
    for kind in names:
        for number, test in enumerate(models.tests):
            rng = random_stream(0, kind, test.recording_id)
            disturbed = DISTURBANCES[kind](test, number % len(test.channels), rng)
            for name, model in models.by_name.items():
                answer = diagnose(model, disturbed)
                original = originals[name, test.recording_id]
                answers[name, "no verdict" if answer.label is None else "unknown"] += (
                    answer.label is None or answer.unknown
                )
                if is_failure(answer, original, str(test.label)):
                    totals[name] += 1
                    print(f"{kind} | {name} | {test.recording_id}: {describe(answer)}", flush=True)

    n_tried = len(names) * len(models.tests)
    print("| model | tried | sure, wrong and unwarned | unknown | no verdict |")
    print("| --- | --- | --- | --- | --- |")
    for name in models.by_name:
        unknown = answers[name, "unknown"]
        without = answers[name, "no verdict"]
        print(f"| {name} | {n_tried} | {totals[name]} | {unknown} | {without} |")
    return totals.total()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--recordings", type=int, default=15, help="recordings of each disturbance")
    parser.add_argument("--kind", choices=DISTURBANCES, help="one disturbance; by default all")
    options = parser.parse_args()
    names = [options.kind] if options.kind else list(DISTURBANCES)
    return int(count_failures(train_models(options.recordings), names) > 0)


if __name__ == "__main__":
    sys.exit(main())
