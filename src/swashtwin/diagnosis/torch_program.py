"""The ONNX model of a classifier whose network is of torch."""

import logging
import math
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor, nn

from swashtwin.learning import FittedClassifier, Network, Normalization


def torch_model(classifier: FittedClassifier, network: Network) -> Any:
    """The ONNX model, without metadata; see `export_onnx` for its inputs and output."""
    layout = classifier.layout
    whole = _Whole(classifier.normalization, network, layout.sample_rate).eval()
    names, examples = ["windows"], [torch.zeros(2, len(layout.channels), layout.length)]
    if network.uses_speed:
        names, examples = [*names, "speed"], [*examples, torch.full((2,), torch.nan)]
    with _quiet():
        program = torch.onnx.export(
            whole,
            tuple(examples),
            dynamo=True,
            dynamic_shapes=({0: torch.export.Dim("window")},) * len(names),
            input_names=names,
            output_names=["probability"],
            verbose=False,
        )
    assert program is not None
    return program.model_proto


class _Whole(nn.Module):
    """Scaling, network and softmax in one, computed as `FittedClassifier` computes them."""

    mean: Tensor
    deviation: Tensor

    def __init__(self, normalization: Normalization, network: Network, sample_rate: float) -> None:
        super().__init__()
        self.kind = normalization.kind
        self.turns_of_speed = 1 / (2 * math.pi * sample_rate)
        self.network = network
        self.register_buffer("mean", torch.from_numpy(normalization.mean)[:, None])
        self.register_buffer("deviation", torch.from_numpy(normalization.deviation)[:, None])

    def forward(
        self, windows: Float[Tensor, "window channel time"], speed: Float[Tensor, " window"] | None = None
    ) -> Float[Tensor, "window class"]:
        samples, mean, deviation = windows.double(), self.mean, self.deviation
        if self.kind == "window":
            mean = samples.mean(dim=-1, keepdim=True)
            deviation = (samples - mean).square().mean(dim=-1, keepdim=True).sqrt()
            deviation = torch.where(deviation > 0, deviation, 1.0)
        if self.kind in ("window", "set"):
            windows = ((samples - mean) / deviation).float()
        if speed is None:
            return torch.softmax(self.network(windows), dim=-1)
        represented = self.network.represent_at(windows, speed * self.turns_of_speed)
        return torch.softmax(self.network.head(self.network.encode(represented)), dim=-1)


@contextmanager
def _quiet() -> Iterator[None]:
    """Within it, torch does not tell of packages that nobody needs, nor of its own old ways."""
    logger = logging.getLogger("torch.onnx")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings():
            for kind in (FutureWarning, DeprecationWarning):
                warnings.simplefilter("ignore", kind)
            warnings.filterwarnings("ignore", ".*axis name: window will not be used")  # two inputs share it
            yield
    finally:
        logger.setLevel(level)
