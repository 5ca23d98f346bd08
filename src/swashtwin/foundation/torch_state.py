"""Random numbers of torch for one task, without changing the process's generator."""

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode


class TorchStream(TorchDispatchMode):
    """Context in which torch draws all random numbers of this thread from a separate generator.

    Weights, dropout and noise of any module draw the numbers that they would draw right after
    ``torch.manual_seed(seed)``, whatever other threads do. The process's generator is neither read
    nor changed. A call that names a generator keeps it.

    Limits: kernels of a GPU that draw inside a fused operation (attention or a recurrent network
    with dropout) cannot take a generator.

    Parameters
    ----------
    seed : seed of the generator.

    Examples
    --------
    >>> with TorchStream(3):
    ...     first = torch.rand(2)
    >>> with TorchStream(3):
    ...     second = torch.rand(2)
    >>> bool((first == second).all())
    True
    """

    def __init__(self, seed: int) -> None:
        super().__init__()
        self._seed = seed
        self._generators: dict[str, torch.Generator] = {}

    def restart(self, seed: int) -> None:
        """Restart from another seed, with the same generators."""
        self._seed = seed
        for generator in self._generators.values():
            generator.manual_seed(seed)

    def generator(self, device: torch.device | str) -> torch.Generator:
        """Return the generator of a device."""
        name = "cpu" if str(device) == "meta" else str(device)
        if name not in self._generators:
            self._generators[name] = torch.Generator(name).manual_seed(self._seed)
        return self._generators[name]

    @classmethod
    def _should_skip_dynamo(cls) -> bool:
        """Return False, since torch otherwise imports its compiler, slower than a diagnosis."""
        return False

    def __torch_dispatch__(
        self,
        func: Any,
        types: Any,
        args: tuple[Any, ...] = (),
        kwargs: Mapping[str, Any] | None = None,
    ) -> Any:
        """Run an operation, with the generator if it draws random numbers."""
        kwargs = dict(kwargs or {})
        if (
            torch.Tag.nondeterministic_seeded not in func.tags
            or kwargs.get("generator") is not None
        ):
            return func(*args, **kwargs)

        name = func.overloadpacket.__name__
        tensors = [value for value in args if isinstance(value, Tensor)]
        generator = self.generator(
            kwargs.get("device") or (tensors[0].device if tensors else "cpu")
        )

        # Fused kernels that take no generator are replaced by their parts.
        if name == "native_dropout":
            return _dropout(*args, generator=generator)
        if name in ("randn_like", "rand_like", "randint_like"):
            empty = torch.empty_like(args[0], **kwargs)
            if name == "randn_like":
                return empty.normal_(generator=generator)
            if name == "rand_like":
                return empty.uniform_(generator=generator)
            low, high = args[1:3] if len(args) > 2 else (0, args[1])
            return empty.random_(low, high, generator=generator)

        if any(argument.name == "generator" for argument in func._schema.arguments):
            return func(*args, **{**kwargs, "generator": generator})
        if hasattr(func.overloadpacket, "generator"):
            return func.overloadpacket.generator(*args, **{**kwargs, "generator": generator})
        return func(*args, **kwargs)


def _dropout(
    x: Tensor, share: float, train: bool | None, *, generator: torch.Generator
) -> tuple[Tensor, Tensor]:
    """Return result and mask of ``aten.native_dropout``, a fused kernel without a generator."""
    if train is False or share == 0:
        return x.clone(), torch.ones_like(x, dtype=torch.bool)
    mask = torch.empty_like(x).bernoulli_(1 - share, generator=generator)
    return x * mask / (1 - share) if share < 1 else torch.zeros_like(x), mask.bool()
