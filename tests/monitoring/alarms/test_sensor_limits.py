"""Each finding of a sensor begins at its limit: just below it the sensor is sound."""

from dataclasses import replace

import numpy as np
import pytest
from small_machine import CHANNELS, RATE, SHAFT, Machine

from swashtwin.foundation import MPa, rpm
from swashtwin.monitoring.alarms.baseline import OperatingPointBaseline, choose_layout
from swashtwin.monitoring.alarms.sensors import check_against_baseline, check_sensors
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import Recording

TURN = round(RATE / SHAFT)


def noise(n_turns: int = 50, n_channels: int = 1) -> np.ndarray:
    """Return noise (channel, time) whose turns have the mean 0 and the variance 1 each."""
    turns = np.random.default_rng(0).normal(size=(n_channels, n_turns, TURN))
    turns -= turns.mean(axis=2, keepdims=True)
    turns /= turns.std(axis=2, keepdims=True)
    return turns.reshape(n_channels, -1)


def kinds(
    signal: np.ndarray, sample_rate: float = RATE, *, is_speed_known: bool = True
) -> list[str]:
    """Return the kinds of findings that need no baseline."""
    condition = None
    if is_speed_known:
        condition = OperatingCondition(rpm(60 * SHAFT), MPa(10))
    channels = CHANNELS[: len(signal)]
    recording = Recording(signal, sample_rate, "r", channels=channels, condition=condition)
    return [finding.kind for finding in check_sensors(recording)]


@pytest.mark.parametrize(("n_constant", "expected"), [(1000, ["flat"]), (980, [])])
def test_a_channel_is_flat_from_a_tenth_of_the_samples_on(
    n_constant: int, expected: list[str]
) -> None:
    signal = noise()
    assert signal.shape == (1, 10_000)
    # A value between the others, so that it is at no end of the range.
    signal[0, :n_constant] = 0.1

    assert kinds(signal) == expected


@pytest.mark.parametrize(
    ("sample_rate", "length", "is_flat"),
    [
        # 2 ms are 8 samples: 20 count
        (4000.0, 20, True),
        (4000.0, 10, False),
        # 2 ms are 100 samples
        (50_000.0, 100, True),
        (50_000.0, 50, False),
    ],
)
def test_steps_of_a_converter_are_shorter_than_a_flat_stretch(
    sample_rate: float, length: int, is_flat: bool
) -> None:
    signal = noise()[:, ::length].repeat(length, axis=1)
    assert ("flat" in kinds(signal, sample_rate, is_speed_known=False)) == is_flat


@pytest.mark.parametrize(("share", "expected"), [(0.51, ["loose"]), (0.49, [])])
@pytest.mark.parametrize("is_speed_known", [True, False])
def test_a_plug_is_loose_from_half_of_the_power_below_the_shaft_frequency_on(
    share: float, expected: list[str], is_speed_known: bool
) -> None:
    # Without a speed a turn is taken for 0.1 s, which are two turns here.
    sign = np.where(np.arange(10_000) // (TURN if is_speed_known else 2 * TURN) % 2, 1.0, -1.0)
    signal = np.sqrt(1 - share) * noise() + np.sqrt(share) * sign

    assert kinds(signal, is_speed_known=is_speed_known) == expected


@pytest.mark.parametrize(("n_turns", "expected"), [(8, ["loose"]), (7, [])])
def test_slow_power_is_measured_over_eight_turns_or_more(n_turns: int, expected: list[str]) -> None:
    sign = np.where(np.arange(n_turns * TURN) // TURN % 2, 1.0, -1.0)
    assert kinds(0.3 * noise(n_turns) + sign) == expected


@pytest.mark.parametrize(("level", "expected"), [(0.99e-4, ["silent"]), (1.01e-4, [])])
def test_a_channel_is_dead_from_80_db_below_the_loudest_on(
    level: float, expected: list[str]
) -> None:
    signal = noise(n_channels=2)
    assert kinds(signal * np.array([[1.0], [level]])) == expected


@pytest.mark.parametrize(("correlation", "expected"), [(0.9991, ["equal"]), (0.9989, [])])
@pytest.mark.parametrize("sign", [1, -1])
def test_channels_are_equal_from_a_correlation_of_0_999_on(
    correlation: float, expected: list[str], sign: int
) -> None:
    first, second = noise(n_channels=2)
    second -= first * (first @ second) / (first @ first)
    second *= np.sqrt((first @ first) / (second @ second))
    mixed = sign * (correlation * first + np.sqrt(1 - correlation**2) * second)

    assert kinds(np.stack([first, mixed])) == expected


N_HIGHEST = 4
LINES = 10.0
"""Height of the strongest quarter of the orders of a pump with lines [dB]."""


@pytest.fixture(scope="module")
def baseline(machine: Machine) -> OperatingPointBaseline:
    """Twenty equal recordings at 0 dB with a spread of 1 dB, whose first orders are lines."""
    layout = choose_layout(machine.recording(0))
    row = np.zeros((len(CHANNELS), 2, len(layout.band_powers) // (2 * len(CHANNELS))))
    row[:, :, -layout.n_orders :][:, :, : layout.n_orders // 4] = LINES
    rows = np.repeat(row.reshape(1, -1), 20, axis=0)
    return OperatingPointBaseline(layout, 4000, rows, is_complete=True)


class Changed:
    """Band powers of a baseline, some of which are changed."""

    def __init__(self, baseline: OperatingPointBaseline) -> None:
        self.baseline = baseline
        self.values = baseline.median.reshape(len(CHANNELS), 2, -1).copy()
        n_orders = baseline.layout.n_orders
        self.bands = self.values[:, 0, :-n_orders]
        """Bands (channel, band) [dB]."""
        self.lines = self.values[:, 0, -n_orders:][:, : n_orders // 4]
        """Orders (channel, order) that are lines [dB]."""
        self.faint = self.values[:, 0, -n_orders:][:, n_orders // 4 :]
        """The other orders [dB]."""

    def kinds(self) -> list[tuple[str, str]]:
        """Return kind and channel of the findings."""
        findings = check_against_baseline(self.baseline, self.values.ravel())
        return [(finding.kind, finding.channel) for finding in findings]


@pytest.fixture
def changed(baseline: OperatingPointBaseline) -> Changed:
    return Changed(baseline)


def test_an_unchanged_recording_has_no_finding(changed: Changed) -> None:
    assert changed.kinds() == []


@pytest.mark.parametrize(("fall", "expected"), [(-8.0, ("silent", "y")), (-7.99, ("fallen", "y"))])
def test_a_channel_is_silent_if_its_bands_fall_by_eight_decibels(
    changed: Changed, fall: float, expected: tuple[str, str]
) -> None:
    changed.bands[1] = fall
    assert changed.kinds() == [expected]


@pytest.mark.parametrize(
    ("low_fall", "high_fall", "kind"),
    [
        (0.0, -10.0, "muffled"),
        (0.0, -9.99, "fallen"),
        (-3.0, -10.0, "muffled"),
        (-3.01, -10.0, "fallen"),
    ],
)
def test_a_channel_is_muffled_if_only_its_highest_bands_fall_by_ten_decibels(
    changed: Changed, low_fall: float, high_fall: float, kind: str
) -> None:
    changed.bands[2] = low_fall
    changed.bands[2, -N_HIGHEST:] = high_fall
    # One band more falls far, so that a recording which is not muffled has fallen.
    changed.bands[2, -N_HIGHEST - 1] = high_fall

    assert changed.kinds() == [(kind, "z")]


def test_a_fall_is_measured_in_spreads_too(changed: Changed) -> None:
    # Healthy recordings that scatter by 3 dB show falls of 10 dB now and then.
    rows = changed.baseline.rows.copy()
    rows[::2] += 2.0
    rows[1::2] -= 2.0
    changed.baseline = replace(changed.baseline, rows=rows)
    changed.bands[0] = -10.0

    assert changed.kinds() == []


@pytest.mark.parametrize(
    ("line_fall", "faint_rise", "is_stopped"),
    [
        # The lines fall by 6 dB, and 4 of 10 dB remain of their height.
        (-6.0, 0.0, True),
        (-5.99, 0.0, False),
        (-5.99, 5.0, False),
        # The hall is louder than the pump was.
        (-6.0, 5.0, True),
    ],
)
def test_the_pump_does_not_run_if_its_lines_are_lost(
    changed: Changed, line_fall: float, faint_rise: float, is_stopped: bool
) -> None:
    changed.lines[:] += line_fall
    changed.faint[:] += faint_rise

    assert (changed.kinds() == [("stopped", "x, y, z")]) == is_stopped


def test_the_pump_runs_if_one_channel_with_lines_has_them(changed: Changed) -> None:
    changed.lines[:2] -= LINES
    assert "stopped" not in dict(changed.kinds())


@pytest.mark.parametrize(("height", "is_stopped"), [(6.0, True), (5.99, False)])
def test_lines_are_six_decibels_above_the_faint_orders(
    changed: Changed, height: float, is_stopped: bool
) -> None:
    rows = changed.baseline.rows.reshape(20, len(CHANNELS), 2, -1).copy()
    n_orders = changed.baseline.layout.n_orders
    rows[..., -n_orders:] *= height / LINES
    changed = Changed(replace(changed.baseline, rows=rows.reshape(20, -1)))
    changed.lines[:] -= 6.5

    assert (changed.kinds() == [("stopped", "x, y, z")]) == is_stopped


def test_all_channels_without_lines_that_are_silent_show_a_pump_that_does_not_run(
    changed: Changed,
) -> None:
    changed = Changed(replace(changed.baseline, rows=np.zeros_like(changed.baseline.rows)))
    changed.bands[:2] = -20.0
    assert changed.kinds() == [("silent", "x"), ("silent", "y")]

    changed.bands[2] = -20.0
    assert changed.kinds() == [("stopped", "x, y, z")]
