"""Random numbers and threads of torch that belong to one piece of work."""

from concurrent.futures import ThreadPoolExecutor
from threading import Barrier

import torch
from torch import nn

from swashtwin.foundation import TorchStream, one_thread


def test_the_numbers_are_those_after_manual_seed_and_the_process_has_its_state():
    draws = (
        lambda: torch.rand(3),
        lambda: torch.randn(3),
        lambda: torch.randn_like(torch.ones(3)),
        lambda: torch.rand_like(torch.ones(3)),
        lambda: torch.randperm(5),
        lambda: torch.randint(9, (4,)),
        lambda: torch.randint_like(torch.ones(3), 9),
        lambda: nn.Dropout(0.5)(torch.ones(9)),
        lambda: nn.LSTM(2, 3, 2, dropout=0.5)(torch.ones(4, 5, 2))[0].detach(),
        lambda: torch.bernoulli(torch.full((9,), 0.5)),
        lambda: nn.init.orthogonal_(torch.empty(3, 3)),
    )

    for draw in draws:
        torch.manual_seed(4)
        expected = draw()
        original = torch.get_rng_state()
        with TorchStream(4):
            assert torch.equal(draw(), expected)

        assert torch.equal(torch.get_rng_state(), original)


def test_a_generator_that_is_named_is_used():
    with TorchStream(0):
        sample = torch.rand(2, generator=torch.Generator().manual_seed(7))
    assert torch.equal(sample, torch.rand(2, generator=torch.Generator().manual_seed(7)))


def test_the_dropout_of_a_gpu_keeps_the_mean_and_its_gradient_follows_the_mask():
    x = torch.ones(4000, requires_grad=True)
    with TorchStream(0):
        result, mask = torch.ops.aten.native_dropout(x, 0.25, True)
        result.sum().backward()

    assert torch.equal(result.detach(), mask / 0.75)
    assert torch.equal(x.grad, mask / 0.75)
    assert abs(float(mask.float().mean()) - 0.75) < 0.03


def test_one_thread_concerns_the_calling_thread_only():
    torch.set_num_threads(2)
    try:
        with one_thread(), ThreadPoolExecutor(1) as second:
            assert torch.get_num_threads() == 1
            assert second.submit(torch.get_num_threads).result() == 2

        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(1)


def test_threads_that_draw_at_once_get_the_numbers_of_one_thread():
    barrier = Barrier(8)

    def sample(seed: int) -> torch.Tensor:
        barrier.wait(timeout=10)
        with TorchStream(seed):
            return torch.cat([torch.rand(10) for _ in range(20)])

    with ThreadPoolExecutor(8) as threads:
        together = list(threads.map(sample, range(8)))
    for seed, numbers in enumerate(together):
        torch.manual_seed(seed)
        assert torch.equal(numbers, torch.cat([torch.rand(10) for _ in range(20)]))
