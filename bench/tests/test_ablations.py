"""The paper's ablations take one part from BiTCN each."""

import torch

from swashtwin.learning import build_network


def test_each_ablation_takes_away_its_part_and_no_other():
    settings = {"channels": (8, 8, 16), "kernel_size": 3}
    without = ({}, {"causal": False}, {"attention": False}, {"bidirectional": False})
    full, ordinary, no_attention, forward = (
        build_network("bitcn", 2, 3, **settings, **part) for part in without
    )
    shapes = {key: value.shape for key, value in full.state_dict().items()}
    assert {key: value.shape for key, value in ordinary.state_dict().items()} == shapes
    assert (full.receptive_field, ordinary.receptive_field) == (15, 7)
    assert set(no_attention.state_dict()) == {key for key in shapes if "attention" not in key}
    assert set(forward.state_dict()) == {key for key in shapes if not key.startswith("inverse")}


def test_an_ordinary_unit_is_centered_and_sees_as_far_ahead_as_back():
    branch = build_network(
        "bitcn", 1, 2, channels=(4, 4, 4), kernel_size=3, causal=False, attention=False
    )
    branch = branch.eval().positive
    for weight in branch.parameters():  # no ReLU sleeps
        weight.data.abs_()
    windows = torch.rand(1, 1, 64, requires_grad=True)
    branch(windows)[0, :, 30].sum().backward()
    seen = windows.grad[0, 0].nonzero().flatten()
    assert (seen.min(), seen.max()) == (27, 33)
