"""Failed sensors, and a pump that does not run, raise a sensor alarm; healthy recordings do not."""

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
MAX_FALSE_FINDING_RATE = 1e-3

Change = Callable[[np.ndarray], np.ndarray]


def first(change: Change) -> Change:
    """Return a change of the first channel alone."""
    return lambda signal: np.vstack([change(signal[:1]), signal[1:]])


def stuck_at(samples: slice | int, value: float | None) -> Change:
    """Return a change that sets samples of the first sensor to `value`, or to its first sample."""

    def changed(signal: np.ndarray) -> np.ndarray:
        signal = signal.copy()
        signal[0, samples] = signal[0, 0] if value is None else value
        return signal

    return changed


def saturated(signal: np.ndarray) -> np.ndarray:
    """Clip the signal: the range of the sensor is too small."""
    limit = 1.5 * signal.std()
    return np.clip(signal, -limit, limit)


def loose(signal: np.ndarray) -> np.ndarray:
    """Add steps that decay within half a second: the plug moves."""
    rng = random_stream(0, "plug")
    length = signal.shape[1]
    has_kick = rng.random(length) < 5 / length
    kicks = np.where(has_kick, rng.normal(0, 40 * signal.std(), length), 0.0)

    decay = np.exp(-np.arange(length) / (length / 5))
    return signal + np.convolve(kicks, decay)[:length]


def noise(level_db: float, hum: float = 0.0) -> Change:
    """Return a change that replaces the signal by noise and hum of the mains.

    Parameters
    ----------
    level_db : level of the noise relative to the signal.
    hum : amplitude of the hum relative to the standard deviation of the signal.
    """

    def changed(signal: np.ndarray) -> np.ndarray:
        time = np.arange(signal.shape[1]) / 25600
        mains = hum * np.sin(2 * np.pi * 50 * time)
        normal = random_stream(0, "noise").normal(size=signal.shape)
        return signal.std() * (10 ** (level_db / 20) * normal + mains)

    return changed


def low_passed(signal: np.ndarray) -> np.ndarray:
    """Remove high frequencies, which a loose mounting does not transmit."""
    b, a = scipy.signal.butter(2, 0.15)
    return scipy.signal.lfilter(b, a, signal, axis=1)


def doubled(gain: float, offset: float, delay: int = 0, noise: float = 0.0) -> Change:
    """Return a change that shows the signal of the second channel in the first, too.

    Parameters
    ----------
    noise : standard deviation of the first input's noise, over that of the signal.
    """

    def changed(signal: np.ndarray) -> np.ndarray:
        late = np.roll(signal[1:2], delay, axis=1)
        hiss = noise * late.std() * random_stream(0, "input").normal(size=late.shape)
        return np.vstack([gain * (late + hiss) + offset, signal[1:]])

    return changed


flat = stuck_at(slice(None), 0.0)
# Beside such a sample all others look like one value: it once counted as saturation.
spiky = stuck_at(1000, 1e38)
FAULTS = {
    "flat": ("flat", flat),
    "partly flat": ("flat", stuck_at(slice(10_000), None)),
    "saturated": ("saturated", first(saturated)),
    "spikes": ("spikes", spiky),
    "loose": ("loose", first(loose)),
    "swapped": ("swapped", lambda signal: signal[[1, 0, 2]]),
    "rotated": ("swapped", lambda signal: signal[[1, 2, 0]]),
    # A dead sensor still has the noise of its amplifier, and picks up the mains.
    "noise 160 dB down": ("silent", first(noise(-160))),
    "noise 60 dB down": ("silent", first(noise(-60))),
    "hum of the mains": ("silent", first(noise(-80, 3e-3))),
    # Falls of 32 and 12 dB; a sensor is silent from 8 dB on.
    "a fortieth of the gain": ("silent", first(lambda signal: signal / 40)),
    "a fortieth of all gains": ("silent", lambda signal: signal / 40),
    "a fourth of the gain": ("silent", first(lambda signal: signal / 4)),
    # One sensor at two inputs, whose amplifiers may differ in gain, offset and sign.
    "doubled": ("equal", doubled(1.0, 0.0)),
    "doubled with another gain": ("equal", doubled(0.7, 3.0)),
    "doubled and inverted": ("equal", doubled(-1.0, 0.0)),
    "doubled, with noise of its input": ("equal", doubled(1.0, 0.0, noise=0.02)),
    "doubled, one sample late": ("equal", doubled(1.0, 0.0, delay=1)),
    "doubled, five samples late, with another gain": ("equal", doubled(-0.4, 2.0, delay=5)),
    "lost high frequencies": ("muffled", first(low_passed)),
    "all lost high frequencies": ("muffled", low_passed),
    # Without lines of the pump the level does not matter: the hall may be nearly as loud.
    "stopped pump": ("stopped", noise(-40)),
    "stopped pump in a loud hall": ("stopped", noise(-12)),
    "all sensors without power": ("stopped", noise(-120)),
}


@pytest.fixture(scope="module")
def rig() -> list[Recording]:
    """Twelve healthy recordings of a pump of the virtual rig."""
    course = plant_course(100, "A", PlantCourse(recordings=12, duration=1.0))
    return [recording for recording, _ in course]


@pytest.fixture(scope="module")
def watched(rig: list[Recording]) -> OperatingPointState:
    """State after the first ten, of which eight are the baseline."""
    state = None
    for recording in rig[:10]:
        judgment = MONITOR.judge(recording, state)
        assert judgment.findings == ()
        state = judgment.state

    assert state is not None
    return state


@pytest.mark.parametrize("fault", FAULTS)
def test_a_failed_sensor_is_identified_and_the_test_of_the_pump_does_not_move(
    rig: list[Recording], watched: OperatingPointState, fault: str
) -> None:
    kind, change = FAULTS[fault]
    state = watched
    alarm_changes = []

    for recording in rig[10:]:
        faulty = recording.replace(signal=change(recording.signal))
        judgment = MONITOR.judge(faulty, state)
        assert judgment.stage == "sensor"
        assert {finding.kind for finding in judgment.findings} == {kind}
        assert rig[0].channels[0] in judgment.findings[0].channel
        assert judgment.capital is None

        state = judgment.state
        alarm_changes.append(judgment.sensor)

    # One recording alone may be a disturbance.
    assert alarm_changes == [None, "raised"]

    # A recording of a failed sensor contains no evidence about the pump, neither way.
    assert state.test == watched.test
    assert state.pump == watched.pump
    assert state.baseline is watched.baseline


@pytest.mark.nightly
def test_healthy_recordings_show_a_finding_less_often_than_one_in_a_thousand() -> None:
    n_watched = n_findings = 0
    for pump in range(20):
        monitor = OperatingPointMonitor(f"pump-{pump}")
        state = None
        for number in range(280):
            recording = Machine().recording(1000 * pump + number, seconds=0.5)
            judgment = monitor.judge(recording, state)
            state = judgment.state
            n_watched += judgment.stage != "learning"
            n_findings += bool(judgment.findings)

    # 20 machines, each 280 recordings without the 20 that it learned from.
    assert n_watched == 5200
    # Upper end of the 95 % interval of Clopper and Pearson: a rate of zero proves little.
    upper_rate = scipy.stats.beta.ppf(0.975, n_findings + 1, n_watched - n_findings)
    assert upper_rate < MAX_FALSE_FINDING_RATE


# The faults that show without a baseline to compare with.
@pytest.mark.parametrize(
    "break_sensor",
    [
        pytest.param(flat, id="flat"),
        pytest.param(spiky, id="spikes"),
        pytest.param(first(saturated), id="saturated"),
        pytest.param(first(loose), id="loose"),
    ],
)
def test_a_baseline_does_not_learn_from_a_failed_sensor(
    machine: Machine, break_sensor: Change
) -> None:
    healthy = machine.recording(0)
    faulty = healthy.replace(signal=break_sensor(healthy.signal))

    judgment = MONITOR.judge(faulty, None)
    assert judgment.stage == "sensor"
    assert judgment.learned == 0

    assert MONITOR.judge(healthy, judgment.state).learned == 1


def test_a_worn_pump_is_not_taken_for_a_failed_sensor(machine: Machine) -> None:
    state = None
    # Up to 30 dB in one channel, while the other two stay as they were.
    for number, rise in enumerate([0.0] * 10 + [6.0, 12.0, 20.0, 30.0]):
        judgment = MONITOR.judge(machine.recording(number, rise=rise), state)
        state = judgment.state
        assert judgment.findings == ()


def test_band_powers_that_fall_while_none_rises_are_no_sign_of_health(machine: Machine) -> None:
    monitor = OperatingPointMonitor("A")
    state = None
    for number in range(22):
        recording = machine.recording(number)
        # 7 dB down on all channels, which is less than the fall of a silent one.
        gain = 1.0 if number < 20 else 0.45
        judgment = monitor.judge(recording.replace(signal=gain * recording.signal), state)
        state = judgment.state

    assert [finding.kind for finding in judgment.findings] == ["fallen"]
    assert judgment.stage == "sensor"
    assert judgment.sensor == "raised"
