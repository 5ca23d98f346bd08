"""Trees as arrays: what scikit-learn's give, saved without code, written as ONNX, and refused where they contradict."""

from pathlib import Path

import numpy as np
import onnxruntime
import pytest
from sklearn.ensemble import ExtraTreesClassifier
from tree_models import fit_trees

from swashtwin.diagnosis import export_onnx, load_classifier, save_classifier
from swashtwin.foundation import derive_seed
from swashtwin.learning import WindowSet, build_network, cut_windows, feature_values
from swashtwin.recordings import Recording

KINDS = ("extra_trees", "random_forest")


def windows(seed: int = 0, length: int = 96) -> WindowSet:
    draw = np.random.default_rng(seed)
    recordings = [
        Recording(draw.normal(3, 1 + 0.2 * (number % 3), size=(2, 8 * length)), 1e3, f"{seed} {number}",
                  label="abc"[number % 3], channels=("x", "y"))
        for number in range(9)
    ]  # fmt: skip
    return cut_windows(recordings, length=length)


def test_the_trees_answer_as_those_of_scikit_learn() -> None:
    train, test = windows(), windows(1)
    peer = ExtraTreesClassifier(20, random_state=derive_seed(3, "extra trees") % 2**32)
    peer.fit(feature_values(train.signal), train.target)
    answer = fit_trees(train, 20, seed=3).predict_proba(test)
    np.testing.assert_allclose(answer, peer.predict_proba(feature_values(test.signal)), atol=1e-7)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("length", [96, 97])
def test_a_saved_file_and_an_onnx_file_answer_as_the_trees(kind: str, length: int, tmp_path: Path) -> None:
    train, test = windows(length=length), windows(1, length)
    classifier = fit_trees(train, 20, kind=kind)
    expected = classifier.predict_proba(test)
    assert len(np.unique(expected)) > 10
    loaded = load_classifier(save_classifier(classifier, tmp_path / "trees.safetensors"))
    np.testing.assert_array_equal(loaded.predict_proba(test), expected)
    path = export_onnx(classifier, tmp_path / "trees.onnx")
    answer = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"]).run(
        ["probability"], {"windows": test.signal}
    )[0]
    np.testing.assert_allclose(answer, expected, atol=1e-6)


def test_nodes_that_lead_nowhere_or_back_or_compare_what_is_not_there_are_refused() -> None:
    weights = fit_trees(windows(), 2).network.weights
    inner = int(np.flatnonzero(weights["column"] >= 0)[0])
    for name, value in (("left", 10**6), ("left", inner), ("column", 164)):
        changed = {**weights, name: weights[name].copy()}
        changed[name][inner] = value
        with pytest.raises(ValueError, match="its trees"):
            build_network("extra_trees", 2, 3, trees=2).loaded(changed)
