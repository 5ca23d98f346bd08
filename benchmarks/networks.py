"""Cost of every network: weights, an epoch of training, and one window, by torch and by ONNX Runtime, on one thread.

    python benchmarks/networks.py --json networks.json

The contenders take turns, one step or call each, so that whoever else uses the machine slows all of them alike. An
epoch is scaled up from `--steps` steps of Adam, and its time is that of the processor, not of the clock; `ratio` is the
share of what the paper's BiTCN (`stride` 1) needs. Of single windows both are told: `cpu` is the time of the thread,
`wall` what one waits, which only means something where nobody else computes. Windows per second are of batches. The
windows are noise: no time here depends on what is in them.
"""

import argparse
import json
import os
import platform
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
TOGETHER = 64
"""Windows of a batch where many are to be told."""

CLASSES = ("normal", "swash_plate", "cylinder_block", "piston", "valve_plate")


def contenders(only: list[str] | None) -> dict[str, tuple[str, dict[str, Any]]]:
    """Network and settings of each row."""
    rows: dict[str, tuple[str, dict[str, Any]]] = {PAPER: ("bitcn", {"stride": 1})}
    rows["bitcn, stride 8"] = ("bitcn", {"stride": 8})
    rows |= {name: (name, {"stride": 8}) for name in NETWORKS if name.startswith("bitcn_")}
    rows |= {name: (name, {}) for name in NETWORKS if not name.startswith("bitcn")}
    return {row: entry for row, entry in rows.items() if only is None or row == PAPER or entry[0] in only}


def trainer(network: Network, batch: int, channels: int, length: int) -> Callable[[], None]:
    """One step of Adam on one batch."""
    draw = torch.Generator().manual_seed(0)
    windows = torch.randn(batch, channels, length, generator=draw)
    target = torch.randint(len(CLASSES), (batch,), generator=draw)
    trained = network.fresh(0).train()
    optimizer = torch.optim.Adam(trained.parameters(), lr=1e-3)

    def step() -> None:
        optimizer.zero_grad()
        functional.cross_entropy(trained(windows), target).backward()
        optimizer.step()

    return step


def answerers(network: Network, channels: int, length: int, folder: Path) -> dict[int, dict[str, Callable[[], object]]]:
    """One window, and `TOGETHER` of them, scaled and told, by torch and by ONNX Runtime, each on this thread alone."""
    import onnxruntime

    draw = np.random.default_rng(0)
    names = tuple(f"a{number}" for number in range(channels))
    recordings = [
        Recording(draw.normal(size=(channels, length)), 25.6e3, label, channels=names, label=label) for label in CLASSES
    ]
    windows = cut_windows(recordings, length=length)
    classifier = fit(network, windows, settings=TrainingSettings(epochs=1, batch_size=5))
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    path = export_onnx(classifier, folder / "model.onnx")
    session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    inputs = {count: windows.subset(np.resize(np.arange(len(windows)), count)) for count in (1, TOGETHER)}
    return {
        count: {
            "torch": lambda some=some: classifier.predict_proba(some),
            "onnx": lambda some=some: session.run(None, {"windows": some.signal}),
        }
        for count, some in inputs.items()
    }


def in_turns(
    calls: dict[str, Callable[[], object]], rounds: int, clock: Callable[[], float]
) -> dict[str, dict[str, np.ndarray]]:
    """Times of every call, by `clock` and by the wall, one of each per round after one that warms up [s]."""
    spent: dict[str, dict[str, list[float]]] = {name: {"cpu": [], "wall": []} for name in calls}
    for number in range(rounds + 1):
        for name, call in calls.items():
            started, waited = clock(), time.perf_counter()
            call()
            if number:
                spent[name]["cpu"].append(clock() - started)
                spent[name]["wall"].append(time.perf_counter() - waited)
    return {name: {kind: np.array(values) for kind, values in both.items()} for name, both in spent.items()}


def main() -> None:
    """Measure and tell."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--windows", type=int, default=3000, help="windows of an epoch")
    parser.add_argument("--channels", type=int, default=3)
    parser.add_argument("--length", type=int, default=2048)
    parser.add_argument("--batch", type=int, default=30)
    parser.add_argument("--steps", type=int, default=3, help="steps that an epoch is scaled up from")
    parser.add_argument("--calls", type=int, default=200, help="single windows")
    parser.add_argument("--only", nargs="*", help="names of networks, beside the paper's BiTCN")
    parser.add_argument("--json", type=Path, help="file to write")
    options = parser.parse_args()
    torch.set_num_threads(1)
    result = measured(options)
    print(
        f"{options.windows} windows of {options.channels} x {options.length}, batches of {options.batch}, one thread, "
        f"torch {torch.__version__}, {platform.machine()}, load {os.getloadavg()[0]:.1f}"
    )
    for row, facts in result.items():
        print(line(row, facts))
    if options.json:
        options.json.write_text(json.dumps({"settings": vars(options) | {"json": None}, "rows": result}, indent=1))


def measured(options: argparse.Namespace) -> dict[str, dict[str, Any]]:
    """Everything known of each row."""
    rows = contenders(options.only)
    networks = {
        row: build_network(name, options.channels, len(CLASSES), **settings) for row, (name, settings) in rows.items()
    }
    shape = options.channels, options.length
    steps = {row: trainer(network, options.batch, *shape) for row, network in networks.items()}
    trained = in_turns(steps, options.steps, time.process_time)
    with tempfile.TemporaryDirectory() as folder:
        answering = {row: answerers(network, *shape, Path(folder)) for row, network in networks.items()}
        times, together = (
            in_turns(
                {f"{row} by {by}": call for row, calls in answering.items() for by, call in calls[count].items()},
                -(-options.calls // count),
                time.thread_time,
            )
            for count in (1, TOGETHER)
        )
    epoch = {row: float(np.median(spent["cpu"])) * options.windows / options.batch for row, spent in trained.items()}
    return {
        row: {
            "parameters": sum(weight.numel() for weight in network.parameters()),
            "receptive_field": getattr(network, "receptive_field", None),
            "epoch_cpu_s": epoch[row],
            "ratio": epoch[row] / epoch[PAPER],
            "torch_ms": milliseconds(times[f"{row} by torch"]),
            "onnx_ms": milliseconds(times[f"{row} by onnx"]),
            **{
                f"{by}_windows_per_s": TOGETHER / float(np.median(together[f"{row} by {by}"]["cpu"]))
                for by in ("torch", "onnx")
            },
        }
        for row, network in networks.items()
    }


def milliseconds(spent: dict[str, np.ndarray]) -> dict[str, float]:
    """Median and 99th percentile by each clock."""
    return {f"{kind} p{share}": float(1e3 * np.percentile(spent[kind], share)) for kind in spent for share in (50, 99)}


def line(row: str, facts: dict[str, Any]) -> str:
    """One row of the table."""
    both = {by: facts[f"{by}_ms"] for by in ("torch", "onnx")}
    rates = [f"{by} {facts[f'{by}_windows_per_s']:6.0f} /s" for by in both]
    times = [f"{by} {spent['cpu p50']:6.2f} / {spent['cpu p99']:6.2f} ms" for by, spent in both.items()]
    field = str(facts["receptive_field"] or "all")
    return "  ".join(
        [
            f"{row:30s} {facts['parameters']:8d} {field:>5s} {facts['epoch_cpu_s']:8.1f} s {facts['ratio']:6.3f}",
            *times,
            *rates,
        ]
    )


if __name__ == "__main__":
    main()
