"""Limits of the baseline: what makes a recording large, and what is learned from."""

import math
from dataclasses import replace

import numpy as np
import pytest
from small_machine import Machine

from swashtwin.foundation import DataError, InputError
from swashtwin.learning import BandPowerLayout
from swashtwin.monitoring.alarms.baseline import OperatingPointBaseline, choose_layout
from swashtwin.monitoring.alarms.monitor import OperatingPointMonitor
from swashtwin.signals import MAD_TO_STANDARD_DEVIATION

N_ROWS = 20


@pytest.fixture(scope="module")
def layout(machine: Machine) -> BandPowerLayout:
    return choose_layout(machine.recording(0))


def baseline_with(
    layout: BandPowerLayout, *, spread: float = 1.0, n_rows: int = N_ROWS, **facts: object
) -> OperatingPointBaseline:
    """Return a complete baseline whose band powers have the median 0 dB and this spread [dB]."""
    # A variance of 1 dB^2 is added to that of the rows, which lie as far above as below 0 dB.
    distance = math.sqrt(spread**2 - 1) / MAD_TO_STANDARD_DEVIATION
    signs = np.where(np.arange(n_rows) % 2, 1.0, -1.0)
    rows = np.repeat(distance * signs[:, None], len(layout.band_powers), axis=1)
    return replace(OperatingPointBaseline(layout, 4000, rows, is_complete=True), **facts)


def band_powers(layout: BandPowerLayout, changes: list[float]) -> np.ndarray:
    """Return band powers of which the first have these changes [dB] from 0, the others none."""
    values = np.zeros(len(layout.band_powers))
    values[: len(changes)] = changes
    return values


@pytest.mark.parametrize(
    ("spread", "changes", "is_large"),
    [
        # twice the amplitude, 6 dB, in the mean of five bands
        (1.0, [6.0] * 5, True),
        (1.0, [5.99] * 5, False),
        (1.0, [7.0] * 4, False),
        (1.0, [30.0], True),
        # five spreads in the mean of five bands
        (2.0, [10.01] * 5, True),
        (2.0, [9.99] * 5, False),
        # bands that rose by 3 dB in the mean, beside others that fell further
        (1.0, [-20.0] * 5 + [3.0] * 5, True),
        (1.0, [-20.0] * 5 + [2.99] * 5, False),
        (1.0, [-20.0] * 5, False),
    ],
)
def test_a_recording_is_large_from_the_limits_on(
    layout: BandPowerLayout, spread: float, changes: list[float], is_large: bool
) -> None:
    baseline = baseline_with(layout, spread=spread)
    assert baseline.spread == pytest.approx(spread)

    assert baseline.is_large(band_powers(layout, changes)) == is_large


@pytest.mark.parametrize(
    ("changes", "has_fallen"),
    [
        ([-6.0] * 5, True),
        ([-5.99] * 5, False),
        ([-20.0] * 5 + [2.99] * 5, True),
        ([-20.0] * 5 + [3.0] * 5, False),
        ([6.0] * 5, False),
    ],
)
def test_a_recording_has_fallen_if_it_changed_as_far_as_a_large_one_and_nothing_rose(
    layout: BandPowerLayout, changes: list[float], has_fallen: bool
) -> None:
    assert baseline_with(layout).has_fallen(band_powers(layout, changes)) == has_fallen


def test_the_score_is_the_mean_of_the_five_largest_changes_beyond_three_decibels(
    layout: BandPowerLayout,
) -> None:
    baseline = baseline_with(layout, spread=2.0)

    # (1 + 2 + 3 + 4 + 5) / 5, over the spread of 2 dB; the sixth change does not count
    changes = [4.0, -5.0, 6.0, -7.0, 8.0, 3.9]
    assert baseline.score(band_powers(layout, changes)) == pytest.approx(1.5)
    assert baseline.score(band_powers(layout, [])) == 0


def test_a_deviation_has_the_changes_in_decibels_and_in_spreads(layout: BandPowerLayout) -> None:
    changes = band_powers(layout, [6.0, -9.0])

    deviation = baseline_with(layout, spread=3.0).deviation(changes, 0.25)

    np.testing.assert_allclose(deviation.change, changes)
    np.testing.assert_allclose(deviation.spreads, changes / 3)
    assert deviation.p_value == 0.25


def test_each_recording_of_the_baseline_is_scored_against_the_others(
    layout: BandPowerLayout,
) -> None:
    rows = np.zeros((6, len(layout.band_powers)))
    rows[2, :5] = 8.0
    baseline = replace(baseline_with(layout), rows=rows, dropped=2)

    # Dropped recordings are the largest of all. (8 - 3) / 1 of the third, against five at 0 dB.
    scores = baseline.held_out_scores()
    assert scores[:2] == [(math.inf, True)] * 2
    assert scores[2:] == [(0, False), (0, False), (5, True), (0, False), (0, False), (0, False)]


@pytest.mark.parametrize(
    ("n_before", "change", "is_learned"),
    [
        (4, 12.0, False),
        (4, 11.99, True),
        (4, -12.0, False),
        # four recordings do not show which of them deviates
        (3, 12.0, True),
    ],
)
def test_a_recording_that_deviates_by_twelve_decibels_is_not_learned_from(
    machine: Machine, layout: BandPowerLayout, n_before: int, change: float, is_learned: bool
) -> None:
    before = baseline_with(layout, n_rows=n_before, is_complete=False)
    powers = band_powers(layout, [change] * 5)

    baseline, notes = before.learn(powers, machine.recording(0), n_recordings=5)

    assert len(baseline.rows) == n_before + is_learned
    assert baseline.dropped == len(notes) == (not is_learned)
    assert baseline.is_complete == (n_before + is_learned == 5)
    if notes:
        assert f"not learned from this recording: {change:+.1f} dB" in notes[0]


def test_an_earlier_recording_is_dropped_once_the_others_show_that_it_deviates(
    machine: Machine, layout: BandPowerLayout
) -> None:
    rows = np.zeros((4, len(layout.band_powers)))
    rows[0, :5] = 20.0
    before = replace(baseline_with(layout), rows=rows, is_complete=False, dropped=1)

    baseline, notes = before.learn(band_powers(layout, []), machine.recording(0), n_recordings=5)

    assert "not learned from an earlier recording: +20.0 dB" in notes[0]
    assert baseline.dropped == 2
    assert not baseline.rows.any()
    assert not baseline.is_complete


def test_the_shortest_recording_that_was_learned_from_counts(
    machine: Machine, layout: BandPowerLayout
) -> None:
    powers = band_powers(layout, [])
    baseline = OperatingPointBaseline.empty(layout)
    lengths = []
    for seconds in (1.0, 0.9, 1.1):
        recording = machine.recording(0, seconds=seconds)
        baseline, _ = baseline.learn(powers, recording, n_recordings=5)
        lengths.append(baseline.shortest)

    assert lengths == [4000, 3600, 3600]


@pytest.mark.parametrize(("spread", "distance"), [(1.0, 2.0), (5.0, 1.2)])
def test_channels_are_compared_with_a_spread_of_at_least_three_decibels(
    layout: BandPowerLayout, spread: float, distance: float
) -> None:
    powers = band_powers(layout, []).reshape(3, -1)
    powers[1] = 6.0

    distances = baseline_with(layout, spread=spread).channel_distances(powers.ravel())

    # Each row is a channel of the recording; all channels of the baseline are alike.
    expected = np.array([0.0, distance, 0.0])[:, None].repeat(3, axis=1)
    np.testing.assert_allclose(distances, expected)


@pytest.mark.parametrize("rate", [0.0, 1.0, -0.1, 2.0])
def test_a_false_alarm_rate_lies_between_zero_and_one(rate: float) -> None:
    with pytest.raises(InputError, match="must lie between 0 and 1"):
        OperatingPointMonitor("pump-1", false_alarm_rate=rate)


def test_a_baseline_has_at_least_five_recordings() -> None:
    assert OperatingPointMonitor("pump-1", baseline_recordings=5).baseline_recordings == 5
    with pytest.raises(InputError, match=r"baseline_recordings \(4\) must be at least 5"):
        OperatingPointMonitor("pump-1", baseline_recordings=4)


def test_a_recording_has_at_least_64_samples(machine: Machine) -> None:
    monitor = OperatingPointMonitor("pump-1")
    # No speed is specified, since a turn of the shaft takes longer.
    recording = machine.recording(0).replace(condition=None)

    with pytest.raises(DataError, match="r0 has 63 samples; record at least 64"):
        monitor.judge(recording.replace(signal=recording.signal[:, :63]), None)
    judgment = monitor.judge(recording.replace(signal=recording.signal[:, :64]), None)
    assert judgment.learned == 1
