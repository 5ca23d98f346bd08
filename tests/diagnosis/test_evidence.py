"""Evidence adds up to the answer, finds a line that was planted, and changes with the weights."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from commandline import run_json

from swashtwin.diagnosis import Evidence, diagnose, explain, save_classifier
from swashtwin.diagnosis.attribution import line_shares, mean_gradients
from swashtwin.diagnosis.verdict import CHECKS, next_checks
from swashtwin.foundation import InputError, MPa, rpm
from swashtwin.learning import (
    BiTCN,
    FittedClassifier,
    TrainingSettings,
    cut_windows,
    fit,
)
from swashtwin.pump import CLASSES, OperatingCondition
from swashtwin.recordings import Recording, write_recording
from swashtwin.report import write_report

RATE = 1024.0
SHAFT = 16.0
LABELS = ("normal", "valve_plate")


def recording(name: str, label: str, burst: bool = False) -> Recording:
    """Noise, the shaft's line on both channels, and for valve_plate the 7th order on the second
    channel.
    """
    draw = np.random.default_rng(list(name.encode()))
    angle = 2 * np.pi * SHAFT * np.arange(2048) / RATE + draw.uniform(0, 6)
    signal = 0.5 * draw.normal(size=(2, 2048)) + np.cos(angle)
    if label == "valve_plate":
        is_present = np.arange(2048) >= (1024 if burst else 0)
        signal[1] += np.cos(7 * angle) * is_present
    condition = OperatingCondition(speed=rpm(60 * SHAFT), discharge_pressure=MPa(15))

    return Recording(
        signal,
        RATE,
        name,
        label=label,
        condition=condition,
        channels=("base_x", "cover_z"),
    )


@pytest.fixture(scope="module")
def classifier() -> FittedClassifier:
    recordings = []
    for label in LABELS:
        recordings.extend(recording(f"{label} {number}", label) for number in range(4))
    train = cut_windows(recordings, length=128)

    settings = TrainingSettings(epochs=15, batch_size=16, learning_rate=3e-3, normalization="set")
    return fit(
        BiTCN(2, 2, channels=(8, 12), kernel_size=5, dropout=0.0),
        train,
        settings=settings,
    )


def evidence_of(classifier: FittedClassifier, recording: Recording) -> Evidence:
    return explain(classifier, recording, diagnose(classifier, recording))


@pytest.fixture(scope="module")
def evidence(classifier: FittedClassifier) -> Evidence:
    return evidence_of(
        classifier, recording("new", "valve_plate").replace(attributes={"pistons": "7"})
    )


def test_contributions_add_up_to_the_margin(evidence: Evidence) -> None:
    assert evidence.completeness_error < 0.03
    assert evidence.contributions.sum() == pytest.approx(evidence.margin, rel=0.03)


def test_samples_that_contradict_their_verdict_are_reported(evidence: Evidence) -> None:
    assert evidence.margin > 0
    assert not any("even more firmly" in sentence for sentence in evidence.sentences())

    against = replace(evidence, margin=-evidence.margin)
    assert any(
        "for silence the network answers valve plate even more firmly" in sentence
        for sentence in against.sentences()
    )


def test_the_gradient_of_a_linear_network_is_its_weights_and_adds_up() -> None:
    class Line(torch.nn.Module):
        def forward(self, x: torch.Tensor) -> torch.Tensor:
            return torch.stack([(x * weights).sum(dim=(1, 2)), torch.zeros(len(x))], dim=1)

    weights = torch.arange(12, dtype=torch.float32).reshape(2, 6)
    signal = np.random.default_rng(0).normal(size=(3, 2, 6)).astype(np.float32)
    gradient, change = mean_gradients(Line(), signal, 0, 1)

    np.testing.assert_allclose(
        gradient, np.broadcast_to(weights.numpy(), gradient.shape), atol=1e-5
    )
    np.testing.assert_allclose((signal * gradient).sum(axis=(1, 2)), change, atol=1e-4)


def test_the_only_line_gets_the_whole_share() -> None:
    time = np.arange(256) / 256
    signal = np.sin(2 * np.pi * 9 * time)[None]
    gradient = 3 * np.sin(2 * np.pi * 9 * time)[None]
    share = line_shares(signal, gradient)

    assert share[0].argmax() == 9
    assert share[0, 9] == pytest.approx(share.sum()) == pytest.approx(3 * 128)


def test_the_planted_line_is_named_with_its_channel_and_its_order(
    evidence: Evidence,
) -> None:
    channel, band, share = evidence.strongest()[0]
    assert (channel, band.order) == ("cover_z", 7)
    assert share > 0.2
    assert "order 7 (112 Hz, piston-pass line) on cover_z" in evidence.sentences()[0]
    assert "valve plate against normal" in evidence.sentences()[0]


def test_random_weights_give_other_evidence(
    classifier: FittedClassifier, evidence: Evidence
) -> None:
    """Evidence that does not change with the weights would show the data only.

    The sanity check is that of Adebayo et al. 2018 (arXiv:1810.03292).
    """
    measurement = recording("new", "valve_plate")
    similar = []
    for seed in range(5):
        random_classifier = replace(classifier, network=classifier.network.fresh(seed).eval())
        lines = evidence_of(random_classifier, measurement).contributions
        similar.append(
            np.corrcoef(np.abs(lines).ravel(), np.abs(evidence.contributions).ravel())[0, 1]
        )

    similar_contributions = evidence_of(classifier, recording("other", "valve_plate")).contributions
    assert (
        np.corrcoef(
            np.abs(similar_contributions).ravel(),
            np.abs(evidence.contributions).ravel(),
        )[0, 1]
        > 0.9
    )
    assert np.median(similar) < 0.7


def test_the_nearest_known_recordings_are_of_the_class(evidence: Evidence) -> None:
    assert [neighbor.label for neighbor in evidence.nearest[:2]] == ["valve_plate"] * 2
    distances = [neighbor.distance for neighbor in evidence.nearest]
    assert distances == sorted(distances)


def test_without_a_speed_evidence_is_by_third_octaves_that_leave_no_gap(
    classifier: FittedClassifier,
) -> None:
    result = evidence_of(classifier, replace(recording("new", "valve_plate"), condition=None))
    assert all(band.order is None for band in result.bands)
    assert result.bands[0].low == 0
    assert result.bands[-1].high == RATE / 2
    assert [band.high for band in result.bands[:-1]] == [band.low for band in result.bands[1:]]
    assert result.contributions.sum() == pytest.approx(result.margin, rel=0.03)

    _, band, _ = result.strongest()[0]
    assert band.low <= 7 * SHAFT <= band.high


def test_evidence_of_a_long_recording_uses_its_most_decisive_windows(
    classifier, monkeypatch
) -> None:
    monkeypatch.setattr("swashtwin.diagnosis.evidence.MAX_WINDOWS", 4)
    result = evidence_of(classifier, recording("burst", "valve_plate", burst=True))

    assert result.start >= 1.0
    assert result.duration == pytest.approx(4 * 128 / RATE)


def test_evidence_converts_to_json_and_belongs_to_one_recording(
    classifier: FittedClassifier, evidence: Evidence
) -> None:
    assert (
        json.loads(json.dumps(evidence.to_dict(), allow_nan=False))["strongest"][0]["band"]
        == "order 7"
    )
    with pytest.raises(InputError, match="The diagnosis is of new"):
        explain(
            classifier,
            recording("other", "normal"),
            diagnose(classifier, recording("new", "normal")),
        )


def test_contributions_that_do_not_add_up_are_not_shown_as_shares(
    evidence: Evidence, tmp_path
) -> None:
    assert evidence.adds_up
    assert evidence.total == pytest.approx(1, abs=0.03)

    lines = evidence.contributions * (1.3 * evidence.margin / evidence.contributions.sum())
    off = replace(evidence, contributions=lines, completeness_error=0.3)
    answer = off.to_dict()

    assert (answer["adds_up"], answer["strongest"][0]["share"]) == (False, None)
    assert answer["total"] == pytest.approx(1.3)
    assert answer["strongest"][0]["band"] == "order 7"
    assert (
        "No shares are shown: the contributions of all lines together add to 130 % of the score."
        in off.sentences()
    )
    assert " %)" not in off.sentences()[0]
    assert replace(off, margin=0.0).to_dict()["total"] is None

    text = write_report(off, folder=tmp_path).read_text(encoding="utf-8")
    assert "add to 130 % of the score" in text
    assert "strongest first" in text
    assert not list(tmp_path.glob("figures/*"))


def test_the_page_shows_lines_neighbors_and_checks(classifier, evidence, tmp_path) -> None:
    page = write_report(
        diagnose(classifier, recording("new", "valve_plate")), evidence, folder=tmp_path
    )
    text = page.read_text(encoding="utf-8")

    for message in (
        "order 7 (112 Hz, piston-pass line)",
        evidence.nearest[0].recording_id,
        "What to check next",
        "case drain flow",
    ):
        assert message in text

    table = np.genfromtxt(
        tmp_path / "figures" / "evidence_lines.csv",
        delimiter=",",
        names=True,
        dtype=None,
    )

    assert table["adds"].sum() == pytest.approx(evidence.margin, rel=0.03)
    assert (
        json.loads((tmp_path / "results.json").read_text())["evidence"][0]["label"] == "valve_plate"
    )


def test_diagnose_writes_one_page_with_its_evidence(classifier, tmp_path: Path) -> None:
    model = save_classifier(classifier, tmp_path / "m.safetensors")
    file = write_recording(recording("new", "valve_plate"), tmp_path / "new.h5")
    answer = run_json("diagnose", model, file, "--report", tmp_path / "page.html", "--pistons", 7)

    assert answer["report"] == str(tmp_path / "page.html")
    assert answer["evidence"][0]["strongest"][0]["channel"] == "cover_z"
    assert "piston-pass line" in (tmp_path / "page.html").read_text(encoding="utf-8")
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "m.safetensors",
        "new.h5",
        "page.html",
    ]
    assert run_json("diagnose", model, file)["evidence"] == []


def test_every_class_has_checks_and_an_unknown_fault_has_general_ones() -> None:
    assert set(CLASSES) <= set(CHECKS)
    for label in CHECKS:
        assert all(check.what and check.why for check in next_checks(label))

    assert next_checks("valve_plate")[1] not in next_checks("valve_plate", unknown=True)
    assert next_checks("a class of the user's")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda x: x + 5, "Channel base_x has an offset of"),
        (
            lambda x: x[[0, 0]],
            "Channel cover_z follows another channel (correlation 1.000",
        ),
        (lambda x: 8 * x, "The gain of channel base_x looks 18 dB higher"),
    ],
)
def test_a_selected_network_without_confidence_notes_deviations_from_its_training(
    classifier: FittedClassifier,
    change: Callable[[np.ndarray], np.ndarray],
    message: str,
) -> None:
    new = recording("new", "normal")
    assert diagnose(classifier, new).notes == ()
    assert any(
        message in note
        for note in diagnose(classifier, new.replace(signal=change(new.signal))).notes
    )
