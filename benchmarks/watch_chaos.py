"""Whether a watch loses or doubles a recording while it is killed again and again, and all around it fails.

    python benchmarks/watch_chaos.py --kills 50 --json

A folder, a broker and uploads deliver recordings without a pause. Meanwhile the watch is killed (SIGKILL) at random
moments; the broker and the database are stopped and started; the disk of the watch's folder is filled; and after some
kills the watch starts with a clock that is an hour behind. In the end everything runs, and each recording must be in
the history once. A delivery that was repeated since its source did not hear that it had arrived is filed as ``double``.
The full disk needs the right to mount a file system in memory, the clock a C compiler; without them these are left out.
"""

import argparse
import contextlib
import json
import random
import shutil
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

from watch_plant import Broker, Database, WatchProcess, deliver, open_history, samples, wav, write_config

RATE = 5120.0
_CLOCK = r"""
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdlib.h>
#include <sys/time.h>
#include <time.h>
static long behind(void) { const char *text = getenv("CLOCK_BEHIND"); return text ? atol(text) : 0; }
int clock_gettime(clockid_t clock, struct timespec *moment) {
  static int (*real)(clockid_t, struct timespec *);
  if (!real) real = dlsym(RTLD_NEXT, "clock_gettime");
  int answer = real(clock, moment);
  if (clock == CLOCK_REALTIME) moment->tv_sec -= behind();
  return answer;
}
time_t time(time_t *slot) {
  struct timespec moment; clock_gettime(CLOCK_REALTIME, &moment);
  if (slot) *slot = moment.tv_sec;
  return moment.tv_sec;
}
int gettimeofday(struct timeval *slot, void *zone) {
  struct timespec moment; clock_gettime(CLOCK_REALTIME, &moment);
  slot->tv_sec = moment.tv_sec; slot->tv_usec = moment.tv_nsec / 1000;
  return 0;
}
"""


class Deliveries:
    """Delivers recordings by all ways until it is stopped, and remembers their names."""

    def __init__(self, watch: WatchProcess, broker: Broker, inbox: Path, pause: float) -> None:
        self.names: list[str] = []
        self._watch, self._broker, self._inbox, self._pause = watch, broker, inbox, pause
        self._stop = threading.Event()
        ways: tuple[Callable[[str, bytes], None], ...] = (self._by_folder, self._by_broker, self._by_upload)
        self._threads = [
            threading.Thread(target=self._run, args=(number, way), daemon=True) for number, way in enumerate(ways)
        ]

    def start(self) -> None:
        """Begin."""
        for thread in self._threads:
            thread.start()

    def stop(self) -> None:
        """End after the deliveries that are under way."""
        self._stop.set()
        for thread in self._threads:
            thread.join()

    def _run(self, number: int, way: Callable[[str, bytes], None]) -> None:
        count = 0
        while not self._stop.wait(self._pause):
            name = f"{'fmu'[number]}{count:05}.wav"
            way(name, wav(samples(3 * count + number, rate=RATE, seconds=1.0, channels=1), RATE))
            self.names.append(name)
            count += 1

    def _by_folder(self, name: str, content: bytes) -> None:
        deliver(self._inbox / "by-folder" / name, content)

    def _by_broker(self, name: str, content: bytes) -> None:
        from paho.mqtt.publish import single

        payload = json.dumps({"file": name}).encode() + b"\n" + content
        while True:
            try:
                single("plant/by-broker/raw", payload, qos=1, hostname="127.0.0.1", port=self._broker.port)
            except (OSError, ValueError):
                time.sleep(0.2)
            else:
                return

    def _by_upload(self, name: str, content: bytes) -> None:
        url = f"{self._watch.address}/api/recordings?machine=by-upload"
        while True:
            headers = {"X-File-Name": name, "Content-Type": "application/octet-stream"}
            request = urllib.request.Request(url, content, headers)
            try:
                with urllib.request.urlopen(request, timeout=10) as answer:
                    if answer.status == 202:
                        return
            except OSError:
                time.sleep(0.2)


def clock_library(folder: Path) -> dict[str, str]:
    """Environment in which a process reads a clock that is CLOCK_BEHIND seconds behind; empty without a compiler."""
    if shutil.which("cc") is None:
        return {}
    source, library = folder / "clock.c", folder / "clock.so"
    source.write_text(_CLOCK, encoding="utf-8")
    subprocess.run(["cc", "-shared", "-fPIC", "-o", str(library), str(source), "-ldl"], check=True)
    return {"LD_PRELOAD": str(library)}


@contextlib.contextmanager
def small_disk(folder: Path, megabytes: int = 64) -> Any:
    """Whether `folder` is a small file system of its own while the block runs."""
    folder.mkdir(parents=True)
    command = ["mount", "-t", "tmpfs", "-o", f"size={megabytes}m", "tmpfs", str(folder)]
    is_mounted = subprocess.run(command, capture_output=True, check=False).returncode == 0
    try:
        yield is_mounted
    finally:
        if is_mounted:
            subprocess.run(["umount", "-l", str(folder)], check=True)


def fill(folder: Path) -> Path:
    """File that takes all the space of a disk."""
    path = folder / "filling"
    with contextlib.suppress(OSError), path.open("wb", buffering=0) as file:
        while file.write(bytes(1 << 12)):
            pass
    return path


def torment(folder: Path, kills: int, pause: float, seed: int, is_small: bool) -> dict[str, Any]:
    """What became of the recordings."""
    moments, events = random.Random(seed), Counter[str]()
    database, broker = Database(), Broker(folder / "broker")
    broker.start()
    text = f'[[source]]\nkind = "mqtt"\nhost = "127.0.0.1"\nport = {broker.port}\ntopic = "plant/+/raw"\n'
    text += "[retention]\nper_day = 1\nlast = 5\nalarms = 5\n"
    machines = ["by-folder", "by-broker", "by-upload"]
    config = write_config(folder, machines, text=text, history=database.url, data="disk/data")
    watch, clock = WatchProcess(config), clock_library(folder)
    deliveries = Deliveries(watch, broker, folder / "incoming", pause)
    watch.start()
    deliveries.start()
    for number in range(kills):
        time.sleep(moments.uniform(0.1, 3.0))
        if number % 10 == 3:
            broker.stop()
            time.sleep(moments.uniform(0.1, 2.0))
            broker.start()
            events["broker"] += 1
        if number % 10 == 6:
            database.stop()
            time.sleep(moments.uniform(0.1, 2.0))
            database.start()
            events["database"] += 1
        if number % 10 == 9 and is_small:
            filling = fill(folder / "disk")
            time.sleep(moments.uniform(1.0, 3.0))
            filling.unlink()
            events["disk"] += 1
        watch.kill()
        events["kills"] += 1
        behind = clock if number % 5 == 4 else {}
        events["clock"] += bool(behind)
        watch.start(**behind, **({"CLOCK_BEHIND": "3600"} if behind else {}))
        print(
            f"{number + 1} of {kills}: {dict(events)}, {len(deliveries.names)} delivered", file=sys.stderr, flush=True
        )
    deliveries.stop()
    watch.kill()
    watch.start()
    history = open_history(config)
    result = settle(history, deliveries.names, events)
    history.close()
    result["exit_code"] = watch.stop()
    result["spool"] = len(list((folder / "disk" / "data" / "spool").iterdir()))
    broker.stop()
    database.remove()
    return result


def settle(history: Any, names: list[str], events: Counter[str], seconds: float = 300.0) -> dict[str, Any]:
    """Recordings that are lost or doubled once all were judged, or after some time."""
    end = time.monotonic() + seconds
    missing: set[str] = set(names)
    while missing and time.monotonic() < end:
        counts = Counter(item.file for item in history.read.recordings(limit=1_000_000))
        missing = set(names) - counts.keys()
        time.sleep(0.5)
    rejections = Counter(item.reason for item in history.read.rejections(limit=10_000))
    return {
        **events,
        "delivered": len(names),
        "lost": sorted(missing)[:10],
        "lost_count": len(missing),
        "twice": sum(count - 1 for count in counts.values()),
        "rejections": dict(rejections),
        "states": dict(Counter(item.state for item in history.read.recordings(limit=1_000_000))),
    }


def main() -> None:
    """Torment a watch, and print what became of the recordings."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--pause", type=float, default=0.3, help="seconds between two deliveries of each source")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with small_disk(folder / "disk") as is_small:
            result = torment(folder, options.kills, options.pause, options.seed, is_small)
    print(json.dumps(result) if options.json else result)


if __name__ == "__main__":
    main()
