"""Whole recordings: their band powers, the change from a machine's baseline, and models of it."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from swashtwin.diagnosis import AnomalyDetector, FaultClassifier, compare_with_healthy
from swashtwin.foundation import DataError, InputError, MPa, rpm
from swashtwin.learning import cut_windows, fit_best_candidate
from swashtwin.learning.recordings.recording_bands import RecordingBandLayout
from swashtwin.learning.recordings.recording_table import (
    RecordingTable,
    join_windows,
    recording_rows,
)
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import Recording

RATE = 4096.0
SHAFT = 16.0
SAMPLES = 8192
LAYOUT = RecordingBandLayout(RATE, SAMPLES, 40)
FIRST_LINE = 24


def signal(
    seed: int,
    lines: dict[int, float] | None = None,
    samples: int = SAMPLES,
    shaft: float = SHAFT,
) -> np.ndarray:
    draw = np.random.default_rng(seed)
    time = np.arange(samples) / RATE
    if not lines:
        return draw.normal(size=(2, samples))

    tones = [
        amplitude * np.sin(2 * np.pi * order * shaft * time + draw.uniform(0, 6))
        for order, amplitude in lines.items()
    ]
    return 0.1 * draw.normal(size=(2, samples)) + np.sum(tones, axis=0)


def test_a_line_has_its_mean_square_at_any_length_and_if_the_specified_speed_is_off() -> None:
    cases = ((SAMPLES, SHAFT), (SAMPLES // 2, SHAFT), (3 * SAMPLES, SHAFT * 1.01))
    for samples, specified_speed in cases:
        band_powers = LAYOUT.measure(signal(0, {7: 1.0, 14: 0.5}, samples), specified_speed)

        assert band_powers.shape == (2, LAYOUT.n_band_powers)
        np.testing.assert_allclose(band_powers[:, FIRST_LINE + 6], 10 * np.log10(0.5), atol=0.2)
        np.testing.assert_allclose(band_powers[:, FIRST_LINE + 13], 10 * np.log10(0.125), atol=0.3)


@pytest.mark.parametrize("n_orders", [40, 0])
def test_no_gain_changes_shapes_or_envelopes(n_orders: int) -> None:
    layout = RecordingBandLayout(RATE, SAMPLES, n_orders)
    quiet = layout.measure(signal(1), SHAFT)
    loud = layout.measure(10.0 * signal(1), SHAFT)
    # ten times the amplitude is 20 dB
    gain_db = (loud - quiet)[:, : layout.n_scaled]
    np.testing.assert_allclose(gain_db, 20, atol=1e-3)
    np.testing.assert_allclose(layout.shapes(loud), layout.shapes(quiet), atol=1e-3)
    np.testing.assert_allclose(layout.without_gain(loud - quiet), 0, atol=1e-3)


@pytest.mark.parametrize("stride", [400, 1000])
def test_windows_are_joined_to_the_recording_they_were_cut_from(stride: int) -> None:
    whole = signal(2, samples=5000)
    recording = Recording(whole, RATE, "a", channels=("x", "y"))
    windows = cut_windows([recording], length=1000, stride=stride)
    (stretch,) = join_windows(windows, recording_rows(windows)[0])

    np.testing.assert_array_equal(stretch, whole[:, : stretch.shape[1]].astype(np.float32))

    # a gap splits a recording into two stretches
    if stride == 1000:
        gapped = windows.subset(windows.start != 2000)
        n_samples = 4000
    else:
        gapped = windows.subset(np.array([0, 5]))
        n_samples = 2000
    first, second = join_windows(gapped, np.arange(len(gapped)))

    assert first.shape[1] + second.shape[1] == n_samples


def test_a_baseline_uses_machine_and_operating_point_but_never_the_recording_itself() -> None:
    draw = np.random.default_rng(3)
    shape = (2, LAYOUT.n_band_powers)
    of_point = {5e6: np.zeros(shape), 15e6: draw.normal(size=shape)}
    of_machine = {name: draw.normal(size=shape) for name in "ABC"}
    keys = list(itertools.product("ABC", of_point, (1, 2)))
    sums = [of_machine[name] + of_point[pressure] for name, pressure, _ in keys]
    band_powers = np.stack(sums).astype(np.float32)
    condition = np.array([(90.0, pressure) for _, pressure, _ in keys])
    specimen = tuple(name for name, _, _ in keys)
    ids = tuple(map(str, keys))
    healthy = RecordingTable(band_powers, specimen, condition, ids)

    # machine and operating point explain every recording, so that nothing changes
    np.testing.assert_allclose(healthy.changes(LAYOUT, healthy), 0, atol=1e-5)

    # a deviation stays whole: the recording is not part of its own baseline
    deviation = np.linspace(-2, 2, LAYOUT.n_band_powers)
    deviating_powers = band_powers.copy()
    deviating_powers[0] += deviation
    deviating = replace(healthy, band_powers=deviating_powers)
    expected = deviating_powers[0] - band_powers[0]
    np.testing.assert_allclose(deviating.changes(LAYOUT, deviating)[0], expected, atol=1e-5)

    unknown_machine = RecordingTable(band_powers[:1], ("D",), condition[:1], ("new",))
    assert np.isnan(healthy.changes(LAYOUT, unknown_machine)).all()


def machine(name: str, labels: str = "nnnppp") -> list[Recording]:
    """Healthy and worn recordings of a pump whose resonance is as large as what wear adds."""
    resonance = np.random.default_rng(list(name.encode())).uniform(0, 1.5)
    condition = OperatingCondition(speed=rpm(60 * SHAFT), discharge_pressure=MPa(10))
    measured = []

    for number, letter in enumerate(labels):
        wear = 0.8 if letter == "p" else 0.0
        lines = {7: 1.0, 9: 0.3 + resonance + wear, 5: 0.5}
        recording = Recording(
            signal(100 * ord(name) + number, lines),
            RATE,
            f"{name} {number}",
            channels=("x", "y"),
            label="piston" if wear else "normal",
            specimen=name,
            condition=condition,
        )
        measured.append(recording)

    return measured


@pytest.fixture(scope="module")
def classifier() -> FaultClassifier:
    return FaultClassifier().fit([*machine("A"), *machine("B"), *machine("C")])


def test_baseline_recordings_make_the_faults_of_a_new_machine_detectable(
    classifier, tmp_path
) -> None:
    choice = classifier.fitted_.choice
    assert choice.n_machines == 3
    assert "3 training machines, no error rate below 25 %" in choice.describe_machine_limit(0.1)
    assert not choice.describe_machine_limit(0.25)
    assert not replace(choice, n_machines=9).describe_machine_limit(0.1)
    assert not replace(choice, n_machines=0).describe_machine_limit(0.1)
    assert choice.sentence().endswith("This rests on 3 machines.")
    assert choice.head_recalls["with baseline"] > choice.head_recalls["without baseline"]

    new_machine = machine("G")
    assert classifier.diagnose(new_machine[0]).basis.endswith("can be promised for a new one")
    for recording in new_machine:
        notes = " ".join(classifier.diagnose(recording).notes)
        assert "Pass some as healthy" in notes

    baseline = [recording.replace(label=None) for recording in new_machine[:3]]
    compared = classifier.with_healthy(baseline)
    answers = [compared.diagnose(recording) for recording in new_machine]

    assert [answer.label for answer in answers] == [recording.label for recording in new_machine]
    worn = new_machine[4]
    for answer in answers:
        assert "as healthy" not in " ".join(answer.notes)
    loaded = FaultClassifier.load(compared.save(tmp_path / "model.safetensors"))
    assert loaded.diagnose(worn).to_dict() == answers[4].to_dict()


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"specimen": None}, InputError, "does not specify its machine"),
        ({"label": "piston"}, InputError, "is labeled piston"),
        ({"specimen": "H"}, DataError, "is the only healthy recording of H"),
        ({"sample_rate": 8192.0}, DataError, "does not fit the model"),
    ],
)
def test_a_recording_that_is_not_a_baseline_is_refused(classifier, change, error, message) -> None:
    with pytest.raises(error, match=message):
        classifier.with_healthy([machine("G")[0].replace(**change)])


def test_a_selected_network_does_not_compare_with_a_baseline() -> None:
    classifier = FaultClassifier("band_powers", window=2048).fit(machine("A"))
    with pytest.raises(InputError, match=r"of a machine: its network was named.* omit healthy"):
        classifier.with_healthy(machine("G")[:2])


@pytest.mark.parametrize(
    ("recordings", "reason"),
    [
        pytest.param(
            [*machine("A"), *machine("B", "nppp")],
            "requires two healthy recordings of each machine, but has fewer of one machine, B",
            id="one healthy recording of a machine",
        ),
        pytest.param(
            machine("A", "nnnpppnnnppp"),
            "recordings of each class on at least two specified machines",
            id="one machine",
        ),
        pytest.param(machine("A", "np"), "too few recordings of a class", id="few recordings"),
        pytest.param(
            [
                recording.replace(signal=recording.signal[:, :4000])
                for recording in (*machine("A"), *machine("B"))
            ],
            "shorter than 4096 samples",
            id="short recordings",
        ),
    ],
)
def test_training_reports_why_a_model_cannot_compare_with_healthy_recordings(
    recordings: list[Recording], reason: str
) -> None:
    classifier = FaultClassifier().fit(recordings)

    (note,) = [note for note in classifier.notes_ if "does not compare" in note]
    assert reason in note
    with pytest.raises(InputError, match=reason):
        classifier.with_healthy(machine("G")[:2])


def test_a_recording_without_a_machine_is_asked_for_it(classifier) -> None:
    assert not any("does not compare" in note for note in classifier.notes_)

    recording = machine("A")[1]
    (note,) = [
        note
        for note in classifier.diagnose(recording.replace(specimen=None)).notes
        if "does not specify its machine (specimen)" in note
    ]

    assert "3 machines: A, B, C" in note
    assert not any("(specimen)" in note for note in classifier.diagnose(recording).notes)


def test_recordings_without_a_machine_are_of_the_machine_of_the_healthy_ones(classifier) -> None:
    of_machine = machine("G")
    unspecified = [recording.replace(specimen=None) for recording in of_machine]
    compared = classifier.with_healthy(of_machine[:3])
    answers = [compared.diagnose(recording).label for recording in of_machine]

    # The fourth recording shows a fault, and is not compared with.
    for reference, name in ((of_machine[:4], "G"), (unspecified[:4], "this machine")):
        with_machine, recordings = compare_with_healthy(classifier, reference, unspecified)
        assert [recording.specimen for recording in recordings] == [name] * len(of_machine)
        assert [with_machine.diagnose(recording).label for recording in recordings] == answers

    of_two_machines = [*of_machine[:2], *machine("H")[:2]]
    _, recordings = compare_with_healthy(classifier, of_two_machines, unspecified)
    assert [recording.specimen for recording in recordings] == [None] * len(of_machine)


def test_a_comparison_needs_a_classifier_and_a_healthy_recording(classifier) -> None:
    with pytest.raises(InputError, match="No recording to compare with is healthy") as refused:
        compare_with_healthy(classifier, machine("G")[3:], machine("G"))
    assert refused.value.field == "healthy"
    with pytest.raises(InputError, match="Only a classifier compares") as refused:
        compare_with_healthy(AnomalyDetector(), machine("G"), machine("G"))
    assert refused.value.field == "healthy"


def test_a_class_with_synthetic_windows_only_is_learned_without_a_baseline() -> None:
    classes = ("normal", "piston", "valve_plate")
    measured = cut_windows([*machine("A"), *machine("B")], length=SAMPLES)
    worn = cut_windows(machine("C")[3:], length=SAMPLES)
    count = len(worn)
    synthetic = replace(
        worn,
        classes=("valve_plate",),
        synthetic=np.ones(count, dtype=bool),
        specimen=np.full(count, "twin"),
        recording_id=np.array([f"synthetic {number}" for number in range(count)]),
        content={},
    )

    fitted = fit_best_candidate(measured.with_classes(classes) + synthetic.with_classes(classes))
    assert fitted.recordings.on_changes is None
    assert np.isfinite(fitted.predict_proba(measured.with_classes(classes))).all()
