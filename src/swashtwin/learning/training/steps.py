"""The steps of an epoch: launched one by one, or replayed on a GPU as a CUDA graph."""

from collections.abc import Callable
from copy import deepcopy

import torch
from jaxtyping import Int
from torch import Tensor
from torch.nn import functional

from swashtwin.foundation import TorchStream
from swashtwin.learning.networks.network import Network, batches
from swashtwin.learning.training.training_settings import TrainingSettings

# Steps before a capture, in which libraries select their kernels and allocate memory.
_WARM_UP = 3


def is_replayed(network: Network, device: str) -> bool:
    """Return whether a training on this device captures its step.

    A GPU spends more time on launching small kernels than on running them.
    """
    return network.is_capturable and device.partition(":")[0] == "cuda"


def adam(network: Network, rate: float, replayed: bool) -> torch.optim.Adam:
    """Return the optimizer.

    If steps are replayed, its learning rate is a tensor, which a graph reads anew each time.
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
    data : windows and their classes; the windows of an epoch have the same shape.
    weights : weight of each class in the loss.
    random : generator of dropout; a replayed step draws its next numbers.
    replayed : whether steps are replayed.
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
        self.network = network
        self.optimizer = optimizer
        self.settings = settings
        self.weights = weights
        self.random = random
        self._signal, self._target = data
        self._sums = torch.zeros(2, device=self._target.device)
        self._replay: Callable[[], None] | None = None
        if replayed and settings.batch_size <= len(self._target):
            # A graph reads fixed memory: signal and batch are copied into it.
            self._signal = self._signal.clone()
            self._batch = torch.arange(settings.batch_size, device=self._target.device)
            self._replay = self._capture_step()

    def epoch(self, signal: Tensor, order: Int[Tensor, " window"]) -> tuple[float, float]:
        """Return mean loss and accuracy of one pass over the windows, while the weights move.

        A last batch of another size is never replayed.

        Parameters
        ----------
        signal : windows of the epoch.
        order : order of the pass.
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
        loss, n_right = self._sums.tolist()
        return loss / len(order), n_right / len(order)

    def _step(self, batch: Int[Tensor, " selected"]) -> None:
        """Move the weights by the windows of a batch, and add to the sums."""
        classes = self._target[batch]
        is_short = self.settings.precision == "bfloat16"
        device_type = self._target.device.type
        with self.random, torch.autocast(device_type, torch.bfloat16, enabled=is_short):
            scores = self.network.head(self.network.encode(self._signal[batch]))
        full_scores = scores.float() if is_short else scores
        loss = functional.cross_entropy(full_scores, classes, weight=self.weights)

        self.optimizer.zero_grad()
        loss.backward()
        self.optimizer.step()
        n_right = (scores.argmax(dim=1) == classes).sum()
        self._sums += torch.stack([loss.detach() * len(batch), n_right.to(loss.dtype)])

    def _capture_step(self) -> Callable[[], None]:
        """Capture a step, and restore the weights and the optimizer afterwards."""
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
            original_state = moments.get(parameter, {})
            for name, value in state.items():
                original = original_state.get(name)
                # The capture created moments that did not exist: they start from zero.
                value.copy_(torch.zeros_like(value) if original is None else original)
        return replay


def capture(step: Callable[[], None], generator: torch.Generator) -> Callable[[], None]:
    """Return a replay of `step` as one CUDA graph.

    It reads and writes the memory with which it was captured.
    """
    with torch.cuda.device(generator.device):
        graph = torch.cuda.CUDAGraph()
        side = torch.cuda.Stream()
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
