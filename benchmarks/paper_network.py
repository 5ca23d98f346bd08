"""Time of a training step of the paper's BiTCN in 32 and in 16 bits, side by side, and the losses that both reach.

    python benchmarks/paper_network.py --json paper_network.json

Contenders take turns, one step each, so that whoever else uses the machine slows both alike: read ratios. ``before`` is
the network of plain layers, each operation with an output of its own. Times are of the processor. The losses of the
first step are without dropout, whose random numbers differ. `--epochs` trains both precisions on the same windows, with
the same weights, order and dropout, and prints their losses.
"""

import argparse
import json
import os
import platform
import time
from collections.abc import Callable
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from swashtwin.foundation import keep_freed_memory
from swashtwin.learning import TrainingSettings, build_network, cut_windows, fit
from swashtwin.learning.networks import bitcn
from swashtwin.learning.networks.branch import ResidualUnit
from swashtwin.recordings import Recording

CAN_FUSE = bitcn.can_fuse
CLASSES = ("normal", "swash_plate", "cylinder_block", "piston", "valve_plate")


def stepper(batch: int, length: int, precision: str, before: bool, dropout: float = 0.1) -> Callable[[], float]:
    """One step of Adam on one batch of noise; gives its loss."""
    draw = torch.Generator().manual_seed(0)
    windows = torch.randn(batch, 3, length, generator=draw)
    target = torch.randint(len(CLASSES), (batch,), generator=draw)
    network = build_network("bitcn", 3, len(CLASSES), dropout=dropout).fresh(0).train()
    optimizer = torch.optim.Adam(network.parameters(), lr=1e-3)
    if before:
        for unit in network.modules():
            if isinstance(unit, ResidualUnit):
                unit.forward = separate_outputs.__get__(unit)  # type: ignore[method-assign]

    def step() -> float:
        torch.manual_seed(0)
        optimizer.zero_grad()
        bitcn.can_fuse = (lambda windows: False) if before else CAN_FUSE  # type: ignore[assignment]
        with torch.autocast("cpu", torch.bfloat16, enabled=precision == "bfloat16"):
            scores = network(windows)
        loss = functional.cross_entropy(scores.float(), target)
        loss.backward()
        optimizer.step()
        return loss.item()

    return step


def separate_outputs(unit: ResidualUnit, x: Tensor) -> Tensor:
    """The residual unit with an output of its own for each operation."""
    convolved = unit.convolution(functional.pad(x, unit.padding))
    weighted = unit.attention(unit.dropout(torch.relu(unit.normalization(convolved))))
    return torch.relu(weighted + unit.skip(x))


def losses_of(epochs: int, windows: int, length: int) -> dict[str, list[float]]:
    """Loss of each epoch on the same windows in both precisions: tones that differ by class, in noise."""
    draw = np.random.default_rng(0)
    time_s = np.arange(length * windows // len(CLASSES)) / 25.6e3
    recordings = [
        Recording(
            draw.normal(size=(3, len(time_s))) + 0.3 * np.sin(2 * np.pi * (400 + 300 * number) * time_s),
            25.6e3,
            label,
            channels=("a", "b", "c"),
            label=label,
        )
        for number, label in enumerate(CLASSES)
    ]
    train = cut_windows(recordings, length=length)
    network = build_network("bitcn", 3, len(CLASSES))
    return {
        precision: [
            epoch.loss
            for epoch in fit(network, train, settings=TrainingSettings(epochs=epochs, precision=precision)).history
        ]
        for precision in ("float32", "bfloat16")
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--batch", type=int, default=30)
    parser.add_argument("--length", type=int, default=2048)
    parser.add_argument("--steps", type=int, default=10)
    parser.add_argument("--epochs", type=int, default=0, help="epochs to train in both precisions")
    parser.add_argument("--windows", type=int, default=100, help="windows of these epochs")
    parser.add_argument("--json", type=Path, help="file to write")
    options = parser.parse_args()
    torch.set_num_threads(1)
    keep_freed_memory()
    shape = options.batch, options.length
    contenders = {
        "before": stepper(*shape, "float32", before=True),
        "float32": stepper(*shape, "float32", before=False),
        "bfloat16": stepper(*shape, "bfloat16", before=False),
    }
    spent: dict[str, list[float]] = {name: [] for name in contenders}
    first = {
        name: stepper(*shape, precision, before=name == "before", dropout=0.0)()
        for name, precision in (("before", "float32"), ("float32", "float32"), ("bfloat16", "bfloat16"))
    }
    for number in range(options.steps + 1):
        for name, step in contenders.items():
            started = time.process_time()
            step()
            if number:
                spent[name].append(time.process_time() - started)
    median = {name: float(np.median(values)) for name, values in spent.items()}
    result = {
        "step_cpu_s": median,
        "times_as_fast": {name: median["before"] / value for name, value in median.items()},
        "loss_of_the_first_step": first,
        "losses_by_epoch": losses_of(options.epochs, options.windows, options.length) if options.epochs else {},
    }
    print(f"batches of {shape[0]} x 3 x {shape[1]}, one thread, torch {torch.__version__}, {platform.machine()}")
    print(json.dumps(result, indent=1))
    if options.json:
        options.json.write_text(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
