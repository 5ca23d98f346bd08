"""Each of the paper's ablations removes one part of BiTCN."""

import torch

from swashtwin.learning import build_network

SETTINGS = {"channels": (8, 8, 16), "kernel_size": 3}


def shapes_of(network):
    return {key: value.shape for key, value in network.state_dict().items()}


def test_each_ablation_removes_its_part_and_no_other():
    full = build_network("bitcn", 2, 3, **SETTINGS)
    shapes = shapes_of(full)

    no_attention = build_network("bitcn", 2, 3, **SETTINGS, attention=False)
    assert set(shapes_of(no_attention)) == {key for key in shapes if "attention" not in key}

    forward = build_network("bitcn", 2, 3, **SETTINGS, bidirectional=False)
    assert set(shapes_of(forward)) == {key for key in shapes if not key.startswith("inverse")}


def test_ordinary_convolutions_have_the_same_weights_and_half_the_reach():
    full = build_network("bitcn", 2, 3, **SETTINGS)
    ordinary = build_network("bitcn", 2, 3, **SETTINGS, causal=False)

    assert shapes_of(ordinary) == shapes_of(full)
    # kernel 3 with dilations 1, 2 and 4 reaches 1 + 2 * (1 + 2 + 4), without dilations 1 + 2 * 3
    assert (full.receptive_field, ordinary.receptive_field) == (15, 7)


def test_an_ordinary_unit_is_centered_and_sees_as_far_ahead_as_back():
    network = build_network(
        "bitcn", 1, 2, channels=(4, 4, 4), kernel_size=3, causal=False, attention=False
    )
    branch = network.eval().positive
    # positive weights let every ReLU pass, so that each sample in reach has a gradient
    for weight in branch.parameters():
        weight.data.abs_()

    windows = torch.rand(1, 1, 64, requires_grad=True)
    branch(windows)[0, :, 30].sum().backward()
    samples = windows.grad[0, 0].nonzero().flatten()
    assert (samples.min(), samples.max()) == (27, 33)
