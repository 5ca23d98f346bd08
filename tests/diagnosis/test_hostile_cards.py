"""Models with a false card and a valid checksum are refused in one line and with little memory."""

import resource
from pathlib import Path

import numpy as np
import pytest
from hostile_cards import CONTRADICTIONS, VERSION, hostile_cards, with_confidence

from swashtwin.diagnosis import load_classifier, save_classifier
from swashtwin.foundation import ArtifactError, read_artifact, write_artifact
from swashtwin.learning import BiTCN, TrainingSettings, cut_windows, fit
from swashtwin.recordings import Recording


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    draw = np.random.default_rng(0)
    recordings = [
        Recording(draw.normal(size=(1, 80)), 1e3, label, label=label)
        for label in ("normal", "piston")
    ]
    windows = cut_windows(recordings, length=80)
    classifier = fit(
        BiTCN(1, 2, channels=(8,), kernel_size=3),
        windows,
        settings=TrainingSettings(epochs=1),
    )

    return save_classifier(with_confidence(classifier), tmp_path / "saved.safetensors")


def test_every_hostile_card_is_refused_in_one_short_line_without_memory(saved, tmp_path):
    card, tensors = read_artifact(saved, "classifier", VERSION, advice="", may_be_nan=None)
    load_classifier(
        write_artifact(
            tmp_path / "model.safetensors",
            "classifier",
            VERSION,
            card,
            tensors,
            may_be_nan=None,
        )
    )
    wrong = []
    count = 0
    initial_memory_kB = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss

    for number, (name, changed) in enumerate(hostile_cards(card)):
        if number % 6 and name not in CONTRADICTIONS:
            continue
        path = write_artifact(
            tmp_path / "hostile.safetensors",
            "classifier",
            VERSION,
            changed,
            tensors,
            may_be_nan=None,
        )

        try:
            load_classifier(path)
            wrong.append(f"{name}: loaded")
        except ArtifactError as error:
            if "\n" in str(error) or len(str(error)) > 600:
                wrong.append(f"{name}: {str(error)[:700]}")
        except Exception as error:
            wrong.append(f"{name}: {type(error).__name__}: {error}")

        count += 1

    peak_memory_kB = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    assert peak_memory_kB - initial_memory_kB < 200_000
    assert not wrong, "\n".join(wrong)
    assert count >= 60


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("confidence.target", lambda values: values + 2),
        ("confidence.target", lambda values: -1 - values),
        ("confidence.target", lambda values: values.astype(float)),
        ("confidence.target", lambda values: values[:-1]),
        ("confidence.nonconformity_score", lambda values: values[:1]),
        ("confidence.nonconformity_score", lambda values: values[:, :-1]),
        ("confidence.nonconformity_score", lambda values: values.astype(int)),
        ("confidence.ood_score", lambda values: values[::-1]),
        ("confidence.ood_score", lambda values: values[:5]),
        ("confidence.ood_score", lambda values: values[0]),
        ("training_reference.features", lambda values: values[:1]),
        ("training_reference.features", lambda values: values.astype(float)),
        ("training_reference.statistics", lambda values: values[..., :5]),
        ("training_reference.statistics", lambda values: values[0]),
        ("training_reference.condition", lambda values: values[:, :1]),
        (
            "training_reference.condition",
            lambda values: np.zeros(values.shape, dtype=int),
        ),
    ],
)
def test_tensors_that_fit_neither_the_card_nor_the_classes_are_refused(
    saved, tmp_path, name, change
):
    card, tensors = read_artifact(saved, "classifier", VERSION, advice="", may_be_nan=None)
    tensors[name] = change(tensors[name])
    path = write_artifact(
        tmp_path / "hostile.safetensors",
        "classifier",
        VERSION,
        card,
        tensors,
        may_be_nan=None,
    )

    with pytest.raises(ArtifactError, match=r"confidence|training.reference|expected"):
        load_classifier(path)
