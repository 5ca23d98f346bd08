"""An ONNX file answers as its classifier and describes its inputs."""

import json
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime
import pytest
from commandline import one_line, run, run_json

from swashtwin.diagnosis import export_onnx, save_classifier
from swashtwin.foundation import MissingExtraError
from swashtwin.learning import (
    FittedClassifier,
    TrainingSettings,
    WindowSet,
    build_network,
    cut_windows,
    fit,
)
from swashtwin.learning.networks.registry import BUILT_IN
from swashtwin.recordings import Recording

SMALLER = {
    "bitcn": {"channels": (8, 12)},
}
"""Settings of the networks whose files would otherwise take many seconds to write."""
NORMALIZATION = {"band_powers": "set"}
"""Scaling of the networks whose file is not to scale each window by itself."""
OFFSET = 9.8
"""Offset that every scaling must remove [m/s^2]."""


def windows(count: int = 12) -> WindowSet:
    draw = np.random.default_rng(0)
    recordings = []
    for number in range(4):
        signal = draw.normal(OFFSET, 1 + number, size=(2, 97 * count // 4))
        label = ("normal", "piston")[number % 2]
        recordings.append(Recording(signal, 1e3, f"{number}", channels=("x", "y"), label=label))
    return cut_windows(recordings, length=97)


def fitted(name: str) -> FittedClassifier:
    network = build_network(name, 2, 2, **SMALLER.get(name, {}))
    scaling = NORMALIZATION.get(name, "window")
    return fit(network, windows(), settings=TrainingSettings(epochs=2, normalization=scaling))


@pytest.fixture(scope="module")
def exported(
    tmp_path_factory: pytest.TempPathFactory,
) -> Callable[[str], tuple[FittedClassifier, Path]]:
    """A fitted network by its name, and its file."""

    @cache
    def created(name: str) -> tuple[FittedClassifier, Path]:
        classifier = fitted(name)
        return classifier, export_onnx(classifier, tmp_path_factory.mktemp(name) / "model.onnx")

    return created


def session(path: Path) -> onnxruntime.InferenceSession:
    return onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])


def tolerance_of(name: str) -> float:
    """Return how far the probabilities of a file may differ from those of its network."""
    # prominences are ratios of sums in single precision, which the file adds in another order
    return 5e-5 if name == "line_prominences" else 1e-5


def facts_of(opened: onnxruntime.InferenceSession) -> dict[str, Any]:
    """Return the metadata of a file."""
    return {
        name: json.loads(value)
        for name, value in opened.get_modelmeta().custom_metadata_map.items()
    }


@pytest.mark.parametrize("name", sorted(BUILT_IN))
def test_the_file_of_every_network_gives_its_probabilities_for_any_number_of_windows(
    exported, name: str
) -> None:
    classifier, path = exported(name)
    opened = session(path)
    expected = classifier.predict_proba(windows())

    assert expected.std(axis=0).min() > 1e-5

    for rows in (slice(0, 1), slice(None)):
        answer = opened.run(["probability"], {"windows": windows().signal[rows]})[0]
        np.testing.assert_allclose(answer, expected[rows], atol=tolerance_of(name))

    assert [file.name for file in path.parent.iterdir()] == ["model.onnx"]


@pytest.mark.parametrize("name", ["band_powers", "line_prominences"])
@pytest.mark.parametrize("normalization", ["set", "window"])
def test_the_file_of_a_network_on_orders_takes_the_speed(
    tmp_path: Path, normalization: str, name: str
) -> None:
    speed = np.linspace(60.0, 120.0, len(windows()))
    turning = replace(windows(), speed=np.where(np.arange(len(speed)) % 4, speed, np.nan))
    shape = {"shape": True} if name == "band_powers" else {}
    turns = 90 / (2 * np.pi * 1e3)
    network = build_network(name, 2, 2, axis="order", turns=turns, hidden=8, **shape)
    classifier = fit(
        network,
        turning,
        settings=TrainingSettings(epochs=1, normalization=normalization),
    )
    opened = session(export_onnx(classifier, tmp_path / "model.onnx"))
    inputs = {"windows": turning.signal, "speed": turning.speed.astype(np.float32)}
    expected = classifier.predict_proba(turning)

    assert np.abs(expected - classifier.predict_proba(windows())).max() > 1e-3
    np.testing.assert_allclose(
        opened.run(["probability"], inputs)[0], expected, atol=tolerance_of(name)
    )


def test_a_constant_channel_is_not_divided_by_zero(exported) -> None:
    still = np.full((1, 2, 97), OFFSET, dtype=np.float32)
    assert np.isfinite(session(exported("bitcn")[1]).run(None, {"windows": still})[0]).all()


def test_the_command_writes_a_file_that_describes_its_inputs(tmp_path: Path) -> None:
    classifier = fitted("band_powers")
    saved = save_classifier(classifier, tmp_path / "model.safetensors")
    command = ("model", "export", saved, "--out", tmp_path / "model.onnx")
    (tmp_path / "model.onnx").write_text("mine")

    assert "Overwrite it with --force" in one_line(run(*command, code=3))

    answer = run_json(*command, "--force")

    assert (answer["network"], answer["classes"]) == (
        "band_powers",
        ["normal", "piston"],
    )

    opened = session(tmp_path / "model.onnx")
    assert opened.get_inputs()[0].shape[1:] == [2, 97]

    probability = opened.run(None, {"windows": windows().signal})[0]
    np.testing.assert_allclose(probability, classifier.predict_proba(windows()), atol=1e-5)

    facts = facts_of(opened)
    assert facts["classes"] == ["normal", "piston"]
    assert facts["layout"] == {
        "sample_rate": 1000.0,
        "channels": ["x", "y"],
        "unit": "m/s^2",
        "length": 97,
    }
    assert facts["manifest"] == ["0", "1", "2", "3"]
    assert "must end in .onnx" in one_line(
        run("model", "export", saved, "--out", tmp_path / "model.pt", code=3)
    )


def test_without_the_packages_nothing_is_written_and_the_extra_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "onnxscript", None)
    with pytest.raises(MissingExtraError, match=r"swashtwin\[onnx\]"):
        export_onnx(fitted("bitcn"), tmp_path / "model.onnx")
    assert list(tmp_path.iterdir()) == []
