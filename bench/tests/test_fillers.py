"""Every filler: layout, marks, seeds and finite samples, drawn from measured training windows
alone.
"""

import itertools
import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swashtwin.foundation import DataError, InputError, MPa, random_stream, rpm
from swashtwin.learning import WindowSet
from swashtwin_bench import FILLERS
from swashtwin_bench.fillers.duplicates import Duplicate
from swashtwin_bench.fillers.filler import Filler, find_sources, in_cell
from swashtwin_bench.fillers.generative import CVAE, WGANGP
from swashtwin_bench.fillers.interpolation import ADASYN, SMOTE, NoNeighborsError
from swashtwin_bench.fillers.spectra import (
    SpectralForm,
    close_period,
    cut_extensions,
    extension_length,
    log_amplitude,
    periodic_extensions,
    with_amplitude,
)

CLASSES = ("normal", "piston")
SCARCE_CELL = ("piston", 15)
"""Class and pressure [MPa] of the cell that is to be filled."""

PERIOD = 256
"""Readings per revolution."""
RATE = PERIOD * rpm(1200) / (2 * np.pi)
LENGTH = 320
"""Samples of a window: more than one revolution and less than two."""


def measured(scarce: int = 8, classes: tuple[str, ...] = CLASSES) -> WindowSet:
    """Return windows of two classes at two pressures.

    The scarce cell has `scarce` windows of one recording, each other cell two recordings of six.
    """
    rng = random_stream(0, "measured")
    parts = []
    for label in CLASSES:
        for pressure in (10, 15):
            is_scarce = (label, pressure) == SCARCE_CELL
            n_recordings = min(scarce, 1) if is_scarce else 2
            count = scarce if is_scarce else 6
            for recording in range(n_recordings):
                signal = draw_signal(rng, label, pressure, count)
                name = f"{label}_{pressure}_{recording}"
                parts.append(window_set(signal, label, pressure, name, classes))

    joined_windows = parts[0]
    for part in parts[1:]:
        joined_windows = joined_windows + part
    return joined_windows


def draw_signal(rng: np.random.Generator, label: str, pressure: int, count: int) -> np.ndarray:
    """Return tones whose amplitude grows with the pressure, in noise.

    A worn piston adds a tone of order 1 to the first channel.
    """
    angle = 2 * np.pi * (np.arange(LENGTH) / PERIOD + rng.random((count, 1)))
    tone = np.stack([np.sin(7 * angle), np.cos(7 * angle)], axis=1) * pressure / 10
    if label == "piston":
        tone[:, 0] += np.sin(angle)

    return (tone + 0.2 * rng.normal(size=tone.shape)).astype(np.float32)


def window_set(
    signal: np.ndarray, label: str, pressure: int, recording: str, classes: tuple[str, ...]
) -> WindowSet:
    """Return consecutive windows of one recording."""
    count = len(signal)
    return WindowSet(
        signal=signal,
        target=np.full(count, classes.index(label), dtype=np.int64),
        classes=classes,
        recording_id=np.array([recording] * count),
        specimen=np.array(["p1"] * count),
        discharge_pressure=np.full(count, MPa(pressure)),
        speed=np.full(count, rpm(1200)),
        start=np.arange(count, dtype=np.int64) * LENGTH,
        synthetic=np.zeros(count, dtype=bool),
        sample_rate=RATE,
        channels=("x", "y"),
    )


def quick(filler: Filler) -> Filler:
    """Return a filler whose network, if it has one, is small and hardly trained."""
    if isinstance(filler, CVAE | WGANGP):
        return replace(filler, steps=20, width=16, components=8)
    return filler


QUICK: Mapping[str, Filler] = {name: quick(filler) for name, filler in FILLERS.items()}


def fill(name: str, train: WindowSet, **changes: object) -> WindowSet:
    """Return nine synthetic windows of the scarce cell."""
    arguments = {"label": "piston", "pressure": MPa(15), "count": 9, "seed": 3} | changes
    return QUICK[name](train, **arguments)  # type: ignore[arg-type]


# ---- what every filler does


every = pytest.mark.parametrize("name", FILLERS)


@every
@pytest.mark.parametrize("scarce", [8, 0])
def test_a_filler_gives_the_requested_number_of_marked_windows_of_the_cell(
    name: str, scarce: int
) -> None:
    train = measured(scarce)
    synthetic = fill(name, train)
    assert isinstance(FILLERS[name], Filler)

    assert len(synthetic) == 9
    assert synthetic.synthetic.all()
    assert set(synthetic.label) == {"piston"}
    np.testing.assert_array_equal(synthetic.discharge_pressure, MPa(15))
    np.testing.assert_allclose(synthetic.speed, rpm(1200), rtol=0.02)

    assert np.isfinite(synthetic.signal).all()
    assert synthetic.signal.std(axis=2).min() > 0


@every
@pytest.mark.parametrize("scarce", [8, 0])
def test_synthetic_windows_join_the_measured_ones_under_names_that_are_new(
    name: str, scarce: int
) -> None:
    train = measured(scarce)
    synthetic = fill(name, train)
    assert synthetic.classes == train.classes
    assert synthetic.layout == train.layout

    # a split by recording would otherwise mix measured and synthetic windows
    assert len(set(synthetic.recording_id)) == 9
    assert not set(synthetic.recording_id) & set(train.recording_id)
    assert len(train + synthetic) == len(train) + 9


@every
def test_the_same_seed_gives_the_same_bits_and_another_seed_does_not(name: str) -> None:
    train = measured()
    first = fill(name, train, seed=0).signal
    repeated = fill(name, train, seed=0).signal
    different = fill(name, train, seed=1).signal

    np.testing.assert_array_equal(first, repeated)
    assert np.abs(first - different).max() > 0.01


@every
def test_a_filler_does_not_look_at_synthetic_windows(name: str) -> None:
    train = measured()
    # a factor of 10,000 would show in any statistic of the windows
    poison = replace(
        train,
        signal=train.signal * np.float32(1e4),
        synthetic=np.ones(len(train), dtype=bool),
    )
    np.testing.assert_array_equal(fill(name, train + poison).signal, fill(name, train).signal)


@every
def test_a_filler_accepts_windows_without_pressures(name: str) -> None:
    train = measured()
    without_pressure = replace(train, discharge_pressure=np.full(len(train), np.nan))
    synthetic = fill(name, without_pressure, pressure=math.nan)
    assert np.isnan(synthetic.discharge_pressure).all()
    assert np.isfinite(synthetic.signal).all()


@every
def test_data_alone_cannot_fill_a_class_that_was_never_measured(name: str) -> None:
    train = measured(classes=("normal", "piston", "valve_plate"))
    with pytest.raises(DataError, match="a twin can"):
        fill(name, train, label="valve_plate")


@every
@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"label": "slipper"}, "not among the windows' classes"),
        ({"count": 0}, "at least 1"),
        ({"pressure": -1.0}, "must be positive"),
    ],
)
def test_invalid_requests_are_refused(name: str, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        fill(name, measured(), **changes)


# ---- sources and duplicates


def test_sources_are_the_windows_of_the_cell_or_else_of_its_class() -> None:
    train = measured()
    assert in_cell(train, "piston", MPa(15)).sum() == 8

    # 15.3 MPa is a measured pressure within the tolerance of the cell at 15 MPa
    of_cell = train.discharge_pressure[find_sources(train, "piston", MPa(15.3))]
    np.testing.assert_array_equal(of_cell, MPa(15))

    # nothing was measured at 5 MPa
    of_class = train.discharge_pressure[find_sources(train, "normal", MPa(5))]
    np.testing.assert_array_equal(of_class, [MPa(10)] * 12 + [MPa(15)] * 12)


@settings(max_examples=20, deadline=None)
@given(count=st.integers(1, 40), seed=st.integers(0, 10))
def test_duplicates_are_measured_windows_used_equally_often(count: int, seed: int) -> None:
    train = measured()
    synthetic = Duplicate()(train, label="piston", pressure=MPa(15), count=count, seed=seed)
    of_cell = train.signal[in_cell(train, "piston", MPa(15))]

    indices = []
    for window in synthetic.signal:
        is_same = (of_cell == window).all(axis=(1, 2))
        indices.append(int(np.flatnonzero(is_same)[0]))

    uses = np.bincount(indices, minlength=len(of_cell))
    assert uses.max() - uses.min() <= 1


# ---- periodic extensions and their spectra


def test_a_window_of_a_steady_machine_closes_to_its_revolution() -> None:
    angle = 2 * np.pi * np.arange(3 * LENGTH) / PERIOD
    steady = np.stack([np.sin(7 * angle), np.cos(3 * angle + 1)])
    train = measured()
    assert extension_length(train, 0) == PERIOD

    # the closed window continues the signal on both sides, as only its own period does
    ring = close_period(steady[:, 100 : 100 + LENGTH].astype(np.float32), PERIOD)
    around = ring[:, np.arange(-100, LENGTH) % PERIOD]
    np.testing.assert_allclose(around, steady[:, : LENGTH + 100], atol=1e-6)


def test_a_window_of_an_unknown_speed_closes_without_a_step() -> None:
    train = measured()
    unknown = replace(train, speed=np.full(len(train), np.nan))
    length = extension_length(unknown, 0)
    assert length == 288

    drift = np.linspace(0, 100, LENGTH)[None].astype(np.float32)
    ring = close_period(drift, length)[:, np.arange(2 * length) % length]
    # the ends of an extension that is only repeated are 90 apart
    assert np.abs(np.diff(ring)).max() < 10


def test_periodic_extensions_at_different_speeds_have_one_length_and_become_windows_again() -> None:
    train = measured()
    speed_factors = np.where(np.arange(len(train)) % 2, 1.0, 1.1)
    mixed = replace(train, speed=speed_factors * train.speed)
    both_speeds = np.array([0, 1])

    extensions = periodic_extensions(mixed, both_speeds, PERIOD)
    assert extensions.shape == (2, 2, PERIOD)

    windows = cut_extensions(extensions, mixed, both_speeds, random_stream(0, "angle"))
    assert windows.shape == (2, 2, LENGTH)
    np.testing.assert_allclose(windows.std(axis=2), mixed.signal[:2].std(axis=2), rtol=0.1)


@pytest.fixture
def extensions() -> np.ndarray:
    return random_stream(0, "rings").normal(size=(6, 2, 64))


def test_amplitudes_and_phases_rebuild_a_periodic_extension(extensions: np.ndarray) -> None:
    rebuilt = with_amplitude(extensions, log_amplitude(extensions))
    np.testing.assert_allclose(rebuilt, extensions, atol=1e-9)


def test_scores_of_a_spectral_form_rebuild_a_periodic_extension(extensions: np.ndarray) -> None:
    condition = np.eye(2)[[0, 1, 0, 1, 0, 1]]
    form = SpectralForm.fit(extensions, condition, 3, 0)
    scores = form.scores(extensions, condition)
    rebuilt = form.rebuild(scores, condition, extensions, condition)
    np.testing.assert_allclose(rebuilt, extensions, atol=1e-9)

    # scores and conditions of another extension replace its amplitudes and no phases
    swapped_scores = scores[::-1].copy()
    swapped_condition = condition[::-1].copy()
    swapped = form.rebuild(swapped_scores, swapped_condition, extensions, condition)
    np.testing.assert_allclose(form.scores(swapped, swapped_condition), swapped_scores, atol=1e-6)


# ---- generative models and interpolation


@pytest.mark.parametrize(
    "model",
    [
        CVAE(components=4, width=32, steps=300),
        WGANGP(components=4, width=32, steps=100, learning_rate=1e-3),
    ],
)
def test_a_generative_model_learns_the_level_of_each_class_and_pressure(model: Filler) -> None:
    train = measured()
    for pressure in (MPa(10), MPa(15)):
        synthetic = model(train, label="normal", pressure=pressure, count=60, seed=0).signal
        of_cell = train.signal[in_cell(train, "normal", pressure)]

        level = synthetic.std(axis=2).mean(axis=0)
        measured_level = of_cell.std(axis=2).mean(axis=0)
        np.testing.assert_allclose(level, measured_level, rtol=0.12)


def test_smote_on_samples_lies_between_two_windows_of_the_cell() -> None:
    train = measured()
    synthetic = SMOTE()(train, label="piston", pressure=MPa(15), count=20, seed=0)
    of_cell = train.signal[in_cell(train, "piston", MPa(15))].reshape(8, -1).astype(float)

    for window in synthetic.signal.reshape(20, -1):
        gaps = []
        for first, second in itertools.combinations(of_cell, 2):
            difference = second - first
            share = (window - first) @ difference / (difference @ difference)
            nearest_point = first + np.clip(share, 0, 1) * difference
            gaps.append(np.abs(window - nearest_point).max())
        assert min(gaps) < 1e-4


ONE_CELL = {"label": "piston", "pressure": MPa(15), "count": 5, "seed": 0}


@pytest.mark.parametrize("filler", [SMOTE(), ADASYN()])
def test_a_single_window_has_no_neighbor_to_interpolate_with(filler: Filler) -> None:
    with pytest.raises(NoNeighborsError, match="there is one"):
        filler(measured(1), **ONE_CELL)  # type: ignore[arg-type]


def test_two_windows_are_enough_for_smote() -> None:
    # ADASYN also needs a neighbor of another class, which two windows need not have
    assert len(SMOTE()(measured(2), **ONE_CELL)) == 5  # type: ignore[arg-type]
