"""Every filler: layout, marks, seeds, finite samples, and nothing but measured training windows to
draw from.
"""

import math
from dataclasses import replace

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
PERIOD = 256
"""Readings per revolution."""
RATE = PERIOD * rpm(1200) / (2 * np.pi)
LENGTH = 320


def measured(scarce: int = 8, classes: tuple[str, ...] = CLASSES) -> WindowSet:
    """Windows of two classes at two pressures, of which the last at 15 MPa has `scarce` windows of
    one recording.
    """
    rng = random_stream(0, "measured")
    facts = [
        (label, pressure, recording)
        for label in CLASSES
        for pressure in (10, 15)
        for recording in (
            range(2) if (label, pressure) != (CLASSES[-1], 15) else range(min(scarce, 1))
        )
    ]
    parts = []
    for label, pressure, recording in facts:
        count = scarce if (label, pressure) == (CLASSES[-1], 15) else 6
        angle = 2 * np.pi * (np.arange(LENGTH) / PERIOD + rng.random((count, 1)))
        tone = np.stack([np.sin(7 * angle), np.cos(7 * angle)], axis=1) * pressure / 10
        if label == "piston":
            tone[:, 0] += np.sin(angle)
        parts.append(
            WindowSet(
                signal=(tone + 0.2 * rng.normal(size=tone.shape)).astype(np.float32),
                target=np.full(count, classes.index(label), dtype=np.int64),
                classes=classes,
                recording_id=np.array([f"{label}_{pressure}_{recording}"] * count),
                specimen=np.array(["p1"] * count),
                discharge_pressure=np.full(count, MPa(pressure)),
                speed=np.full(count, rpm(1200)),
                start=np.arange(count, dtype=np.int64) * LENGTH,
                synthetic=np.zeros(count, dtype=bool),
                sample_rate=RATE,
                channels=("x", "y"),
            )
        )
    joined = parts[0]
    for part in parts[1:]:
        joined = joined + part
    return joined


QUICK: dict[str, Filler] = {
    name: replace(filler, steps=20, width=16, components=8)  # type: ignore[type-var]
    if isinstance(filler, CVAE | WGANGP)
    else filler
    for name, filler in FILLERS.items()
}
"""The registry, its networks small and hardly trained."""


def filled(name: str, train: WindowSet, **changes: object) -> WindowSet:
    arguments = {"label": "piston", "pressure": MPa(15), "count": 9, "seed": 3} | changes
    return QUICK[name](train, **arguments)  # type: ignore[arg-type]


every = pytest.mark.parametrize("name", FILLERS)


@every
@pytest.mark.parametrize("scarce", [8, 0])
def test_a_filler_gives_as_many_marked_windows_of_the_cell_as_asked(name: str, scarce: int) -> None:
    train = measured(scarce)
    synthetic = filled(name, train)
    assert isinstance(FILLERS[name], Filler)
    assert len(synthetic) == 9
    assert synthetic.synthetic.all()
    assert set(synthetic.label) == {"piston"}
    assert synthetic.classes == train.classes
    assert synthetic.layout == train.layout
    np.testing.assert_array_equal(synthetic.discharge_pressure, MPa(15))
    np.testing.assert_allclose(synthetic.speed, rpm(1200), rtol=0.02)
    assert len(set(synthetic.recording_id)) == 9
    assert not set(synthetic.recording_id) & set(train.recording_id)
    assert np.isfinite(synthetic.signal).all()
    assert synthetic.signal.std(axis=2).min() > 0
    assert len(train + synthetic) == len(train) + 9


@every
def test_the_same_seed_gives_the_same_bits_and_another_seed_others(name: str) -> None:
    train = measured()
    first, again, other = (filled(name, train, seed=seed).signal for seed in (0, 0, 1))
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - other).max() > 0.01


@every
def test_a_filler_does_not_look_at_synthetic_windows(name: str) -> None:
    train = measured()
    poison = replace(
        train, signal=train.signal * np.float32(1e4), synthetic=np.ones(len(train), dtype=bool)
    )
    np.testing.assert_array_equal(filled(name, train + poison).signal, filled(name, train).signal)


@every
def test_a_filler_takes_a_set_without_pressures(name: str) -> None:
    train = measured()
    nowhere = replace(train, discharge_pressure=np.full(len(train), np.nan))
    synthetic = filled(name, nowhere, pressure=math.nan)
    assert np.isnan(synthetic.discharge_pressure).all()
    assert np.isfinite(synthetic.signal).all()


@every
def test_data_alone_do_not_fill_a_class_that_nobody_measured(name: str) -> None:
    train = measured(classes=("normal", "piston", "valve_plate"))
    with pytest.raises(DataError, match="a twin can"):
        filled(name, train, label="valve_plate")


@every
def test_what_a_filler_cannot_make_is_refused(name: str) -> None:
    train = measured()
    with pytest.raises(InputError, match="not among the windows' classes"):
        filled(name, train, label="slipper")
    with pytest.raises(InputError, match="at least 1"):
        filled(name, train, count=0)
    with pytest.raises(InputError, match="must be positive"):
        filled(name, train, pressure=-1.0)


def test_a_cell_s_own_windows_are_drawn_from_and_where_there_are_none_those_of_its_class() -> None:
    train = measured()
    np.testing.assert_array_equal(
        train.discharge_pressure[find_sources(train, "piston", MPa(15.3))], MPa(15)
    )
    np.testing.assert_array_equal(
        train.discharge_pressure[find_sources(train, "normal", MPa(5))],
        [MPa(10)] * 12 + [MPa(15)] * 12,
    )
    assert in_cell(train, "piston", MPa(15)).sum() == 8


@settings(max_examples=20, deadline=None)
@given(count=st.integers(1, 40), seed=st.integers(0, 10))
def test_a_duplicate_is_a_measured_window_and_none_comes_thrice_before_all_came_twice(
    count: int, seed: int
) -> None:
    train = measured()
    synthetic = Duplicate()(train, label="piston", pressure=MPa(15), count=count, seed=seed).signal
    of_cell = train.signal[in_cell(train, "piston", MPa(15))]
    indices = [int(np.flatnonzero((of_cell == window).all(axis=(1, 2)))[0]) for window in synthetic]
    uses = np.bincount(indices, minlength=len(of_cell))
    assert uses.max() - uses.min() <= 1


def test_a_window_of_a_steady_machine_closes_to_its_revolution() -> None:
    angle = 2 * np.pi * np.arange(3 * LENGTH) / PERIOD
    steady = np.stack([np.sin(7 * angle), np.cos(3 * angle + 1)])
    train = measured()
    assert extension_length(train, 0) == PERIOD
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
    assert np.abs(np.diff(ring)).max() < 10  # the ends are 90 apart


def test_periodic_extensions_at_different_speeds_have_one_length_and_become_windows_again() -> None:
    train = measured()
    mixed = replace(train, speed=np.where(np.arange(len(train)) % 2, 1.0, 1.1) * train.speed)
    both = np.array([0, 1])
    extensions = periodic_extensions(mixed, both, PERIOD)
    assert extensions.shape == (2, 2, PERIOD)
    windows = cut_extensions(extensions, mixed, both, random_stream(0, "angle"))
    assert windows.shape == (2, 2, LENGTH)
    np.testing.assert_allclose(windows.std(axis=2), mixed.signal[:2].std(axis=2), rtol=0.1)


def test_amplitudes_and_phases_rebuild_a_periodic_extension() -> None:
    extensions = random_stream(0, "rings").normal(size=(6, 2, 64))
    np.testing.assert_allclose(
        with_amplitude(extensions, log_amplitude(extensions)), extensions, atol=1e-9
    )
    condition = np.eye(2)[[0, 1, 0, 1, 0, 1]]
    form = SpectralForm.fit(extensions, condition, 3, 0)
    scores = form.scores(extensions, condition)
    np.testing.assert_allclose(
        form.rebuild(scores, condition, extensions, condition), extensions, atol=1e-9
    )
    other = form.rebuild(scores[::-1].copy(), condition[::-1].copy(), extensions, condition)
    np.testing.assert_allclose(form.scores(other, condition[::-1].copy()), scores[::-1], atol=1e-6)


@pytest.mark.parametrize(
    "model",
    [
        CVAE(components=4, width=32, steps=300),
        WGANGP(components=4, width=32, steps=100, learning_rate=1e-3),
    ],
)
def test_a_generative_model_learns_which_class_and_pressure_makes_which_level(
    model: Filler,
) -> None:
    train = measured()
    arguments = {"label": "normal", "count": 60, "seed": 0}
    level = [
        model(train, pressure=MPa(p), **arguments).signal.std(axis=2).mean(axis=0) for p in (10, 15)
    ]
    measured_level = [
        train.signal[in_cell(train, "normal", MPa(p))].std(axis=2).mean(axis=0) for p in (10, 15)
    ]
    np.testing.assert_allclose(level, measured_level, rtol=0.12)


def test_smote_on_samples_lies_between_two_windows_of_the_cell() -> None:
    train = measured()
    of_cell = train.signal[in_cell(train, "piston", MPa(15))].reshape(8, -1).astype(float)
    synthetic = SMOTE()(train, label="piston", pressure=MPa(15), count=20, seed=0).signal.reshape(
        20, -1
    )
    pairs = [(a, b) for i, a in enumerate(of_cell) for b in of_cell[i + 1 :]]
    for window in synthetic:
        share = [np.clip((window - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1) for a, b in pairs]
        gap = [
            np.abs(window - a - s * (b - a)).max() for (a, b), s in zip(pairs, share, strict=True)
        ]
        assert min(gap) < 1e-4


@pytest.mark.parametrize("filler", [SMOTE(), ADASYN()])
def test_two_windows_have_something_between_them_and_one_has_not(filler: Filler) -> None:
    arguments = {"label": "piston", "pressure": MPa(15), "count": 5, "seed": 0}
    with pytest.raises(NoNeighborsError, match="there is one"):
        filler(measured(1), **arguments)
    if not isinstance(filler, ADASYN):
        assert len(filler(measured(2), **arguments)) == 5
