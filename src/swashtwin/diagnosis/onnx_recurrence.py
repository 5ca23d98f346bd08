"""Recurrent layers as ONNX's own operators, where the exporter would write out every step by itself."""

from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor, nn

_OPSET = 18
_GATES = {nn.LSTM: (0, 3, 1, 2), nn.GRU: (1, 0, 2)}  # ONNX's iofc and zrh, out of torch's ifgo and rzn


class OnnxRecurrence(nn.Module):
    """What an `nn.LSTM` or `nn.GRU` gives, for export only: it has weights and shapes, and cannot be run by torch."""

    def __init__(self, recurrence: nn.RNNBase) -> None:
        super().__init__()
        self.hidden = recurrence.hidden_size
        self.operator = type(recurrence).__name__
        self.order = _GATES[type(recurrence)]
        self.attributes: dict[str, Any] = {"hidden_size": self.hidden, "direction": "forward"}
        if recurrence.bidirectional:
            self.attributes["direction"] = "bidirectional"
        if self.operator == "GRU":
            self.attributes["linear_before_reset"] = 1
        ways = ("", "_reverse") if recurrence.bidirectional else ("",)
        names = [[f"l{layer}{way}" for way in ways] for layer in range(recurrence.num_layers)]
        self.weights = nn.ParameterList(
            nn.Parameter(weight, requires_grad=False) for layer in names for weight in self._weights(recurrence, layer)
        )

    def _weights(self, recurrence: nn.RNNBase, names: list[str]) -> tuple[Tensor, Tensor, Tensor]:
        """W, R and B of one layer as ONNX wants them, a row for each direction."""

        def sorted_gates(name: str) -> Tensor:
            gates = recurrence.get_parameter(name).detach().chunk(len(self.order))
            return torch.cat([gates[gate] for gate in self.order])

        entry, state = ([sorted_gates(f"weight_{kind}_{name}") for name in names] for kind in ("ih", "hh"))
        bias = [torch.cat([sorted_gates(f"bias_{kind}_{name}") for kind in ("ih", "hh")]) for name in names]
        return torch.stack(entry), torch.stack(state), torch.stack(bias)

    def forward(self, steps: Float[Tensor, "window step value"]) -> tuple[Float[Tensor, "window step feature"], None]:
        """State of the last layer after each step; the second entry, the last states, is left out."""
        x = steps.transpose(0, 1)
        for layer in range(0, len(self.weights), 3):
            weights = [self.weights[layer + part] for part in range(3)]
            shape = (x.shape[0], len(weights[0]), x.shape[1], self.hidden)
            states = torch.onnx.ops.symbolic(
                self.operator, (x, *weights), self.attributes, dtype=x.dtype, shape=shape, version=_OPSET
            )
            x = states.transpose(1, 2).flatten(2)
        return x.transpose(0, 1), None
