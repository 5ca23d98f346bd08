"""Recordings that deviate from the training have a high score and reasons in plain words."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from swashtwin.diagnosis.reasons import describe_deviations
from swashtwin.foundation import MPa, rpm
from swashtwin.learning import (
    TrainingReference,
    WindowSet,
    cut_windows,
    deviating_statistics,
    signal_statistics,
)
from swashtwin.learning.features import reference_features
from swashtwin.learning.training.class_space import fit_class_space
from swashtwin.learning.training.training_reference import (
    ERROR_RATE,
    build_reference,
    scaled_reference,
)
from swashtwin.pump import OperatingCondition
from swashtwin.recordings import Recording

CHANNELS = ("case_x", "case_y")
MACHINES = ("A", "B", "C", "D")


def reference_of(
    features: np.ndarray, label: np.ndarray, specimen: np.ndarray
) -> TrainingReference:
    return scaled_reference(
        TrainingReference(
            recording_id=tuple(map(str, range(len(features)))),
            label=tuple(label.tolist()),
            specimen=tuple(specimen.tolist()),
            condition=np.full((len(features), 2), np.nan),
            features=features.astype(np.float32),
            statistics=np.zeros((len(features), 1, 19)),
        )
    )


@pytest.fixture(scope="module")
def fleet() -> SimpleNamespace:
    """Features of recordings of four classes on seven machines, 12 of each pair.

    The reference knows three of the classes on four of the machines, 8 recordings of each pair.
    """
    random = np.random.default_rng(1)
    label_grid, machine_grid = np.meshgrid(list("abcd"), list("ABCDEFG"), indexing="ij")
    label = np.repeat(label_grid.ravel(), 12)
    machine = np.repeat(machine_grid.ravel(), 12)

    centers = random.normal(0, 1.0, (4, 40))
    shifts = random.normal(0, 0.4, (7, 40))
    class_centers = centers[np.searchsorted(list("abcd"), label)]
    machine_shifts = shifts[np.searchsorted(list("ABCDEFG"), machine)]
    rows = class_centers + machine_shifts
    rows += random.normal(0, 0.3, rows.shape)

    has_new_class = label == "d"
    has_trained_machine = np.isin(machine, MACHINES)
    is_trained = ~has_new_class & has_trained_machine & (np.arange(len(rows)) % 12 < 8)
    reference = reference_of(rows[is_trained], label[is_trained], machine[is_trained])
    scores = [
        reference.ood_score(row, specimen=str(name))
        for row, name in zip(rows, machine, strict=True)
    ]

    return SimpleNamespace(
        rows=rows,
        has_new_class=has_new_class,
        has_trained_machine=has_trained_machine,
        is_trained=is_trained,
        is_anomalous=np.array(scores) > 1,
        reference=reference,
    )


def test_on_trained_machines_a_new_class_is_anomalous_and_one_in_ten_of_the_trained_is(
    fleet,
):
    is_new_recording = fleet.has_trained_machine & ~fleet.is_trained

    assert np.mean(fleet.is_anomalous[is_new_recording & fleet.has_new_class]) > 0.95
    assert 0.02 < np.mean(fleet.is_anomalous[is_new_recording & ~fleet.has_new_class]) < 0.2


def test_an_untrained_machine_is_judged_by_the_distances_of_held_out_machines(fleet):
    same_machine_scale, new_machine_scale = fleet.reference.distance_scales
    is_new_machine = ~fleet.has_trained_machine

    assert new_machine_scale > same_machine_scale
    assert np.mean(fleet.is_anomalous[is_new_machine & ~fleet.has_new_class]) < 0.3
    assert np.mean(fleet.is_anomalous[is_new_machine & fleet.has_new_class]) > 0.8

    # only the scale differs, not the distance
    features = fleet.rows[0]
    distance = fleet.reference.ood_score(features, specimen="A") * same_machine_scale
    assert fleet.reference.ood_score(features) * new_machine_scale == pytest.approx(distance)


def test_scores_across_folds_are_those_of_new_recordings(fleet):
    scores = fleet.reference.cross_fitted_scores()
    assert np.mean(scores > 1) == pytest.approx(0.1, abs=0.02)

    # recordings that the reference was fitted to are nearer than new ones
    fitted = [fleet.reference.ood_score(row, specimen="A") for row in fleet.reference.features]
    assert np.median(fitted) < 0.9 * np.median(scores)


def test_a_few_recordings_or_a_single_class_have_a_score_too(fleet):
    rows = fleet.rows[:3]
    single_class = reference_of(rows, np.array(["a"] * 3), np.array([""] * 3))
    assert single_class.ood_score(rows[0] + 5) > single_class.ood_score(rows[0])

    two_recordings = reference_of(fleet.rows[[0, 90]], np.array(["a", "b"]), np.array(["A", "B"]))
    assert two_recordings.distance_scales == (1.0, 1.0)
    assert np.isnan(two_recordings.cross_fitted_scores()).all()
    assert two_recordings.ood_score(rows[0] + 5) > two_recordings.ood_score(rows[0])


def test_a_shift_that_an_operating_point_adds_to_every_class_does_not_raise_the_score():
    random = np.random.default_rng(2)
    label = np.repeat(["a", "b"], 20)
    pressure = np.tile([MPa(5), MPa(15)], 20)
    noise = random.normal(0, 0.1, (40, 6))
    class_shift = (label == "b")[:, None]
    pressure_shift = 3.0 * (pressure > MPa(10))[:, None] * np.eye(6)[0]
    rows = noise + class_shift + pressure_shift
    condition = np.stack([np.full(40, rpm(860)), pressure], axis=1)
    space = fit_class_space(rows, label.tolist(), [""] * 40, condition)
    at_high = np.array([3.0, 0, 0, 0, 0, 0])

    assert space.score(at_high, condition[1]) < 2 < space.score(at_high, condition[0])

    # an untrained operating point takes the shift of the nearest trained one
    near_high = np.array([rpm(860), MPa(14)])
    assert space.score(at_high, near_high) == space.score(at_high, condition[1])


def recording(
    name: str,
    *,
    gain=(1.0, 1.0),
    noise: float = 0.1,
    speed: float = 860,
    swapped: bool = False,
) -> Recording:
    random = np.random.default_rng(list(name.encode()))
    time = np.arange(1024) / 1000.0
    level = 10 ** (random.normal(0, 0.5) / 20)
    lines = np.stack([np.sin(2 * np.pi * 40 * time), 3 * np.sin(2 * np.pi * 170 * time)])
    signal = np.array(gain)[:, None] * (level * lines + noise * random.normal(size=lines.shape))
    condition = OperatingCondition(speed=rpm(speed), discharge_pressure=MPa(15))
    if swapped:
        signal = signal[::-1]

    return Recording(
        signal,
        1000.0,
        name,
        channels=CHANNELS,
        label="normal",
        specimen=name[0],
        condition=condition,
    )


def recordings_of_machines(numbers: range) -> list[Recording]:
    recordings = []
    for machine in MACHINES:
        recordings.extend(recording(f"{machine}{number}") for number in numbers)

    return recordings


def windows(*recordings: Recording) -> WindowSet:
    return cut_windows(
        list(recordings),
        length=256,
        classes=("normal", "piston"),
        allow_partial_revolution=True,
    )


@pytest.fixture(scope="module")
def classifier() -> SimpleNamespace:
    """The attributes of a classifier that the reasons read."""
    train = windows(*recordings_of_machines(range(6)))

    return SimpleNamespace(
        training_reference=build_reference(train, reference_features(train)),
        layout=train.layout,
        pressures=(MPa(15),),
        speeds=(rpm(860),),
        classes=train.classes,
        manifest={},
        confidence=None,
        predict_proba=print,
        answer=print,
    )


def reasons(classifier: SimpleNamespace, **changes) -> tuple[str, ...]:
    new = windows(recording("E9", **changes))
    return describe_deviations(classifier, new.condition(0), signal_statistics(new).mean(axis=0))


@pytest.mark.wrong_types
@pytest.mark.parametrize(
    ("changes", "starts"),
    [
        ({}, []),
        (
            {"gain": (1.0, 4.0)},
            ["The gain of channel case_y looks 12 dB higher than in the training: its level and"],
        ),
        (
            {"gain": (0.25, 1.0)},
            ["The gain of channel case_x looks 1[23] dB lower than in the training"],
        ),
        ({"gain": (1e-4, 1.0)}, ["Channel case_x is nearly silent: its level is"]),
        (
            {"swapped": True},
            [
                "Channels case_x and case_y look swapped: "
                "the spectrum of each resembles that of the other"
            ],
        ),
        ({"speed": 1500}, ["Speed 1500 rev/min was not trained .trained: 860 rev/min"]),
    ],
)
def test_each_cause_has_its_sentence_and_there_is_no_other(classifier, changes, starts):
    sentences = reasons(classifier, **changes)

    assert len(sentences) == len(starts), sentences
    for sentence, start in zip(sentences, starts, strict=True):
        assert re.match(start, sentence)


@pytest.mark.wrong_types
def test_a_gain_of_the_factor_between_g_and_its_si_unit_doubts_the_unit(classifier):
    (reason,) = reasons(classifier, gain=(1.0, 9.81))
    assert "check the unit" in reason

    (reason,) = reasons(classifier, gain=(1.0, 8.0))
    assert "check the unit" not in reason


@pytest.mark.wrong_types
def test_more_noise_is_reported_in_decibels_above_the_training_for_each_channel(
    classifier,
):
    sentences = reasons(classifier, noise=1.0)
    floors = [
        sentence
        for sentence in sentences
        if sentence.startswith("The noise floor of channel case_")
    ]

    assert len(floors) == 2
    for sentence in floors:
        assert " dB above the training's range (" in sentence
        assert "dB re 1 (m/s^2)²/Hz; training: " in sentence

    assert any("strongest lines of channel case_x hold" in sentence for sentence in sentences)


def test_recordings_like_the_training_have_deviating_facts_at_the_error_rate(
    classifier,
):
    reference = classifier.training_reference
    has_deviation = []

    for new_recording in recordings_of_machines(range(20, 60)):
        statistics = signal_statistics(windows(new_recording)).mean(axis=0)
        deviations = deviating_statistics(reference.statistics, reference.specimen, statistics)
        has_deviation.append(bool(deviations))

    # a factor of two, for 160 recordings measure the rate only roughly
    assert np.mean(has_deviation) < 2 * ERROR_RATE

    # four recordings are too few to find 9 dB unusual
    few = reference.statistics[:4]
    machines = reference.specimen[:4]
    assert deviating_statistics(few, machines, few[0] + 99)
    assert not deviating_statistics(few, machines, few[0] + 9)


def test_recordings_with_a_sample_that_is_not_finite_are_excluded_from_the_reference():
    train = windows(recording("A0"), recording("B0"))
    levels = reference_features(train)
    levels[:4] = np.nan

    assert build_reference(train, levels).specimen == ("B",)
    assert build_reference(train, levels * np.nan) is None

    measured_only = build_reference(replace(train, synthetic=np.arange(8) < 4), levels)
    assert measured_only.recording_id == ("B0",)
