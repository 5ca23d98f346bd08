"""What is unlike the training has a high score, and plain words say which fact of which channel is
off.
"""

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
    """Features of recordings of four classes on seven machines, 12 of each; the reference knows
    three and four.
    """
    random = np.random.default_rng(1)
    label, machine = (
        part.ravel() for part in np.meshgrid(list("abcd"), list("ABCDEFG"), indexing="ij")
    )
    label, machine = np.repeat(label, 12), np.repeat(machine, 12)
    centers = random.normal(0, 1.0, (4, 40))
    shifts = random.normal(0, 0.4, (7, 40))
    rows = (
        centers[np.searchsorted(list("abcd"), label)]
        + shifts[np.searchsorted(list("ABCDEFG"), machine)]
    )
    rows += random.normal(0, 0.3, rows.shape)
    taught = (label != "d") & np.isin(machine, MACHINES) & (np.arange(len(rows)) % 12 < 8)
    reference = reference_of(rows[taught], label[taught], machine[taught])
    score = np.array(
        [
            reference.ood_score(row, specimen=str(name))
            for row, name in zip(rows, machine, strict=True)
        ]
    )

    return SimpleNamespace(rows=rows, new=label == "d", here=np.isin(machine, MACHINES), taught=taught, score=score,
                           reference=reference)  # fmt: skip


def test_a_class_never_trained_scores_above_one_and_one_in_ten_of_the_trained_on_machines_of_the_training(
    fleet,
):
    here = fleet.here & ~fleet.taught
    assert np.mean(fleet.score[here & fleet.new] > 1) > 0.95
    assert 0.02 < np.mean(fleet.score[here & ~fleet.new] > 1) < 0.2


def test_a_machine_that_was_never_trained_is_judged_by_machines_left_out(fleet):
    assert fleet.reference.distance_scales[1] > fleet.reference.distance_scales[0]
    assert np.mean(fleet.score[~fleet.here & ~fleet.new] > 1) < 0.3
    assert np.mean(fleet.score[~fleet.here & fleet.new] > 1) > 0.8

    alike = (
        fleet.reference.ood_score(fleet.rows[0], specimen="A") * fleet.reference.distance_scales[0]
    )

    assert fleet.reference.ood_score(fleet.rows[0]) * fleet.reference.distance_scales[
        1
    ] == pytest.approx(alike)


def test_scores_across_folds_are_those_of_recordings_to_come(fleet):
    scores = fleet.reference.cross_fitted_scores()
    assert np.mean(scores > 1) == pytest.approx(0.1, abs=0.02)

    fitted = [fleet.reference.ood_score(row, specimen="A") for row in fleet.reference.features]
    assert np.median(fitted) < 0.9 * np.median(scores), (
        "recordings that had a part are nearer than new ones"
    )


def test_a_few_recordings_or_a_single_class_have_a_score_too(fleet):
    rows = fleet.rows[:3]
    alone = reference_of(rows, np.array(["a"] * 3), np.array([""] * 3))

    assert alone.ood_score(rows[0] + 5) > alone.ood_score(rows[0])

    each = reference_of(fleet.rows[[0, 90]], np.array(["a", "b"]), np.array(["A", "B"]))
    assert each.distance_scales == (1.0, 1.0)
    assert np.isnan(each.cross_fitted_scores()).all()
    assert each.ood_score(rows[0] + 5) > each.ood_score(rows[0])


def test_what_an_operating_point_changes_in_every_class_counts_for_nothing():
    random = np.random.default_rng(2)
    label = np.repeat(["a", "b"], 20)
    pressure = np.tile([MPa(5), MPa(15)], 20)
    rows = (
        random.normal(0, 0.1, (40, 6))
        + (label == "b")[:, None]
        + 3.0 * (pressure > MPa(10))[:, None] * np.eye(6)[0]
    )
    condition = np.stack([np.full(40, rpm(860)), pressure], axis=1)
    space = fit_class_space(rows, label.tolist(), [""] * 40, condition)
    at_high = np.array([3.0, 0, 0, 0, 0, 0])

    assert space.score(at_high, condition[1]) < 2 < space.score(at_high, condition[0])

    near = np.array([rpm(860), MPa(14)])
    assert space.score(at_high, near) == space.score(at_high, condition[1]), (
        "the nearest point's offset is taken"
    )


def recording(
    name: str, *, gain=(1.0, 1.0), noise: float = 0.1, speed: float = 860, swapped: bool = False
) -> Recording:
    random = np.random.default_rng(list(name.encode()))
    time = np.arange(1024) / 1000.0
    level = 10 ** (random.normal(0, 0.5) / 20)
    lines = np.stack([np.sin(2 * np.pi * 40 * time), 3 * np.sin(2 * np.pi * 170 * time)])
    signal = np.array(gain)[:, None] * (level * lines + noise * random.normal(size=lines.shape))
    condition = OperatingCondition(speed=rpm(speed), discharge_pressure=MPa(15))
    signal = signal[::-1] if swapped else signal

    return Recording(
        signal,
        1000.0,
        name,
        channels=CHANNELS,
        label="normal",
        specimen=name[0],
        condition=condition,
    )


def windows(*recordings: Recording) -> WindowSet:
    return cut_windows(
        list(recordings), length=256, classes=("normal", "piston"), allow_partial_revolution=True
    )


@pytest.fixture(scope="module")
def classifier() -> SimpleNamespace:
    """As much of a classifier as reasons rest on."""
    train = windows(
        *(recording(f"{machine}{number}") for machine in MACHINES for number in range(6))
    )

    return SimpleNamespace(
        training_reference=build_reference(train, reference_features(train)), layout=train.layout,
        pressures=(MPa(15),), speeds=(rpm(860),), classes=train.classes, manifest={}, confidence=None,
        predict_proba=print, answer=print,
    )  # fmt: skip


def reasons(classifier: SimpleNamespace, **changes) -> tuple[str, ...]:
    new = windows(recording("E9", **changes))
    return describe_deviations(classifier, new.condition(0), signal_statistics(new).mean(axis=0))


@pytest.mark.wrong_types
@pytest.mark.parametrize(
    ("changes", "words"),
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
                "Channels case_x and case_y look swapped: the spectrum of each resembles that of the other"
            ],
        ),
        ({"speed": 1500}, ["Speed 1500 rev/min was not trained .trained: 860 rev/min"]),
    ],
)
def test_each_cause_has_its_sentence_and_nothing_else_is_said(classifier, changes, words):
    sentences = reasons(classifier, **changes)
    assert len(sentences) == len(words), sentences
    for sentence, start in zip(sentences, words, strict=True):
        assert re.match(start, sentence)


@pytest.mark.wrong_types
def test_a_gain_of_the_factor_between_g_and_its_si_unit_doubts_the_unit(classifier):
    assert ["check the unit" in reason for reason in reasons(classifier, gain=(1.0, 9.81))] == [
        True
    ]
    assert ["check the unit" in reason for reason in reasons(classifier, gain=(1.0, 8.0))] == [
        False
    ]


@pytest.mark.wrong_types
def test_more_noise_is_said_in_decibels_above_the_training_for_each_channel(classifier):
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


def test_recordings_like_the_training_get_a_remark_as_rarely_as_stated(classifier):
    reference = classifier.training_reference
    new = [
        windows(recording(f"{machine}{number}")) for machine in MACHINES for number in range(20, 60)
    ]
    said = [
        bool(
            deviating_statistics(
                reference.statistics, reference.specimen, signal_statistics(w).mean(axis=0)
            )
        )
        for w in new
    ]

    assert np.mean(said) < 2 * ERROR_RATE
    assert deviating_statistics(
        reference.statistics[:4], reference.specimen[:4], reference.statistics[0] + 99
    )
    assert not deviating_statistics(
        reference.statistics[:4], reference.specimen[:4], reference.statistics[0] + 9
    ), "too few to tell 9 dB"


def test_recordings_with_a_sample_that_is_no_number_are_left_out_of_the_reference():
    train = windows(recording("A0"), recording("B0"))
    levels = reference_features(train)
    levels[:4] = np.nan

    assert build_reference(train, levels).specimen == ("B",)
    assert build_reference(train, levels * np.nan) is None

    again = build_reference(replace(train, synthetic=np.arange(8) < 4), levels)
    assert again.recording_id == ("B0",)
