"""Recordings diagnosed and virtual pumps simulated by two processes (loky), and by two workers of a
Dask cluster on the same computer: the same bits, and the ratio of the times.

    python benchmarks/cluster.py --recordings 1000 --pumps 2000 --json

Both do the same work in turns, `--rounds` times, and each number is the shortest time. Starts are
excluded: both have done a few tasks before. Recordings last 4 s and have three channels at 25.6
kHz. In the last round a worker is killed in the middle of the diagnoses.
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
from contextlib import nullcontext
from pathlib import Path
from typing import Any

os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"))

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
    """Return a model and an index of so many recordings."""
    model = folder / "model.safetensors"
    for name, n_recordings in (("training", TRAINING_RECORDINGS), ("new", count)):
        write_recordings(folder / name, n_recordings)
        swashtwin("index", folder / name, "--label-pattern", LABELS, *FACTS)
    swashtwin("train", folder / "training", "--out", model)
    return model, folder / "new"


def timed(function: Callable[[], Any]) -> tuple[float, Any]:
    """Return the time [s] that a function takes, and its result."""
    begun = time.monotonic()
    result = function()
    return time.monotonic() - begun, result


def main() -> None:
    """Print what was measured."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--recordings", type=int, default=200, help="recordings to diagnose")
    parser.add_argument("--pumps", type=int, default=100, help="virtual pumps to simulate")
    parser.add_argument("--rounds", type=int, default=2, help="times that each does the work")
    parser.add_argument("--json", action="store_true", help="print JSON")
    options = parser.parse_args()

    with tempfile.TemporaryDirectory(prefix="cluster-") as name:
        model_file, index = prepare(Path(name), options.recordings)
        model = load_model(model_file)
        opening_s, recordings = timed(lambda: list(load_recordings(index)))

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
                            spent, result = timed(lambda: function(count))  # noqa: B023
                        times.setdefault((activity, name), []).append(spent)
                        results[activity].append(result)
                        print(f"{activity} {name} {spent:.1f} s", file=sys.stderr)

            # A worker is killed after a third of the shortest time.
            victim = next(iter(client.run(os.getpid).values()))
            delay = min(times["diagnoses", "dask"]) / 3
            threading.Timer(delay, os.kill, (victim, signal.SIGKILL)).start()
            with backends["dask"]():
                killed_s, result = timed(lambda: diagnose(options.recordings))
            survivors = set(client.run(os.getpid).values())
            results["diagnoses"].append(result)

    shortest = {f"{activity}_{name}_s": min(spent) for (activity, name), spent in times.items()}
    facts = {
        **shortest,
        **{
            f"{activity}_ratio": shortest[f"{activity}_dask_s"] / shortest[f"{activity}_loky_s"]
            for activity in work
        },
        "same_bits": all(len(set(answers)) == 1 for answers in results.values()),
        "worker_killed": victim not in survivors,
        "diagnoses_killed_s": killed_s,
        "opening_s": opening_s,
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
