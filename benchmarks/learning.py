"""Time that each network takes to train and to answer, on one thread, by torch and by ONNX Runtime.

    python benchmarks/learning.py --json

The networks take turns, one step or call each, so that whoever else uses the machine slows all of them alike. An epoch
is scaled up from `--steps` steps of Adam; `ratio` is its share of what the paper's BiTCN (`stride` 1) needs. Times are
of the processor, not of the clock. The windows are noise: no time here depends on what is in them.
"""

import argparse
import json
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

import numpy as np
import torch
from torch.nn import functional

from swashtwin.diagnosis import export_onnx
from swashtwin.learning import NETWORKS, Network, TrainingSettings, build_network, cut_windows, fit
from swashtwin.recordings import Recording

PAPER = "bitcn, the paper's (stride 1)"
CLASSES = ("normal", "swash_plate", "cylinder_block", "piston", "valve_plate")
CHANNELS, LENGTH, BATCH = 3, 2048, 30
EPOCH = 3000
"""Windows of an epoch."""
TOGETHER = 64
"""Windows of a batch where many are diagnosed at once."""


def networks(only: list[str] | None) -> dict[str, Network]:
    """Network of each row: those of a name in `only`, beside the paper's."""
    rows: dict[str, tuple[str, dict[str, Any]]] = {PAPER: ("bitcn", {"stride": 1})}
    rows |= {name: (name, {"stride": 8} if name.startswith("bitcn") else {}) for name in NETWORKS}
    return {
        row: build_network(name, CHANNELS, len(CLASSES), **settings)
        for row, (name, settings) in rows.items()
        if only is None or row == PAPER or name in only
    }


def training_step(network: Network) -> Callable[[], None]:
    """One step of Adam on one batch."""
    draw = torch.Generator().manual_seed(0)
    windows = torch.randn(BATCH, CHANNELS, LENGTH, generator=draw)
    target = torch.randint(len(CLASSES), (BATCH,), generator=draw)
    trained = network.fresh(0).train()
    optimizer = torch.optim.Adam(trained.parameters(), lr=1e-3)

    def step() -> None:
        optimizer.zero_grad()
        functional.cross_entropy(trained(windows), target).backward()
        optimizer.step()

    return step


def answers(network: Network, folder: Path) -> dict[str, Callable[[], object]]:
    """One window, and `TOGETHER` of them, scaled and classified by torch and by ONNX Runtime."""
    import onnxruntime

    draw, names = np.random.default_rng(0), tuple(f"a{number}" for number in range(CHANNELS))
    recordings = [
        Recording(draw.normal(size=(CHANNELS, LENGTH)), 25.6e3, label, channels=names, label=label) for label in CLASSES
    ]
    windows = cut_windows(recordings, length=LENGTH)
    classifier = fit(network, windows, settings=TrainingSettings(epochs=1, batch_size=5))
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    path = str(export_onnx(classifier, folder / "model.onnx"))
    session = onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])
    one, many = (windows.subset(np.resize(np.arange(len(windows)), count)) for count in (1, TOGETHER))
    return {
        "torch_ms": lambda: classifier.predict_proba(one),
        "onnx_ms": lambda: session.run(None, {"windows": one.signal}),
        "torch_batch_ms": lambda: classifier.predict_proba(many),
        "onnx_batch_ms": lambda: session.run(None, {"windows": many.signal}),
    }


def in_turns(calls: dict[Any, Callable[[], object]], rounds: int) -> dict[Any, float]:
    """Median processor time [s] of every call, one of each per round, after one round that warms up."""
    spent: dict[Any, list[float]] = {key: [] for key in calls}
    for _ in range(rounds + 1):
        for key, call in calls.items():
            started = time.process_time()
            call()
            spent[key].append(time.process_time() - started)
    return {key: float(np.median(times[1:])) for key, times in spent.items()}


def main() -> None:
    """Print one line for each network, or JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=3, help="steps that an epoch is scaled up from")
    parser.add_argument("--calls", type=int, default=50, help="diagnoses that are timed")
    parser.add_argument("--only", nargs="*", help="names of networks, beside the paper's BiTCN")
    parser.add_argument("--json", action="store_true", help="print JSON")
    options = parser.parse_args()
    torch.set_num_threads(1)
    rows = networks(options.only)
    steps = in_turns({row: training_step(network) for row, network in rows.items()}, options.steps)
    with tempfile.TemporaryDirectory() as folder:
        calls = {
            (row, kind): call for row, network in rows.items() for kind, call in answers(network, Path(folder)).items()
        }
        times = in_turns(calls, options.calls)
    result = {
        row: {
            "parameters": sum(weight.numel() for weight in network.parameters()),
            "epoch_s": steps[row] * EPOCH / BATCH,
            "ratio": steps[row] / steps[PAPER],
            **{kind: 1e3 * value for (of, kind), value in times.items() if of == row},
        }
        for row, network in rows.items()
    }
    if options.json:
        print(json.dumps({"rows": result, "load": os.getloadavg()[0]}, indent=1))
        return
    for row, facts in result.items():
        print(f"{row:30s}", "  ".join(f"{name} {value:.4g}" for name, value in facts.items()))


if __name__ == "__main__":
    main()
