"""Levels at shaft orders: a line lands in its column, a machine's own path cancels, a rule needs healthy ones."""

import zlib
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from swashtwin.foundation import DataError, InputError, MPa, rpm
from swashtwin.learning import WindowSet, cut_windows
from swashtwin.pump import CLASSES, OperatingCondition
from swashtwin.recordings import Recording
from swashtwin_bench.rivals.order_levels import (
    CachedExtractor,
    against_healthy,
    envelope_levels,
    highest_order,
    order_levels,
    order_lines,
)
from swashtwin_bench.rivals.order_threshold import CERTAIN, rising_orders, threshold_orders

RATE, LENGTH = 12800.0, 4096
SPEED = rpm(860)
SHAFT = SPEED / (2 * np.pi)


def recording(name: str, label: str, lines: dict[int, float], gain: float = 1.0, specimen: str = "A") -> Recording:
    rng = np.random.default_rng(zlib.crc32(name.encode()))
    time = np.arange(4 * LENGTH) / RATE
    signal = 0.01 * rng.standard_normal((1, time.size))
    for order, amplitude in lines.items():
        signal += amplitude * np.sin(2 * np.pi * order * SHAFT * time + rng.uniform(0, 6))
    condition = OperatingCondition(speed=SPEED, discharge_pressure=MPa(10))
    return Recording(gain * signal, RATE, name, ("z",), label=label, specimen=specimen, condition=condition)


def windows(*recordings: Recording) -> WindowSet:
    return cut_windows(list(recordings), length=LENGTH, classes=CLASSES)


LEVELS = partial(order_levels, piston_count=7, passes=10)


def test_a_line_shows_its_mean_square_in_its_own_column() -> None:
    table = order_lines(windows(recording("a", "normal", {3: 2.0})), 5)
    assert table.values[:, table.names.index("z order 3")] == pytest.approx(np.log10(2.0), abs=0.01)
    assert table.values[:, table.names.index("z order 5")].max() < -4


def test_lines_on_and_between_piston_passes_have_columns_of_their_own() -> None:
    table = LEVELS(windows(recording("a", "normal", {14: 1.0}), recording("b", "normal", {18: 1.0})))
    on, off = table.names.index("z pass 2"), table.names.index("z between 2")
    first, second = table.values[:4], table.values[4:]
    assert (first[:, on] > first[:, off] + 2).all()
    assert (second[:, off] > second[:, on] + 2).all()


def test_a_window_has_the_same_levels_whatever_stands_beside_it() -> None:
    slow = windows(recording("a", "normal", {14: 1.0}))
    quick = replace(slow, speed=slow.speed * 1.3, recording_id=np.array(["b"] * len(slow)))
    view = partial(order_levels, piston_count=7, passes=10, top=highest_order(quick))
    alone, beside = view(slow), view(slow + quick)
    assert alone.names == beside.names
    assert any("above 7" in name for name in alone.names)
    np.testing.assert_array_equal(beside.values[: len(slow)], alone.values)


def test_an_envelope_shows_the_order_that_modulates() -> None:
    time = np.arange(4 * LENGTH) / RATE
    carrier = np.sin(2 * np.pi * 3000 * time) * (1 + 0.5 * np.sin(2 * np.pi * SHAFT * time))
    plain = recording("a", "normal", {})
    table = envelope_levels(windows(replace(plain, signal=carrier[None])), 5)
    assert table.values.argmax(axis=1).tolist() == [0] * 4
    assert table.names[0] == "z order 1 of the envelope"


def test_windows_of_less_than_three_revolutions_have_no_orders() -> None:
    short = cut_windows([recording("a", "normal", {})], length=1024)
    with pytest.raises(InputError, match="2680 samples"):
        order_lines(short, 5)


def test_a_gain_of_the_whole_path_cancels_against_healthy() -> None:
    lines = {7: 1.0, 14: 0.5}
    healthy = windows(*(recording(f"{n}{gain}", "normal", lines, gain, n) for n, gain in (("A", 1.0), ("B", 5.0))))
    faults = [recording(f"{n}{gain} f", "piston", {**lines, 18: 0.3}, gain, n) for n, gain in (("A", 1.0), ("B", 5.0))]
    table = against_healthy(LEVELS, healthy)(windows(*faults))
    for name, rise in (("z pass 1", 0.0), ("z pass 2", 0.0)):
        assert table.values[:, table.names.index(name)] == pytest.approx(rise, abs=0.02)
    assert table.values[:, table.names.index("z between 2")].min() > 1


def test_a_reference_is_compared_with_the_others_not_with_itself() -> None:
    healthy = windows(recording("one", "normal", {7: 1.0}), recording("two", "normal", {7: 10.0}))
    table = against_healthy(LEVELS, healthy)(healthy)
    rise = table.values[:, table.names.index("z pass 1")]
    assert rise[:4] == pytest.approx(-2, abs=0.02)
    assert rise[4:] == pytest.approx(2, abs=0.02)


def test_a_machine_without_a_healthy_recording_is_refused() -> None:
    view = against_healthy(LEVELS, windows(recording("one", "normal", {7: 1.0})))
    with pytest.raises(DataError, match="no healthy recording of C at 10 MPa"):
        view(windows(recording("x", "piston", {7: 1.0}, specimen="C")))


def test_a_window_is_computed_once_and_comes_out_the_same_in_any_order() -> None:
    counts = []

    def counted(windows: WindowSet):
        counts.append(len(windows))
        return LEVELS(windows)

    view = CachedExtractor(counted)
    both = windows(recording("a", "normal", {7: 1.0}), recording("b", "normal", {8: 1.0}))
    view(both.subset(np.arange(4)))
    turned = np.arange(8)[::-1]
    assert view(both.subset(turned)).values == pytest.approx(LEVELS(both).values[turned])
    assert counts == [4, 4]


@pytest.fixture
def ruled():
    base = {7: 1.0, 14: 0.5}
    healthy = windows(*(recording(f"h{i}", "normal", base) for i in range(3)))
    model = windows(
        recording("m", "normal", base),
        recording("p", "piston", {**base, 18: 0.3}),
        recording("v", "valve_plate", {**base, 21: 0.3}),
    )
    view = against_healthy(LEVELS, healthy)
    rule = rising_orders(view(model), model, columns=1)
    return threshold_orders(healthy, view, rule, manifest=("more",))


def test_a_rule_names_the_columns_that_rise_and_the_class_they_stand_for(ruled) -> None:
    assert ruled.rule == {"piston": ("z between 2",), "valve_plate": ("z pass 3",)}
    tested = windows(recording("x", "piston", {7: 1.0, 14: 0.5, 19: 0.2}), recording("y", "normal", {7: 1.0, 14: 0.5}))
    probability = ruled.predict_proba(tested)
    assert probability.sum(axis=1) == pytest.approx(1)
    assert (probability[:4].argmax(axis=1) == CLASSES.index("piston")).all()
    assert probability[4:].argmax(axis=1).tolist().count(CLASSES.index("normal")) >= 3
    assert probability.max() == pytest.approx(CERTAIN)


def test_a_rule_names_every_recording_behind_its_threshold(ruled) -> None:
    assert ruled.manifest == ("h0", "h1", "h2", "more")


def test_a_threshold_needs_measured_healthy_windows() -> None:
    faulty = windows(recording("p", "piston", {7: 1.0}))
    with pytest.raises(DataError, match="two or more measured healthy"):
        threshold_orders(faulty, LEVELS, {"piston": ("z pass 1",)})
