"""Evidence for networks on levels: from the mean of the training, it adds up and names the line
that differs.
"""

import numpy as np
import pytest

from swashtwin.diagnosis import Evidence, diagnose, explain
from swashtwin.diagnosis.attribution import evidence_bands, feature_shares
from swashtwin.foundation import MPa, rpm
from swashtwin.learning import BandPowerNetwork, TrainingSettings, cut_windows, fit
from swashtwin.learning.networks.window_features import (
    gain_response,
    window_bands,
    window_features,
)
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import Recording
from swashtwin.report import write_report

RATE = 1024.0
SHAFT = 8.0
LENGTH = 1024
HEADS = [("discriminant",), ("hidden",), ("discriminant", "hidden")]


def recording(name: str, label: str) -> Recording:
    """Noise, and for valve_plate the 9th order on the second channel."""
    draw = np.random.default_rng(list(name.encode()))
    angle = 2 * np.pi * SHAFT * np.arange(24 * LENGTH) / RATE + draw.uniform(0, 6)
    signal = draw.normal(size=(2, angle.size))
    if label == "valve_plate":
        signal[1] += 0.3 * np.cos(9 * angle)
    condition = OperatingCondition(speed=rpm(60 * SHAFT), discharge_pressure=MPa(15))

    return Recording(
        signal,
        RATE,
        name,
        label=label,
        condition=condition,
        channels=("base_x", "cover_z"),
    )


def evidence_of(axis: str, shape: bool, heads: tuple[str, ...]) -> Evidence:
    labels = ("normal", "valve_plate")
    train = cut_windows(
        [recording(f"{label} {n}", label) for label in labels for n in range(3)],
        length=LENGTH,
    )
    network = BandPowerNetwork(
        2, 2, axis=axis, shape=shape, heads=heads, turns=SHAFT / RATE, hidden=16
    )
    classifier = fit(network, train, settings=TrainingSettings(epochs=1, normalization="set"))
    new = recording("new", "valve_plate")
    new = new.replace(attributes={**new.attributes, "pistons": "9"})

    return explain(classifier, new, diagnose(classifier, new))


@pytest.fixture(scope="module")
def evidence() -> Evidence:
    return evidence_of("order", True, HEADS[-1])


@pytest.mark.parametrize(
    ("axis", "shape", "heads"),
    [("order", False, HEADS[0]), ("frequency", True, HEADS[1])],
)
def test_contributions_of_each_head_add_up(axis: str, shape: bool, heads: tuple[str, ...]) -> None:
    result = evidence_of(axis, shape, heads)
    assert result.completeness_error < (1e-4 if heads == ("discriminant",) else 0.1)
    assert result.strongest()[0][:2] == (
        "cover_z",
        next(band for band in result.bands if band.name == "order 9"),
    )


def test_contributions_of_an_average_add_up_to_its_margin_and_name_the_line(
    evidence: Evidence,
) -> None:
    assert evidence.completeness_error < 0.01
    assert evidence.contributions.sum() == pytest.approx(evidence.margin, rel=0.01)
    assert "order 9 (72 Hz, piston-pass line) on cover_z" in evidence.sentences()[0]


def test_the_page_names_the_mean_of_the_training_and_the_envelope(
    evidence: Evidence, tmp_path
) -> None:
    text = write_report(evidence, folder=tmp_path).read_text(encoding="utf-8")
    assert "Compared with the mean of the training, these samples" in text
    assert "silence" not in text

    table = np.genfromtxt(
        tmp_path / "figures" / "evidence_lines.csv",
        delimiter=",",
        names=True,
        dtype=None,
    )

    assert {"envelope order 9", "envelope level", "waveform shape"} <= set(table["band"])


@pytest.mark.parametrize("orders", [True, False])
def test_the_catalogue_names_the_levels_that_a_line_raises(orders: bool) -> None:
    turns = 0.01
    frequency = 0.093
    line = np.sin(2 * np.pi * frequency * np.arange(2048)).astype(np.float32)[None, None]
    band_powers = window_features(line, np.array([turns]) if orders else None)[0, 0]
    catalogue = window_bands(2048, orders)

    assert len(catalogue) == len(band_powers) == len(gain_response(orders))

    powers = [
        index
        for index, level in enumerate(catalogue)
        if level.quantity == "power" and not level.is_envelope
    ]

    for kind in (powers[:-48], powers[-48:]):  # narrow lines, logarithmic bands
        low, high = catalogue[max(kind, key=band_powers.__getitem__)].edges(turns)
        assert low <= frequency <= high


def test_shares_of_each_level_sum_to_one_and_orders_stay_whole() -> None:
    bands = evidence_bands(RATE, SHAFT, LENGTH)
    catalogue = window_bands(LENGTH, uses_orders=True)
    shares = feature_shares(catalogue, bands, RATE, SHAFT / RATE)

    np.testing.assert_allclose(shares.sum(axis=1), 1)

    names = [band.name for band in bands]
    assert shares[5 + 8, names.index("order 9")] == pytest.approx(1)
