"""Graphs of sensors and parts, and of sensors and fault modes, are networks like any other."""

import pytest
import torch

from swashtwin.learning import build_network
from swashtwin_bench.rivals.graphs import COMPONENTS, CONTACTS, GRAPHS, ComponentGraph, FaultModeGraph

EACH_GRAPH = pytest.mark.parametrize("name", [graph.name for graph in GRAPHS])


@EACH_GRAPH
@pytest.mark.parametrize(("n_channels", "n_classes", "length"), [(1, 5, 256), (13, 2, 101)])
def test_a_graph_is_built_by_name_and_again_from_its_settings(name, n_channels, n_classes, length):
    network = build_network(name, n_channels, n_classes, width=4).eval()
    twin = build_network(name, **network.settings).eval()
    twin.load_state_dict(network.state_dict())
    windows = torch.randn(3, n_channels, length)
    assert network(windows).shape == (3, n_classes)
    torch.testing.assert_close(network.head(network.features(windows)), network(windows))
    torch.testing.assert_close(twin(windows), network(windows), rtol=0, atol=0)


@EACH_GRAPH
def test_every_weight_has_a_part_in_the_scores(name):
    network = build_network(name, 3, 4, width=8)
    network(torch.randn(16, 3, 256, generator=torch.Generator().manual_seed(0))).square().sum().backward()
    assert [key for key, weight in network.named_parameters() if weight.grad is None or not weight.grad.any()] == []


def test_parts_exchange_with_those_they_touch_and_no_others():
    network = ComponentGraph(3, 5, width=4)
    touching = {frozenset(pair) for pair in CONTACTS}
    for i, first in enumerate(COMPONENTS):
        for j, second in enumerate(COMPONENTS):
            assert bool(network.relation[i, j]) is (first == second or frozenset((first, second)) in touching)
    assert torch.linalg.eigvalsh(network.relation).max() == pytest.approx(1.0, abs=1e-6)


def test_the_score_of_a_fault_mode_is_read_from_its_own_node():
    network = FaultModeGraph(3, 4, width=4).eval()
    features = network.features(torch.randn(1, 3, 256))
    changed = features.clone()
    changed[:, 4:8] += 1.0
    difference = (network.head(changed) - network.head(features))[0].abs()
    assert difference[1] > 1e-3
    assert difference[[0, 2, 3]].max() == 0
