"""Cost of the history: files recordings of many machines, and says what each costs and how large they are.

    python benchmarks/history_load.py --machines 200 --recordings 20000
    python benchmarks/history_load.py --url postgresql://user@host/empty_database --processes 2

Each recording is what a watch files: three channels with 140 levels each, a verdict, a baseline of 23 kB that is read,
and a state of the test of 8 kB that is read and written. Waveforms are another run (--waveforms),
because they cost more than the rest. `cpu_ms` is of the writing processes; a PostgreSQL server's comes on top.
"""

import argparse
import json
import resource
import tempfile
import time
from datetime import UTC, datetime, timedelta
from hashlib import sha256
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from swashtwin.monitoring.config import Retention
from swashtwin.monitoring.history import History, Judgment
from swashtwin.recordings import Recording

CHANNELS = ("x", "y", "z")
INDICATORS = {(channel, f"{number} Hz"): 1.0 + number for channel in CHANNELS for number in range(140)}
TEST = {"capitals": [1 / 3] * 400, "flags": [False] * 3}
BASELINE = {"levels": [[channel, name, 180 / 7, 1 / 3] for channel, name in INDICATORS]}
REASONS = {"sentences": ["No level has risen."], "moved": [["x", "630 Hz", 1.2]] * 5, "verdict": {"label": "normal"}}
START = datetime(2026, 1, 1, tzinfo=UTC)


def judgment(machine: int, number: int) -> Judgment:
    """Recording `number` of a machine: one a minute."""
    time_measured = START + timedelta(minutes=number)
    return Judgment(
        content=sha256(f"{machine} {number}".encode()).hexdigest(),
        time=time_measured,
        received=time_measured + timedelta(seconds=5),
        source="folder",
        file=f"{number}.wav",
        channels=CHANNELS,
        unit="m/s^2",
        sample_rate=25600.0,
        duration=4.0,
        state="normal",
        point="1500 rpm, 15 MPa",
        speed=157.1,
        pressure=15e6,
        label="normal",
        probability=0.9,
        confidence=0.8,
        ood_p=0.5,
        model="0123456789abcdef",
        alarm_p=0.5,
        capital=0.3,
        reasons=REASONS,
    )


def file_recordings(url: str, folder: Path, machines: range, first: int, count: int, waveforms: bool) -> list[float]:
    """Wall times of `count` transactions [s], one recording of each machine in turn."""
    history = History.open(url, folder, Retention(last=10))
    signal = np.random.default_rng(0).standard_normal((3, 102_400)).astype(np.float32)
    recording = Recording(signal, 25600.0, "a", channels=CHANNELS)
    times = []
    for index in range(count):
        machine, number = machines[index % len(machines)], first + index // len(machines)
        name, facts = f"pump-{machine}", judgment(machine, number)
        started = time.perf_counter()
        path = history.waveforms.write(name, facts.time, facts.content, recording) if waveforms else None
        with history.machine(name) as transaction:
            transaction.recording_of(facts.content)
            transaction.newest()
            transaction.point("1500 rpm, 15 MPa")
            transaction.alarms()
            transaction.last_event("maintenance")
            transaction.add_recording(facts, INDICATORS, path)
            transaction.save_point("1500 rpm, 15 MPa", baseline=None if number else BASELINE, test=TEST)
        times.append(time.perf_counter() - started)
    history.close()
    return times


def _cpu() -> float:
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def _work(arguments: tuple[str, Path, range, int, int, bool]) -> tuple[list[float], float]:
    started = _cpu()
    return file_recordings(*arguments), _cpu() - started


def _bytes(url: str, folder: Path) -> int:
    if not url:
        return sum(file.stat().st_size for file in folder.glob("history.sqlite*"))
    import psycopg

    with psycopg.connect(url) as connection:
        tables = "pg_total_relation_size('recordings') + pg_total_relation_size('indicators')"
        row = connection.execute(f"SELECT {tables}").fetchone()  # what grows; the rest is written over
        assert row is not None
        return int(row[0])


def _reads(url: str, folder: Path) -> dict[str, float]:
    """Wall time of what the page asks [s], the fastest of nine."""
    history = History.open(url, folder)
    read = history.read
    calls = {
        "sequence": read.sequence,
        "machines": read.machines,
        "recordings": lambda: read.recordings("pump-0"),
        "trend": lambda: read.trend("pump-0", "x", "20 Hz"),
        "counts": read.counts,
        "waiting": lambda: history.outbox.waiting(["log"]),
    }
    results = {}
    for name, call in calls.items():
        times = []
        for _ in range(9):
            started = time.perf_counter()
            call()
            times.append(time.perf_counter() - started)
        results[name] = min(times)
    history.close()
    return results


def main() -> None:
    """Measure, and print one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--url", default="", help="empty PostgreSQL database; by default SQLite in a temporary folder")
    parser.add_argument("--machines", type=int, default=200)
    parser.add_argument("--recordings", type=int, default=20_000)
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--waveforms", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        file_recordings(options.url, folder, range(options.machines), 0, options.machines, False)
        before = _bytes(options.url, folder)
        share = options.machines // options.processes
        work = [
            (options.url, folder, range(n * share, (n + 1) * share), 1, options.recordings // options.processes,
             options.waveforms)
            for n in range(options.processes)
        ]  # fmt: skip
        started = time.perf_counter()
        with get_context("spawn").Pool(options.processes) as pool:
            results = pool.map(_work, work)
        wall = time.perf_counter() - started
        count = sum(len(times) for times, _ in results)
        times = np.sort(np.concatenate([times for times, _ in results]))
        answer = {
            "database": options.url.partition(":")[0] or "sqlite",
            "machines": options.machines,
            "recordings": count,
            "processes": options.processes,
            "per_second": count / wall,
            "cpu_ms": 1000 * sum(cpu for _, cpu in results) / count,
            "median_ms": 1000 * float(np.median(times)),
            "p99_ms": 1000 * float(np.quantile(times, 0.99)),
            "bytes": (_bytes(options.url, folder) - before) / count,
            "memory_mb": resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1000,
            "reads_ms": {name: round(1000 * value, 2) for name, value in _reads(options.url, folder).items()},
        }
    print(json.dumps(answer, indent=1))


if __name__ == "__main__":
    main()
