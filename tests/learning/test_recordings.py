"""Whole recordings: what their levels are, what a machine's own healthy ones take off, and what a
model makes of it.
"""

from dataclasses import replace

import numpy as np
import pytest

from swashtwin.diagnosis import FaultClassifier
from swashtwin.foundation import DataError, InputError, MPa, rpm
from swashtwin.learning import cut_windows, fit_best_candidate
from swashtwin.learning.recordings.recording_bands import RecordingBandLayout
from swashtwin.learning.recordings.recording_table import RecordingTable
from swashtwin.learning.recordings.stretches import join_windows, recording_rows
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import Recording

RATE = 4096.0
SHAFT = 16.0
SAMPLES = 8192
LAYOUT = RecordingBandLayout(RATE, SAMPLES, 40)
FIRST_LINE = 24


def signal(
    seed: int, lines: dict[int, float] | None = None, samples: int = SAMPLES, shaft: float = SHAFT
) -> np.ndarray:
    draw = np.random.default_rng(seed)
    time = np.arange(samples) / RATE
    tones = [
        a * np.sin(2 * np.pi * k * shaft * time + draw.uniform(0, 6))
        for k, a in (lines or {}).items()
    ]

    return (
        0.1 * draw.normal(size=(2, samples)) + np.sum(tones, axis=0)
        if tones
        else draw.normal(size=(2, samples))
    )


def test_a_line_reads_its_mean_square_at_any_length_and_where_the_stated_speed_is_off() -> None:
    for samples, stated in ((SAMPLES, SHAFT), (SAMPLES // 2, SHAFT), (3 * SAMPLES, SHAFT * 1.01)):
        band_powers = LAYOUT.measure(signal(0, {7: 1.0, 14: 0.5}, samples), stated)
        assert band_powers.shape == (2, LAYOUT.n_band_powers)
        np.testing.assert_allclose(band_powers[:, FIRST_LINE + 6], 10 * np.log10(0.5), atol=0.2)
        np.testing.assert_allclose(band_powers[:, FIRST_LINE + 13], 10 * np.log10(0.125), atol=0.3)


@pytest.mark.parametrize("n_orders", [40, 0])
def test_no_gain_changes_shapes_or_envelopes(n_orders: int) -> None:
    layout = RecordingBandLayout(RATE, SAMPLES, n_orders)
    quiet, loud = (layout.measure(gain * signal(1), SHAFT) for gain in (1.0, 10.0))

    np.testing.assert_allclose(
        loud[:, : layout.n_scaled] - quiet[:, : layout.n_scaled], 20, atol=1e-3
    )
    np.testing.assert_allclose(layout.shapes(loud), layout.shapes(quiet), atol=1e-3)
    np.testing.assert_allclose(layout.without_gain(loud - quiet), 0, atol=1e-3)


@pytest.mark.parametrize("stride", [400, 1000])
def test_windows_are_put_together_to_the_recording_they_were_cut_from(stride: int) -> None:
    whole = signal(2, samples=5000)
    windows = cut_windows(
        [Recording(whole, RATE, "a", channels=("x", "y"))], length=1000, stride=stride
    )
    (stretch,) = join_windows(windows, recording_rows(windows)[0])

    np.testing.assert_array_equal(stretch, whole[:, : stretch.shape[1]].astype(np.float32))

    first, second = join_windows(
        windows.subset(windows.start != 2000)
        if stride == 1000
        else windows.subset(np.array([0, 5])),
        np.r_[0, 1] if stride == 400 else np.arange(4),
    )

    assert first.shape[1] + second.shape[1] == (4000 if stride == 1000 else 2000)


def test_changes_know_machine_and_point_but_never_the_recording_itself() -> None:
    draw = np.random.default_rng(3)
    shape = (2, LAYOUT.n_band_powers)
    of_point = {5e6: np.zeros(shape), 15e6: draw.normal(size=shape)}
    of_machine = {name: draw.normal(size=shape) for name in "ABC"}
    keys = [
        (name, pressure, number) for name in "ABC" for pressure in of_point for number in (1, 2)
    ]
    band_powers = np.stack(
        [of_machine[name] + of_point[pressure] for name, pressure, _ in keys]
    ).astype(np.float32)
    condition = np.array([(90.0, pressure) for _, pressure, _ in keys])
    specimen = tuple(key[0] for key in keys)
    ids = tuple(map(str, keys))
    healthy = RecordingTable(band_powers, specimen, condition, ids)

    np.testing.assert_allclose(healthy.changes(LAYOUT, healthy), 0, atol=1e-5)

    odd = band_powers.copy()
    odd[0] += np.linspace(-2, 2, LAYOUT.n_band_powers)
    other = replace(healthy, band_powers=odd)

    np.testing.assert_allclose(other.changes(LAYOUT, other)[0], odd[0] - band_powers[0], atol=1e-5)

    elsewhere = healthy.changes(
        LAYOUT, RecordingTable(band_powers[:1], ("D",), condition[:1], ("new",))
    )

    assert np.isnan(elsewhere).all()


def machine(name: str, labels: str = "nnnppp") -> list[Recording]:
    """Healthy and worn recordings of a pump, whose own resonance is as large as what wear adds."""
    own = np.random.default_rng(list(name.encode())).uniform(0, 1.5)
    condition = OperatingCondition(speed=rpm(60 * SHAFT), discharge_pressure=MPa(10))
    measured = []

    for number, letter in enumerate(labels):
        lines = {7: 1.0, 9: 0.3 + own + (0.8 if letter == "p" else 0.0), 5: 0.5}
        measured.append(
            Recording(
                signal(100 * ord(name) + number, lines), RATE, f"{name} {number}", channels=("x", "y"),
                label="normal" if letter == "n" else "piston", specimen=name, condition=condition,
            )
        )  # fmt: skip

    return measured


@pytest.fixture(scope="module")
def classifier() -> FaultClassifier:
    return FaultClassifier().fit([item for name in "ABC" for item in machine(name)])


def test_own_healthy_recordings_name_a_new_machine_and_the_answer_says_what_they_would_buy(
    classifier, tmp_path
) -> None:
    choice = classifier.fitted_.choice
    assert choice.n_machines == 3
    assert choice.sentence().endswith("This rests on 3 machines.")
    assert choice.head_recalls["with baseline"] > choice.head_recalls["without baseline"]

    new = machine("G")
    healthy = [item.replace(label=None) for item in machine("G")[:3]]
    without = [classifier.diagnose(item) for item in new]

    assert all(any("Pass some as healthy" in text for text in answer.notes) for answer in without)

    compared = classifier.with_healthy(healthy)
    answers = [compared.diagnose(item) for item in new]

    assert [answer.label for answer in answers] == [item.label for item in new]
    assert classifier.diagnose(new[4], healthy=healthy).to_dict() == answers[4].to_dict()
    assert not any("as healthy" in text for answer in answers for text in answer.notes)

    loaded = FaultClassifier.load(compared.save(tmp_path / "model.safetensors"))
    assert loaded.diagnose(new[4]).to_dict() == answers[4].to_dict()


@pytest.mark.parametrize(
    ("change", "error", "words"),
    [
        ({"specimen": None}, InputError, "does not specify its machine"),
        ({"label": "piston"}, InputError, "is labeled piston"),
        ({"specimen": "H"}, DataError, "is the only healthy recording of H"),
        ({"sample_rate": 8192.0}, DataError, "does not fit the model"),
    ],
)
def test_what_is_no_healthy_recording_is_refused(classifier, change, error, words) -> None:
    with pytest.raises(error, match=words):
        classifier.with_healthy([machine("G")[0].replace(**change)])


def test_a_named_network_compares_with_nothing() -> None:
    named = FaultClassifier("band_powers", window=2048).fit(machine("A"))
    with pytest.raises(InputError, match="does not compare with healthy recordings"):
        named.with_healthy(machine("G")[:2])


def test_a_class_that_nobody_measured_is_told_by_levels_alone() -> None:
    measured = cut_windows([item for name in "AB" for item in machine(name)], length=SAMPLES)
    classes = ("normal", "piston", "valve_plate")
    made = cut_windows([item for item in machine("C") if item.label == "piston"], length=SAMPLES)
    made = replace(
        made, classes=("valve_plate",), synthetic=np.ones(len(made), dtype=bool), specimen=np.full(len(made), "twin"),
        recording_id=np.array([f"made {number}" for number in range(len(made))]), content={},
    )  # fmt: skip
    fitted = fit_best_candidate(measured.with_classes(classes) + made.with_classes(classes))

    assert fitted.recordings.on_changes is None
    assert np.isfinite(fitted.predict_proba(measured.with_classes(classes))).all()
