"""The steps of an epoch: launched one by one, or on a GPU replayed as one CUDA graph."""

from collections.abc import Callable
from copy import deepcopy

import torch
from jaxtyping import Int
from torch import Tensor
from torch.nn import functional

from swashtwin.foundation import TorchStream
from swashtwin.learning.networks.network import Network, batches
from swashtwin.learning.training.settings import TrainingSettings

_WARM_UP = 3
"""Steps before a capture, in which libraries choose their kernels and take their memory."""


def is_replayed(network: Network, device: str) -> bool:
    """Whether a training there captures its step: a GPU spends longer on launching small kernels
    than on them.
    """
    return network.is_capturable and device.partition(":")[0] == "cuda"


def adam(network: Network, rate: float, replayed: bool) -> torch.optim.Adam:
    """The optimizer; where steps are replayed its learning rate is a tensor, which a graph reads
    anew each time.
    """
    if not replayed:
        return torch.optim.Adam(network.parameters(), lr=rate)
    device = next(network.parameters()).device
    return torch.optim.Adam(
        network.parameters(), lr=torch.tensor(rate, device=device), capturable=True, fused=True
    )


class Steps:
    """All steps of a training, on windows as the network represents them.

    Only the forward pass draws random numbers. The rest runs outside `random`, which costs time in
    each operation.

    Parameters
    ----------
    data : (windows, their classes); the windows of an epoch have the same shape.
    weights : of each class in the loss.
    random : what dropout draws from; a replayed step draws the next numbers of the same generator.
    """

    def __init__(
        self,
        network: Network,
        optimizer: torch.optim.Optimizer,
        settings: TrainingSettings,
        data: tuple[Tensor, Tensor],
        weights: Tensor | None,
        random: TorchStream,
        replayed: bool,
    ) -> None:
        self.network, self.optimizer, self.settings = network, optimizer, settings
        self.weights, self.random = weights, random
        self._signal, self._target = data
        self._sums = torch.zeros(2, device=data[1].device)
        self._replay: Callable[[], None] | None = None
        if replayed and settings.batch_size <= len(data[1]):
            self._signal = data[0].clone()
            self._batch = torch.arange(settings.batch_size, device=data[1].device)
            self._replay = self._captured()

    def epoch(self, signal: Tensor, order: Int[Tensor, " window"]) -> tuple[float, float]:
        """(mean loss, accuracy) of one pass over the windows in that order, while the weights move;
        a batch of another size than the usual is never replayed.
        """
        self.network.train()
        self._sums.zero_()
        if self._replay is None:
            self._signal = signal
        else:
            self._signal.copy_(signal)
        for batch in batches(order, self.settings.batch_size):
            if self._replay is None or len(batch) != len(self._batch):
                self._step(batch)
            else:
                self._batch.copy_(batch)
                self._replay()
        loss, right = self._sums.tolist()
        return loss / len(order), right / len(order)

    def _step(self, batch: Int[Tensor, " chosen"]) -> None:
        """Move the weights by the windows of these places, and add to the sums."""
        classes = self._target[batch]
        short = self.settings.precision == "bfloat16"
        kind = self._target.device.type
        with self.random, torch.autocast(kind, torch.bfloat16, enabled=short):
            scores = self.network.head(self.network.encode(self._signal[batch]))
        loss = functional.cross_entropy(
            scores.float() if short else scores, classes, weight=self.weights
        )
        self.optimizer.zero_grad()
        loss.backward()
        self.optimizer.step()
        right = (scores.argmax(dim=1) == classes).sum()
        self._sums += torch.stack([loss.detach() * len(batch), right.to(loss.dtype)])

    def _captured(self) -> Callable[[], None]:
        """What replays a step; weights and optimizer are afterwards as before."""
        weights = deepcopy(self.network.state_dict())
        moments = {
            parameter: {name: value.clone() for name, value in state.items()}
            for parameter, state in self.optimizer.state.items()
        }
        self.network.train()
        replay = capture(
            lambda: self._step(self._batch), self.random.generator(self._target.device)
        )
        self.network.load_state_dict(weights)
        for parameter, state in self.optimizer.state.items():
            for name, value in state.items():
                before = moments.get(parameter, {}).get(name)
                value.copy_(torch.zeros_like(value) if before is None else before)
        return replay


def capture(step: Callable[[], None], generator: torch.Generator) -> Callable[[], None]:
    """Replay of `step` as one CUDA graph; it reads and writes the memory that it was captured
    with.
    """
    with torch.cuda.device(generator.device):
        graph, side = torch.cuda.CUDAGraph(), torch.cuda.Stream()
        graph.register_generator_state(generator)
        side.wait_stream(torch.cuda.current_stream())
        with torch.cuda.stream(side):
            for _ in range(_WARM_UP):
                step()
        torch.cuda.current_stream().wait_stream(side)
        with torch.cuda.graph(graph, stream=side, capture_error_mode="thread_local"):
            step()
    replay: Callable[[], None] = graph.replay
    return replay
