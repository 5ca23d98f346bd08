"""Graph networks that know more than sensors: the parts of the pump, or its fault modes, are nodes too."""

import math
from typing import Any, ClassVar

import torch
from jaxtyping import Float
from torch import Tensor, nn

from swashtwin.learning import register_network
from swashtwin_bench.rivals.networks.sensor_graph import SensorGraph

COMPONENTS = ("housing", "swash_plate", "pistons", "cylinder_block", "valve_plate")
"""Parts of the pump, the nodes of `ComponentGraph`."""

CONTACTS = (
    ("swash_plate", "pistons"),
    ("pistons", "cylinder_block"),
    ("cylinder_block", "valve_plate"),
    ("housing", "swash_plate"),
    ("housing", "cylinder_block"),
    ("housing", "valve_plate"),
)
"""Parts that touch: the three friction pairs, and what the housing carries (the block by its bearings)."""


class _GraphBeyondSensors(SensorGraph):
    """Sensor graph whose nodes are heard by further nodes, which then mix among each other.

    Parameters
    ----------
    nodes : number of further nodes.
    """

    def __init__(self, n_channels: int, n_classes: int, nodes: int, **settings: Any) -> None:
        super().__init__(n_channels, n_classes, **settings)
        width, embedding = self.settings["width"], self.settings["embedding"]
        self.hearing = nn.Parameter(torch.randn(nodes, embedding))
        self.heard = nn.Parameter(torch.randn(n_channels, embedding))
        self.entry = nn.ModuleList(nn.Linear(width, width) for _ in range(nodes))
        self.exchange = nn.Linear(width, width)

    @property
    def relation(self) -> Float[Tensor, "node node"]:
        """How much each further node takes from each other."""
        raise NotImplementedError

    def encode(self, windows: Float[Tensor, "window channel time"]) -> Float[Tensor, "window feature"]:
        """Features of all further nodes side by side."""
        sensors = super().encode(windows).unflatten(1, (self.n_channels, -1))
        attention = torch.softmax(self.hearing @ self.heard.T / math.sqrt(self.hearing.shape[1]), dim=-1)
        messages = (attention @ sensors).unbind(1)
        nodes = torch.stack(
            [torch.relu(entry(message)) for entry, message in zip(self.entry, messages, strict=True)], dim=1
        )
        nodes = nodes + torch.relu(self.exchange(self.relation @ nodes))
        return nodes.flatten(1)


class ComponentGraph(_GraphBeyondSensors):
    """Sensors, and the parts of the pump that they hear, as one graph: which part is damaged is read from the parts.

    Sensors are mixed as in `SensorGraph`. Each part k of `COMPONENTS` then hears them, h_k = ReLU(W_k Σ_s a_ks x_s +
    b_k) with the learned weights a = softmax(E_1 E_2ᵀ / √d) over sensors, and parts that touch (`CONTACTS`) exchange
    what they heard by the graph convolution of Kipf and Welling (DOI 10.48550/arXiv.1609.02907), H ← H +
    ReLU(D^(-1/2) (A + I) D^(-1/2) H W). **Our reading** of a graph of sensors and components; the paper (DOI
    10.1177/00202940261419020) cites one, and its text is not public. Sensor graphs for fault diagnosis: Chen and
    others 2021 (DOI 10.48550/arXiv.2111.08185). Further weights, with C = `n_channels`, F = ``width``, d =
    ``embedding``, five parts:

    ============ ================
    ``hearing``  (5, d)
    ``heard``    (C, d)
    ``entry.k``  (F, F)
    ``exchange`` (F, F)
    ``head``     (classes, 5 F)
    ============ ================

    Parameters
    ----------
    n_channels : channels of a window.
    n_classes : classes told apart.
    **settings : all others of `SensorGraph`.
    """

    name: ClassVar[str] = "component_graph"
    contacts: Tensor

    def __init__(self, n_channels: int, n_classes: int, **settings: Any) -> None:
        super().__init__(n_channels, n_classes, len(COMPONENTS), **settings)
        touching = torch.eye(len(COMPONENTS))
        for first, second in CONTACTS:
            i, j = COMPONENTS.index(first), COMPONENTS.index(second)
            touching[i, j] = touching[j, i] = 1.0
        degree = touching.sum(dim=1).rsqrt()
        self.register_buffer("contacts", degree[:, None] * touching * degree, persistent=False)
        self.head = nn.Linear(len(COMPONENTS) * self.settings["width"], n_classes)

    @property
    def relation(self) -> Float[Tensor, "node node"]:
        """Normalized adjacency of the parts that touch, themselves among them."""
        return self.contacts


class _ScoreOfEachNode(nn.Module):
    """One score for each node, from its own features only: w_k · h_k + b_k, with ``weight`` (node, feature)."""

    def __init__(self, nodes: int, width: int) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.randn(nodes, width) / math.sqrt(width))
        self.bias = nn.Parameter(torch.zeros(nodes))

    def forward(self, features: Float[Tensor, "window feature"]) -> Float[Tensor, "window node"]:
        """Scores before softmax."""
        return (features.unflatten(1, self.weight.shape) * self.weight).sum(dim=-1) + self.bias


class FaultModeGraph(_GraphBeyondSensors):
    """Sensors and fault modes as one graph: each class is a node, which hears the sensors and scores itself.

    As `ComponentGraph`, but the further nodes are the classes, what they exchange is learned, R = softmax(G_1 G_2ᵀ /
    √d), and the score of a class is read from its own node, w_k · h_k + b_k. Graphs over classes: Chen and others 2019
    (DOI 10.1109/CVPR.2019.00532). **Our reading** of a graph of sensors and fault modes; the paper (DOI
    10.1177/00202940261419020) cites one, and its text is not public. Further weights, with K = `n_classes`:

    ================ ==========
    ``hearing``      (K, d)
    ``heard``        (C, d)
    ``entry.k``      (F, F)
    ``exchange``     (F, F)
    ``taking``       (K, d)
    ``giving``       (K, d)
    ``head.weight``  (K, F)
    ================ ==========

    Parameters
    ----------
    n_channels : channels of a window.
    n_classes : classes told apart.
    **settings : all others of `SensorGraph`.
    """

    name: ClassVar[str] = "fault_mode_graph"

    def __init__(self, n_channels: int, n_classes: int, **settings: Any) -> None:
        super().__init__(n_channels, n_classes, n_classes, **settings)
        width, embedding = self.settings["width"], self.settings["embedding"]
        self.taking, self.giving = (nn.Parameter(torch.randn(n_classes, embedding)) for _ in range(2))
        self.head = _ScoreOfEachNode(n_classes, width)

    @property
    def relation(self) -> Float[Tensor, "node node"]:
        """How much each class takes from each; rows sum to 1."""
        return torch.softmax(self.taking @ self.giving.T / math.sqrt(self.taking.shape[1]), dim=-1)


GRAPHS: tuple[type[SensorGraph], ...] = (ComponentGraph, FaultModeGraph)
"""Graphs of sensors and parts, and of sensors and fault modes."""

for _graph in GRAPHS:
    register_network(_graph.name, _graph)
