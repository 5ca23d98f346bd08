"""What a watch costs: its start, the time to a verdict, a plant of many pumps, and a day's recordings at speed.

    python benchmarks/watch_load.py start latency plant soak --folder /tmp/load --json

``start`` is the time until the page answers. ``latency`` is the time from a closed file (4 s, three channels at
25.6 kHz) to its verdict in the history, as another process sees it; the page polls the history each half second.
``plant`` delivers one such recording a minute of each of 200 machines. ``soak`` delivers short recordings as fast as
they are judged; memory and handles are compared after a tenth and at the end. The processes that deliver run on the
same cores, and their time is not counted.
"""

import argparse
import json
import statistics
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from watch_plant import WatchProcess, deliver, open_history, samples, wav, write_config

_WAIT = 300.0
"""Longest time [s] to wait for a verdict."""


def start(folder: Path, repeats: int = 5) -> dict[str, Any]:
    """Time [s] until the page answers, of an empty history and of one that is there."""
    times = []
    watch = WatchProcess(write_config(folder, ["pump-1"]))
    for _ in range(repeats):
        times.append(watch.start())
        watch.stop()
    return {"first_s": times[0], "median_s": statistics.median(times[1:])}


def latency(folder: Path, count: int = 40) -> dict[str, Any]:
    """Time [s] from a closed file to its verdict in the history."""
    watch = WatchProcess(write_config(folder, ["pump-1"]))
    watch.start()
    history, times = open_history(watch.config), []
    for number in range(count):
        closed = deliver(folder / "incoming" / "pump-1" / f"{number:05}.wav", wav(samples(number)))
        while not (newest := history.read.recordings(limit=1)) or newest[0].file != f"{number:05}.wav":
            if time.time() - closed > _WAIT:
                raise RuntimeError("no verdict")
            time.sleep(0.01)
        times.append(time.time() - closed)
    history.close()
    watch.stop()
    return {"recordings": count, "median_s": statistics.median(times), "largest_s": max(times)}


def plant(folder: Path, machines: int = 200, minutes: float = 5.0) -> dict[str, Any]:
    """CPU time and memory of a plant with one recording a minute of each machine, and how far its verdicts lag."""
    names = [f"pump-{number:03}" for number in range(machines)]
    watch = WatchProcess(write_config(folder, names))
    files = [wav(samples(number)) for number in range(20)]
    watch.start()
    before, began, closed = watch.usage(), time.time(), {}
    largest = 0.0
    count = int(machines * minutes)
    for number in range(count):
        time.sleep(max(0.0, began + 60 * number / machines - time.time()))
        content = bytearray(files[number % len(files)])
        content[100:104] = number.to_bytes(3, "little") + b"\x3e"
        name = f"{number:06}.wav"
        closed[name] = deliver(folder / "incoming" / names[number % machines] / name, bytes(content))
        if number % machines == 0:
            largest = max(largest, watch.usage()["memory_mb"])
    history = open_history(watch.config)
    end = time.time() + _WAIT
    while sum(history.read.counts().recordings.values()) < count and time.time() < end:
        time.sleep(0.2)
    drained, after = time.time(), watch.usage()
    judged = sum(history.read.counts().recordings.values())
    history.close()
    watch.stop()
    return {
        "machines": machines,
        "recordings": judged,
        "missing": count - judged,
        "cpu_s_per_recording": (after["cpu_s"] - before["cpu_s"]) / max(1, judged),
        "share_of_one_core": (after["cpu_s"] - before["cpu_s"]) / (drained - began),
        "memory_mb": max(largest, after["memory_mb"]),
        "last_verdict_after_s": drained - max(closed.values()),
    }


def soak(folder: Path, count: int = 20_000, machines: int = 20, waiting: int = 200) -> dict[str, Any]:
    """Memory and handles of a watch after a tenth of many short recordings, and after all."""
    names = [f"pump-{number:03}" for number in range(machines)]
    watch = WatchProcess(write_config(folder, names))
    watch.start()
    history, began = open_history(watch.config), time.time()
    usage: dict[str, dict[str, float]] = {}

    def judged() -> int:
        return int(sum(history.read.counts().recordings.values()))

    done = 0
    for number in range(count):
        content = wav(samples(number, rate=5120.0, seconds=1.0, channels=1), 5120.0)
        deliver(folder / "incoming" / names[number % machines] / f"{number:06}.wav", content)
        while number - done > waiting:
            done = judged()
            time.sleep(0.05)
        if number == count // 10:
            usage["tenth"] = watch.usage()
        if number and number % 1000 == 0:
            print(f"{number} delivered, {done} judged: {watch.usage()}", file=sys.stderr, flush=True)
    while judged() < count and time.time() - began < 60 + count:
        time.sleep(0.2)
    usage["end"] = watch.usage()
    result = {
        "recordings": judged(),
        "rejections": len(history.read.rejections(limit=10)),
        "seconds": time.time() - began,
    }
    history.close()
    watch.stop()
    waveforms = sum(1 for _ in (folder / "data" / "waveforms").rglob("*.h5"))
    return {**result, **usage, "waveforms": waveforms}


QUESTIONS = {"start": start, "latency": latency, "plant": plant, "soak": soak}


def main() -> None:
    """Answer the questions that are named."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("questions", nargs="*", choices=[*QUESTIONS, []], default=list(QUESTIONS))
    parser.add_argument("--folder", type=Path, help="where the watches work; a temporary folder by default")
    parser.add_argument("--machines", type=int, help="of the plant")
    parser.add_argument("--minutes", type=float, help="of the plant")
    parser.add_argument("--count", type=int, help="recordings of the soak")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    sizes = {"plant": {"machines": options.machines, "minutes": options.minutes}, "soak": {"count": options.count}}
    if options.folder is not None:
        options.folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=options.folder) as folder:
        for question in options.questions:
            given = {name: value for name, value in sizes.get(question, {}).items() if value is not None}
            answer = QUESTIONS[question](Path(folder) / question, **given)
            print(json.dumps({question: answer}) if options.json else f"{question}: {answer}", flush=True)


if __name__ == "__main__":
    main()
