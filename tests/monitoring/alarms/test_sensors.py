"""Sensors at fault, and a pump that does not run, raise an alarm of their own; healthy recordings
do not.
"""

from collections.abc import Callable

import numpy as np
import pytest
import scipy.signal
import scipy.stats
from small_machine import Machine

from swashtwin.foundation import random_stream
from swashtwin.monitoring.alarms.monitor import OperatingPointMonitor, OperatingPointState
from swashtwin.recordings import Recording
from swashtwin_bench.rigs.courses import PlantCourse, plant_course

MONITOR = OperatingPointMonitor("A", baseline_recordings=8)


def first(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[np.ndarray], np.ndarray]:
    """A change of the first channel alone."""
    return lambda signal: np.vstack([change(signal[:1]), signal[1:]])


def at(samples: slice | int, value: float | None) -> Callable[[np.ndarray], np.ndarray]:
    """The first sensor shows one value at some samples: its own first one where none is given."""

    def changed(signal: np.ndarray) -> np.ndarray:
        signal = signal.copy()
        signal[0, samples] = signal[0, 0] if value is None else value
        return signal

    return changed


def saturated(signal: np.ndarray) -> np.ndarray:
    """The range of the sensor is too small."""
    limit = 1.5 * signal.std()
    return np.clip(signal, -limit, limit)


def loose(signal: np.ndarray) -> np.ndarray:
    """The plug moves: steps that decay within half a second."""
    rng = random_stream(0, "plug")
    length = signal.shape[1]
    kick = np.where(rng.random(length) < 5 / length, rng.normal(0, 40 * signal.std(), length), 0.0)
    return signal + np.convolve(kick, np.exp(-np.arange(length) / (length / 5)))[:length]


def noise(decibel: float, hum: float = 0.0) -> Callable[[np.ndarray], np.ndarray]:
    """Noise so far below the signal, and hum of the mains of so much of it, in place of the
    signal.
    """

    def changed(signal: np.ndarray) -> np.ndarray:
        mains = hum * np.sin(2 * np.pi * 50 * np.arange(signal.shape[1]) / 25600)
        return signal.std() * (
            10 ** (decibel / 20) * random_stream(0, "noise").normal(size=signal.shape) + mains
        )

    return changed


def low_passed(signal: np.ndarray) -> np.ndarray:
    """The mounting lets no high frequencies through."""
    return scipy.signal.lfilter(*scipy.signal.butter(2, 0.15), signal, axis=1)


def doubled(gain: float, offset: float) -> Callable[[np.ndarray], np.ndarray]:
    """The first channel shows the signal of the second."""
    return lambda signal: np.vstack([gain * signal[1:2] + offset, signal[1:]])


flat = at(slice(None), 0.0)
spiky = at(1000, 1e38)
FAULTS = {
    "flat": ("flat", flat),
    "partly flat": ("flat", at(slice(10_000), None)),
    "saturated": ("saturated", first(saturated)),
    "spikes": ("spikes", spiky),
    "loose": ("loose", first(loose)),
    "swapped": ("swapped", lambda signal: signal[[1, 0, 2]]),
    "rotated": ("swapped", lambda signal: signal[[1, 2, 0]]),
    "noise 160 dB down": ("silent", first(noise(-160))),
    "noise 60 dB down": ("silent", first(noise(-60))),
    "hum of the mains": ("silent", first(noise(-80, 3e-3))),
    "a fortieth of the gain": ("silent", first(lambda signal: signal / 40)),
    "a fortieth of all gains": ("silent", lambda signal: signal / 40),
    "a fourth of the gain": ("silent", first(lambda signal: signal / 4)),
    "doubled": ("equal", doubled(1.0, 0.0)),
    "doubled with another gain": ("equal", doubled(0.7, 3.0)),
    "doubled and inverted": ("equal", doubled(-1.0, 0.0)),
    "lost high frequencies": ("muffled", first(low_passed)),
    "all lost high frequencies": ("muffled", low_passed),
    "stopped pump": ("stopped", noise(-40)),
    "stopped pump in a loud hall": ("stopped", noise(-12)),
    "all sensors without power": ("stopped", noise(-120)),
}


@pytest.fixture(scope="module")
def rig() -> list[Recording]:
    """Twelve healthy recordings of a pump of the virtual rig."""
    return [
        recording
        for recording, _ in plant_course(100, "A", PlantCourse(recordings=12, duration=1.0))
    ]


@pytest.fixture(scope="module")
def watched(rig: list[Recording]) -> OperatingPointState:
    """State after the first ten."""
    state = None
    for recording in rig[:10]:
        point_judgment = MONITOR.judge(recording, state)
        assert point_judgment.findings == ()
        state = point_judgment.state
    assert state is not None
    return state


@pytest.mark.parametrize("fault", FAULTS)
def test_a_sensor_at_fault_on_the_rig_is_named_and_the_test_of_the_pump_does_not_move(
    rig: list[Recording], watched: OperatingPointState, fault: str
) -> None:
    state = watched
    changes = []
    for recording in rig[10:]:
        kind, change = FAULTS[fault]
        point_judgment = MONITOR.judge(recording.replace(signal=change(recording.signal)), state)
        assert point_judgment.stage == "sensor"
        assert {finding.kind for finding in point_judgment.findings} == {kind}
        assert rig[0].channels[0] in point_judgment.findings[0].channel
        assert point_judgment.capital is None
        state = point_judgment.state
        changes.append(point_judgment.sensor)
    assert changes == [None, "raised"]
    assert (state.test, state.pump) == (watched.test, watched.pump)
    assert state.baseline is watched.baseline


@pytest.mark.nightly
def test_healthy_recordings_show_a_finding_less_often_than_one_in_a_thousand() -> None:
    """5,200 recordings of 20 machines; the upper end of the interval of Clopper and Pearson
    counts.
    """
    count = n_findings = 0
    for pump in range(20):
        monitor = OperatingPointMonitor(f"pump-{pump}")
        state = None
        for number in range(280):
            judgment = monitor.judge(Machine().recording(1000 * pump + number, seconds=0.5), state)
            state = judgment.state
            if judgment.stage != "learning":
                count += 1
            n_findings += bool(judgment.findings)
    assert count == 5200
    assert scipy.stats.beta.ppf(0.975, n_findings + 1, count - n_findings) < 1e-3


@pytest.mark.parametrize("break_sensor", [flat, spiky, first(saturated), first(loose)])
def test_a_baseline_does_not_learn_from_a_sensor_at_fault(
    machine: Machine, break_sensor: Callable[[np.ndarray], np.ndarray]
) -> None:
    recording = machine.recording(0)
    point_judgment = MONITOR.judge(recording.replace(signal=break_sensor(recording.signal)), None)
    assert (point_judgment.stage, point_judgment.learned) == ("sensor", 0)
    assert MONITOR.judge(recording, point_judgment.state).learned == 1


def test_a_faulty_pump_is_no_sensor_at_fault(machine: Machine) -> None:
    state = None
    for number, rise in enumerate([0.0] * 10 + [6.0, 12.0, 20.0, 30.0]):
        point_judgment = MONITOR.judge(machine.recording(number, rise=rise), state)
        state = point_judgment.state
        assert point_judgment.findings == ()


def test_levels_that_fall_while_none_rises_are_no_sign_of_health(machine: Machine) -> None:
    monitor = OperatingPointMonitor("A")
    state = None
    for number in range(22):
        recording = machine.recording(number)
        gain = 1.0 if number < 20 else 0.45
        judgment = monitor.judge(recording.replace(signal=gain * recording.signal), state)
        state = judgment.state
    assert [finding.kind for finding in judgment.findings] == ["fallen"]
    assert (judgment.stage, judgment.sensor) == ("sensor", "raised")
