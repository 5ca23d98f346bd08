"""Forests refuse nodes that would lead an answer astray."""

import numpy as np
import pytest

from swashtwin.learning import build_network
from swashtwin.learning.networks.tree_network import Forest


@pytest.fixture
def nodes() -> dict[str, np.ndarray]:
    """Arrays of a tree with one branch, and of a tree that is a single leaf."""
    return {
        "root": np.array([0, 3], np.int32),
        "column": np.array([4, -1, -1, -1], np.int16),
        "threshold": np.array([0.5, 0, 0, 0], np.float32),
        "left": np.array([1, 1, 2, 3], np.int32),
        "leaf_probability": np.array([[1, 0], [0, 2], [0.5, 0.5]], np.float32),
    }


def test_the_shares_of_leaves_are_averaged_over_the_trees(nodes) -> None:
    forest = Forest(**nodes)
    values = np.zeros((2, 5))
    values[1, 4] = 1.0
    np.testing.assert_array_equal(forest.predict_proba(values), [[0.75, 0.25], [0.25, 0.75]])


@pytest.mark.parametrize(
    ("name", "changed", "message"),
    [
        ("left", [0, 1, 2, 3], "leads back"),
        ("left", [1, 0, 2, 3], "leads back"),
        ("left", [3, 1, 2, 3], "leads out"),
        pytest.param("left", [1, 1, 2], "one entry for each node", marks=pytest.mark.wrong_types),
        ("root", [], "one entry for each node"),
        ("root", [0, 4], "one entry for each node"),
        ("root", [-1], "one entry for each node"),
        ("column", [-1, -1, -1, -1], "one entry for each node"),
        pytest.param(
            "leaf_probability",
            [0.5, 0.5, 0.5],
            "one entry for each node",
            marks=pytest.mark.wrong_types,
        ),
        ("column", [4, -1, -1, 2], "one entry for each node"),
    ],
)
def test_nodes_that_contradict_each_other_are_refused(nodes, name, changed, message) -> None:
    nodes[name] = np.array(changed, nodes[name].dtype)
    with pytest.raises(ValueError, match=message):
        Forest(**nodes)


@pytest.mark.wrong_types
def test_nodes_of_another_type_are_refused(nodes) -> None:
    nodes["left"] = nodes["left"].astype(np.float32)
    with pytest.raises(ValueError, match="another type"):
        Forest(**nodes)


def test_a_network_refuses_trees_of_other_classes_or_columns(nodes) -> None:
    network = build_network("extra_trees", 1, 2)
    network.loaded(nodes)
    with pytest.raises(ValueError, match="do not fit the classes and channels"):
        build_network("extra_trees", 1, 3).loaded(nodes)
    nodes["column"][0] = 82
    with pytest.raises(ValueError, match="do not fit the classes and channels"):
        network.loaded(nodes)
