"""Prominences of lines: what a bearing's flaw raises, and what gain, sensor and speed leave alone."""

import numpy as np
import pytest
import scipy

from swashtwin.foundation import DataError
from swashtwin.learning.networks.line_prominence_network import LineProminenceNetwork
from swashtwin.learning.networks.line_prominences import (
    ENVELOPE_BANDS,
    N_CELLS,
    N_SHAPE_BANDS,
    N_SIGNATURE,
    line_prominences,
    n_features,
    prominent_bands,
)

LENGTH = 8192
TURNS = 0.0025
OUTER_RACE = 3.05
INNER_RACE = 4.95


def struck_housing(
    order: float, *, turns: float = TURNS, load_zone: bool = False, seed: int = 0
) -> np.ndarray:
    """Return a window of a resonance that a flaw strikes `order` times a turn, in noise.

    With `load_zone` the strikes are hard once a turn of the shaft, as those of the inner race.
    """
    draw = np.random.default_rng(seed)
    angle = turns * np.arange(LENGTH)
    is_strike = np.diff(np.floor(order * angle), prepend=0.0) > 0
    strength = 1 + np.cos(2 * np.pi * angle) if load_zone else np.ones(LENGTH)

    time = np.arange(200)
    ringing = np.exp(-time / 15) * np.sin(2 * np.pi * 0.27 * time)
    signal = scipy.signal.lfilter(ringing, 1.0, is_strike * strength)
    signal += 0.1 * draw.normal(size=LENGTH)
    return signal.astype(np.float32)[None, None]


def features_of(signal: np.ndarray, turns: float = TURNS) -> np.ndarray:
    return line_prominences(signal, np.array([turns]))[0, 0]


def envelope_parts(features: np.ndarray) -> list[np.ndarray]:
    """Return the features of each envelope: its lines, then its comb."""
    return np.split(features[N_SHAPE_BANDS + N_CELLS :], len(ENVELOPE_BANDS))


def most_prominent_order(features: np.ndarray) -> float:
    """Return the middle of the most prominent lines of the last envelope, up to order 6."""
    lines = envelope_parts(features)[-1][:24]
    return 0.25 * (float(lines.argmax()) + 0.5)


def test_a_flaw_raises_the_line_of_its_rate() -> None:
    assert most_prominent_order(features_of(struck_housing(OUTER_RACE))) == 3.125
    assert most_prominent_order(features_of(struck_housing(INNER_RACE))) == 4.875


def test_lines_stay_at_their_orders_if_the_speed_changes() -> None:
    fast = struck_housing(OUTER_RACE, turns=1.2 * TURNS)

    assert most_prominent_order(features_of(fast, 1.2 * TURNS)) == 3.125


def test_a_comb_stands_out_and_has_side_bands_if_the_load_zone_modulates_it() -> None:
    outer = envelope_parts(features_of(struck_housing(OUTER_RACE)))[-1][-N_SIGNATURE:]
    inner = envelope_parts(features_of(struck_housing(INNER_RACE, load_zone=True)))[-1]
    inner = inner[-N_SIGNATURE:]

    noise = np.random.default_rng(1).normal(size=(1, 1, LENGTH)).astype(np.float32)
    plain = envelope_parts(features_of(noise))[-1][-N_SIGNATURE:]

    # the comb stands out with either flaw; its side bands at the shaft with the inner race alone
    assert min(outer[0], inner[0]) > plain[0] + 0.5
    assert inner[1] > outer[1] + 0.5


def test_neither_gain_nor_a_smooth_transfer_path_changes_prominences() -> None:
    signal = struck_housing(OUTER_RACE)
    loud = features_of(30 * signal)
    plain = features_of(signal)
    np.testing.assert_allclose(loud, plain, atol=2e-3)

    # a slope of the spectrum changes its shape, and hardly the prominence of the flaw's line
    other_sensor = scipy.signal.lfilter([1.0, 0.6], 1.0, signal).astype(np.float32)
    changed = features_of(other_sensor)
    assert np.abs(changed - plain)[:N_SHAPE_BANDS].max() > 0.2
    lines = envelope_parts(changed - plain)[-1][:N_CELLS]
    assert abs(lines[12]) < 0.1


@pytest.mark.parametrize("uses_orders", [True, False])
def test_the_catalogue_names_the_lines_that_a_sine_raises(uses_orders: bool) -> None:
    turns = np.array([TURNS]) if uses_orders else None
    frequency = 0.0077
    noise = 0.01 * np.random.default_rng(0).normal(size=LENGTH)
    sine = np.sin(2 * np.pi * frequency * np.arange(LENGTH)) + noise
    features = line_prominences(sine.astype(np.float32)[None, None], turns)[0, 0]
    catalogue = prominent_bands(LENGTH, uses_orders)

    assert len(catalogue) == len(features) == n_features(uses_orders)

    lines = features[N_SHAPE_BANDS : N_SHAPE_BANDS + N_CELLS]
    if uses_orders:
        low, high = catalogue[N_SHAPE_BANDS + int(lines.argmax())].edges(TURNS)
    else:
        # without a speed the lines end at sixteen times twenty spectral lines
        frequency_end = catalogue[N_SHAPE_BANDS + N_CELLS - 1].high
        assert frequency_end == pytest.approx(320.5 / LENGTH, rel=1e-2)
        low, high = catalogue[N_SHAPE_BANDS + int(lines.argmax())].edges(None)
    assert low <= frequency <= high


def test_silence_and_short_windows_have_finite_features() -> None:
    for length in (64, 2048):
        silence = np.zeros((2, 1, length), dtype=np.float32)
        turns = np.full(2, 20 / length)

        assert np.isfinite(line_prominences(silence, turns)).all()
        assert np.isfinite(line_prominences(silence, None)).all()


def test_orders_need_a_speed_and_a_default_speed_takes_its_place() -> None:
    signal = struck_housing(OUTER_RACE)
    unknown = np.array([np.nan])

    with pytest.raises(DataError, match="specify the speed"):
        LineProminenceNetwork(1, 2, axis="order").represent_at(signal, unknown)

    network = LineProminenceNetwork(1, 2, axis="order", turns=TURNS)
    np.testing.assert_array_equal(
        network.represent_at(signal, unknown),
        network.represent_at(signal, np.array([TURNS])),
    )
