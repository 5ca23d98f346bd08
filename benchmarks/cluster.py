"""Recordings diagnosed and virtual pumps simulated by two processes (loky), and by two workers of a
Dask cluster on the same computer: the same bits, and the ratio of the times.

    python benchmarks/cluster.py --recordings 1000 --pumps 2000 --json

Both do the same work in turns, `--rounds` times. Each number is the shortest time, or the least
processor time of all processes, which other work on the computer changes less. Starts are excluded:
both have done a few tasks before. Recordings last 4 s and have three channels at 25.6 kHz. At the
end a worker is killed in the middle of the diagnoses.
"""

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from contextlib import nullcontext, suppress
from pathlib import Path
from typing import Any

os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"))

import psutil
from distributed import Client, LocalCluster
from joblib import parallel_config
from plant import FACTS, write_recordings

from swashtwin.diagnosis import diagnose_recordings, load_model
from swashtwin.recordings import load_recordings
from swashtwin.synthesis import PumpPrior, simulate_changes

WORKERS = 2
TRAINING_RECORDINGS = 48
WARM_UP = 16
"""Recordings and pumps with which each process has loaded what it needs."""
LABELS = "(?P<label>[a-z]+)_(?P<specimen>[A-D])_"


def swashtwin(*words: object) -> None:
    """Run a command."""
    subprocess.run(
        [sys.executable, "-m", "swashtwin", *map(str, words)], check=True, stdout=subprocess.DEVNULL
    )


def prepare(folder: Path, count: int) -> tuple[Path, Path]:
    """Return a model and a folder of so many recordings, which stay from an earlier run."""
    model = folder / "model.safetensors"
    new = folder / f"new-{count}"
    for recordings, n_recordings in ((folder / "training", TRAINING_RECORDINGS), (new, count)):
        if not (recordings / "recordings.toml").exists():
            write_recordings(recordings, n_recordings)
            swashtwin("index", recordings, "--label-pattern", LABELS, *FACTS)
    if not model.exists():
        swashtwin("train", folder / "training", "--out", model)
    return model, new


def timed(function: Callable[[], Any]) -> tuple[float, float, Any]:
    """Return the time and the processor time [s] that a function takes, and its result."""
    begun = time.monotonic()
    cpu_before = cpu_s()
    result = function()
    return time.monotonic() - begun, cpu_s() - cpu_before, result


def cpu_s() -> float:
    """Return the processor time [s] of this process and of all that it started."""
    total = 0.0
    for process in (psutil.Process(), *psutil.Process().children(recursive=True)):
        with suppress(psutil.NoSuchProcess):
            # of the processes that it waited for, too
            total += sum(process.cpu_times()[:4])
    return total


def main() -> None:
    """Print what was measured."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--recordings", type=int, default=200, help="recordings to diagnose")
    parser.add_argument("--pumps", type=int, default=100, help="virtual pumps to simulate")
    parser.add_argument("--rounds", type=int, default=2, help="times that each does the work")
    parser.add_argument(
        "--folder", type=Path, help="where recordings and the model stay for the next run"
    )
    parser.add_argument("--json", action="store_true", help="print JSON")
    options = parser.parse_args()

    with tempfile.TemporaryDirectory(prefix="cluster-") as temporary:
        folder = (options.folder or Path(temporary)).resolve()
        model_file, index = prepare(folder, options.recordings)
        model = load_model(model_file)
        _, opening_cpu_s, recordings = timed(lambda: list(load_recordings(index)))

        def diagnose(count: int) -> str:
            verdicts = diagnose_recordings(model, recordings[:count], jobs=WORKERS)
            return json.dumps([verdict.to_dict() for verdict in verdicts], default=str)

        def simulate(count: int) -> bytes:
            changes = simulate_changes(PumpPrior(), count, seed=1, jobs=WORKERS)
            return changes.change.tobytes() + changes.scatter.tobytes()

        work = {
            "diagnoses": (diagnose, options.recordings),
            "pumps": (simulate, options.pumps),
        }
        times: dict[tuple[str, str], list[float]] = {}
        cpu_times: dict[tuple[str, str], list[float]] = {}
        results: dict[str, list[Any]] = {activity: [] for activity in work}
        with (
            LocalCluster(WORKERS, threads_per_worker=1, dashboard_address=None) as cluster,
            Client(cluster) as client,
        ):
            backends = {"loky": nullcontext, "dask": lambda: parallel_config("dask", client=client)}
            for backend in backends.values():
                with backend():
                    diagnose(min(WARM_UP, options.recordings))
                    simulate(WARM_UP)
            for _ in range(options.rounds):
                for activity, (function, count) in work.items():
                    for name, backend in backends.items():
                        with backend():
                            spent, cpu, result = timed(lambda: function(count))  # noqa: B023
                        times.setdefault((activity, name), []).append(spent)
                        cpu_times.setdefault((activity, name), []).append(cpu)
                        results[activity].append(result)
                        print(
                            f"{activity} {name} {spent:.1f} s, {cpu:.1f} s of processor",
                            file=sys.stderr,
                        )

            # A worker is killed after a third of the shortest time.
            victim = next(iter(client.run(os.getpid).values()))
            delay = min(times["diagnoses", "dask"]) / 3
            threading.Timer(delay, os.kill, (victim, signal.SIGKILL)).start()
            with backends["dask"]():
                killed_s, _, result = timed(lambda: diagnose(options.recordings))
            survivors = set(client.run(os.getpid).values())
            results["diagnoses"].append(result)

    shortest = {f"{activity}_{name}_s": min(spent) for (activity, name), spent in times.items()}
    least = {
        f"{activity}_{name}_cpu_s": min(spent) for (activity, name), spent in cpu_times.items()
    }
    facts = {
        **shortest,
        **least,
        **{
            f"{activity}_ratio": shortest[f"{activity}_dask_s"] / shortest[f"{activity}_loky_s"]
            for activity in work
        },
        **{
            f"{activity}_cpu_ratio": least[f"{activity}_dask_cpu_s"]
            / least[f"{activity}_loky_cpu_s"]
            for activity in work
        },
        "same_bits": all(len(set(answers)) == 1 for answers in results.values()),
        "worker_killed": victim not in survivors,
        "diagnoses_killed_s": killed_s,
        "opening_cpu_s": opening_cpu_s,
        "recordings": options.recordings,
        "pumps": options.pumps,
        "rounds": options.rounds,
        "cores": os.cpu_count(),
        "load": os.getloadavg()[0],
    }
    if options.json:
        print(json.dumps(facts, indent=1))
        return
    for fact, value in facts.items():
        print(f"{fact:24}{value:>12.4g}" if isinstance(value, float) else f"{fact:24}{value!s:>12}")


if __name__ == "__main__":
    main()
