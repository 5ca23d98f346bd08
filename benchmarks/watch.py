"""What a watch costs, and whether it loses or doubles a recording while it is killed and all around
it fails.

    python benchmarks/watch.py start latency plant
    python benchmarks/watch.py kills --kills 50 --json
    python benchmarks/watch.py blind healthy

``start`` is the time until the page answers. ``latency`` is the time from a closed file (4 s, three
channels at 25.6 kHz) to its verdict in the history, as another process sees it. ``plant`` delivers
one such recording a minute of each of 200 machines. The processes that deliver run on the same
cores; their time is not counted.

``kills``: a folder, a broker and uploads deliver without a pause. Meanwhile the watch is killed
(SIGKILL) at random moments, the broker and the database are stopped and started, and the disk of
the watch's folder is filled. In the end everything runs, and each recording must be in the history
once. A delivery that was repeated since its source did not hear that it had arrived is filed as
``double``. The full disk needs the right to mount a file system in memory; without it, it is left
out.

``blind``: plants with wrong clocks, lost channels and broken tags (`watch_plants`). Each must be
reported within three deliveries, and what can be read must be judged.

``healthy``: 20 healthy machines with 260 recordings each. No alarm of any kind is expected; at the
default rate each machine may ever raise one with a probability of 0.01.
"""

import argparse
import contextlib
import json
import os
import random
import shutil
import signal
import socket
import statistics
import struct
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

RATE, SECONDS = 25_600.0, 4.0
SLOW = 5120.0
"""Sampling rate [Hz] of the short recordings that are delivered while the watch is killed."""
LONGEST = 300.0
"""Longest time [s] to wait for a verdict."""


def samples(
    seed: int, *, rate: float = RATE, seconds: float = SECONDS, channels: int = 3
) -> np.ndarray:
    """Vibration of a pump at 1500 rpm (channel, time), float32 [m/s^2]; each seed gives another
    one.
    """
    random = np.random.default_rng(seed)
    moments = np.arange(int(rate * seconds)) / rate
    tone = sum(
        np.sin(2 * np.pi * 225 * order * moments + random.uniform(0, 6)) / order
        for order in range(1, 6)
    )
    noise = random.standard_normal((channels, moments.size), np.float32)
    return (noise + np.asarray(tone, np.float32)).astype(np.float32)


def wav(values: np.ndarray, rate: float = RATE) -> bytes:
    """A float32 WAV file of samples (channel, time)."""
    data, count = np.ascontiguousarray(values.T, "<f4").tobytes(), len(values)
    fields = struct.pack("<HHIIHH", 3, count, int(rate), int(rate) * count * 4, count * 4, 32)
    chunks = (
        b"fmt " + struct.pack("<I", 16) + fields + b"data" + struct.pack("<I", len(data)) + data
    )
    return b"RIFF" + struct.pack("<I", 4 + len(chunks)) + b"WAVE" + chunks


def deliver(path: Path, content: bytes) -> float:
    """Write a file beside its place and move it there; the time at which it was closed."""
    path.parent.mkdir(parents=True, exist_ok=True)
    hidden = path.with_name(f".{path.name}")
    hidden.write_bytes(content)
    hidden.rename(path)
    return time.time()


def write_config(
    folder: Path, machines: Sequence[str], *, text: str = "", history: str = "", data: str = "data"
) -> Path:
    """Configuration of a watch of the folder ``incoming`` and of uploads; its page has a free
    port.
    """
    (folder / "incoming").mkdir(parents=True, exist_ok=True)
    lines = [f'folder = "{data}"', f'history = "{history}"' if history else ""]
    facts = 'speed = "1500 rpm"\ndischarge_pressure = "15 MPa"\nunit = "m/s^2"'
    lines += [f'[[machine]]\nname = "{name}"\n{facts}' for name in machines]
    lines += [
        '[[source]]\nkind = "folder"\npath = "incoming"\nremove = true',
        '[[source]]\nkind = "http"',
    ]
    lines += [f"[page]\nport = {free_port()}", text]
    path = folder / "watch.toml"
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


def free_port() -> int:
    """A port of this computer that nothing listens at."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        return int(server.getsockname()[1])


class WatchProcess:
    """``swashtwin watch CONFIG`` as a process of its own."""

    def __init__(self, config: Path, python: Path | None = None) -> None:
        self.config, self._python = config, python or Path(sys.executable)
        port = int(config.read_text(encoding="utf-8").split("port = ")[1].split()[0])
        self.address = f"http://127.0.0.1:{port}"
        self.process: subprocess.Popen[bytes] | None = None

    def start(self, seconds: float = 120) -> float:
        """Time [s] until the page answers."""
        began = time.monotonic()
        with self.config.with_name("log.txt").open("ab") as log:
            command = [self._python, "-m", "swashtwin", "watch", str(self.config)]
            environment = {**os.environ, "PYTHONPATH": "", "PYTHONUNBUFFERED": "1"}
            if self._python == Path(sys.executable):
                environment["PYTHONPATH"] = os.pathsep.join(sys.path)
            self.process = subprocess.Popen(command, stdout=log, stderr=log, env=environment)
        while time.monotonic() - began < seconds:
            if self.process.poll() is not None:
                raise RuntimeError(
                    f"the watch ended with {self.process.returncode}; see {log.name}"
                )
            if self.health() is not None:
                return time.monotonic() - began
            time.sleep(0.02)
        raise RuntimeError("the page does not answer")

    def health(self) -> str | None:
        """What the page says of the watch's health; None while it does not answer."""
        try:
            with urllib.request.urlopen(f"{self.address}/health", timeout=5) as answer:
                return str(answer.read().decode())
        except OSError as cause:
            return str(cause) if hasattr(cause, "code") else None

    def kill(self) -> None:
        """End it without warning."""
        assert self.process is not None
        self.process.kill()
        self.process.wait()

    def stop(self) -> int:
        """Its exit code, after it was asked to end."""
        assert self.process is not None
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
        return self.process.wait(60)

    def usage(self) -> dict[str, float]:
        """CPU time [s] and memory [MB] of it and of the processes it started."""
        import psutil

        assert self.process is not None
        parent = psutil.Process(self.process.pid)
        family = [parent, *parent.children(recursive=True)]
        times = [member.cpu_times() for member in family]
        return {
            "cpu_s": sum(item.user + item.system for item in times),
            "memory_mb": sum(member.memory_info().rss for member in family) / 1e6,
        }


def open_history(config: Path) -> Any:
    """The history of a configuration."""
    from swashtwin.monitoring import History, load_watch_config

    watch = load_watch_config(config)
    return History.open(watch.history_url, watch.folder)


class Broker:
    """Mosquitto on a free port, with its sessions in a folder."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.port = free_port()
        self._config = folder / "mosquitto.conf"
        self._config.write_text(
            f"listener {self.port} 127.0.0.1\nallow_anonymous true\n"
            f"persistence true\npersistence_location {folder}/\n"
            f"autosave_interval 1\nmax_queued_messages 0\nuser {os.environ.get('USER', 'root')}\n",
            encoding="utf-8",
        )

    def start(self) -> None:
        """Start it, and wait until it listens."""
        program = shutil.which("mosquitto", path=f"{os.environ['PATH']}:/usr/sbin") or "mosquitto"
        self._process = subprocess.Popen(
            [program, "-c", str(self._config)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        wait_for_port(self.port)

    def stop(self) -> None:
        """End it; what it has is in its file."""
        self._process.terminate()
        self._process.wait(20)


class Database:
    """PostgreSQL on a free port, with its files in a folder of its own."""

    def __init__(self) -> None:
        programs = sorted(
            Path("/usr/lib/postgresql").glob("*/bin"), key=lambda path: int(path.parent.name)
        )[-1]
        self._folder, self.port = Path(tempfile.mkdtemp(prefix="watch-chaos-")), free_port()
        self._user = "postgres" if os.geteuid() == 0 else None
        if self._user is not None:
            shutil.chown(self._folder, self._user)
        self._programs = programs
        self._run(
            "initdb", "-D", "data", "-U", "swashtwin", "-A", "trust", "-E", "UTF8", "--locale=C"
        )
        self.start()
        self._run("createdb", "-h", "127.0.0.1", "-p", str(self.port), "-U", "swashtwin", "history")
        self.url = f"postgresql://swashtwin@127.0.0.1:{self.port}/history"

    def start(self) -> None:
        """Start it, and wait until it answers."""
        options = f"-p {self.port} -c listen_addresses=127.0.0.1 -c unix_socket_directories="
        self._run("pg_ctl", "-D", "data", "-w", "-l", "log", "-o", options, "start")

    def stop(self) -> None:
        """Stop it at once, as by a power cut."""
        self._run("pg_ctl", "-D", "data", "-w", "-m", "immediate", "stop")

    def remove(self) -> None:
        """Stop it, and remove its files."""
        self.stop()
        shutil.rmtree(self._folder, ignore_errors=True)

    def _run(self, program: str, *words: str) -> None:
        command = [str(self._programs / program), *words]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        subprocess.run(command, cwd=self._folder, user=self._user, check=True, timeout=120, **quiet)


def wait_for_port(port: int, seconds: float = 30) -> None:
    """Wait until something listens at a port."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        try:
            socket.create_connection(("127.0.0.1", port), 1).close()
        except OSError:
            time.sleep(0.05)
        else:
            return
    raise RuntimeError(f"nothing listens at {port}")


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
        while (
            not (newest := history.reader.recordings(limit=1))
            or newest[0].file != f"{number:05}.wav"
        ):
            if time.time() - closed > LONGEST:
                raise RuntimeError("no verdict")
            time.sleep(0.01)
        times.append(time.time() - closed)
    history.close()
    watch.stop()
    return {"recordings": count, "median_s": statistics.median(times), "largest_s": max(times)}


def plant(folder: Path) -> dict[str, Any]:
    """CPU time and memory of a plant with one recording a minute of each machine, and how far its
    verdicts lag.
    """
    machines, count = 200, 1000
    names = [f"pump-{number:03}" for number in range(machines)]
    watch = WatchProcess(write_config(folder, names))
    files = [wav(samples(number)) for number in range(20)]
    watch.start()
    before, began, closed = watch.usage(), time.time(), {}
    largest = 0.0
    for number in range(count):
        time.sleep(max(0.0, began + 60 * number / machines - time.time()))
        content = bytearray(files[number % len(files)])
        content[100:104] = number.to_bytes(3, "little") + b"\x3e"
        name = f"{number:06}.wav"
        closed[name] = deliver(
            folder / "incoming" / names[number % machines] / name, bytes(content)
        )
        if number % machines == 0:
            largest = max(largest, watch.usage()["memory_mb"])
    history = open_history(watch.config)
    end = time.time() + LONGEST
    while sum(history.reader.counts().recordings.values()) < count and time.time() < end:
        time.sleep(0.2)
    drained, after = time.time(), watch.usage()
    judged = sum(history.reader.counts().recordings.values())
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


class Deliveries:
    """Delivers recordings by all ways until it is stopped, and remembers their names."""

    def __init__(self, watch: WatchProcess, broker: Broker, inbox: Path) -> None:
        self.names: list[str] = []
        self._watch, self._broker, self._inbox = watch, broker, inbox
        self._stop = threading.Event()
        ways: tuple[Callable[[str, bytes], None], ...] = (
            self._by_folder,
            self._by_broker,
            self._by_upload,
        )
        self._threads = [
            threading.Thread(target=self._run, args=(number, way), daemon=True)
            for number, way in enumerate(ways)
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
        while not self._stop.wait(0.3):
            name = f"{'fmu'[number]}{count:05}.wav"
            way(name, wav(samples(3 * count + number, rate=SLOW, seconds=1.0, channels=1), SLOW))
            self.names.append(name)
            count += 1

    def _by_folder(self, name: str, content: bytes) -> None:
        deliver(self._inbox / "by-folder" / name, content)

    def _by_broker(self, name: str, content: bytes) -> None:
        from paho.mqtt.publish import single

        payload = json.dumps({"file": name}).encode() + b"\n" + content
        while True:
            try:
                single(
                    "plant/by-broker/raw",
                    payload,
                    qos=1,
                    hostname="127.0.0.1",
                    port=self._broker.port,
                )
            except (OSError, ValueError):
                time.sleep(0.2)
            else:
                return

    def _by_upload(self, name: str, content: bytes) -> None:
        url = f"{self._watch.address}/api/recordings?machine=by-upload"
        while True:
            head = (
                "--part-of-kills\r\n"
                f'Content-Disposition: form-data; name="file"; filename="{name}"\r\n\r\n'
            )
            body = head.encode() + content + b"\r\n--part-of-kills--\r\n"
            headers = {"Content-Type": "multipart/form-data; boundary=part-of-kills"}
            request = urllib.request.Request(url, body, headers)
            try:
                with urllib.request.urlopen(request, timeout=10) as answer:
                    if answer.status == 202:
                        return
            except OSError:
                time.sleep(0.2)


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


def write_killed_config(folder: Path, database: str, broker_port: int) -> Path:
    """Configuration of a watch with a source of each kind, which keeps few waveforms."""
    text = '[[source]]\nkind = "mqtt"\nhost = "127.0.0.1"\n'
    text += f'port = {broker_port}\ntopic = "plant/+/raw"\n'
    text += "[retention]\nper_day = 1\nlatest = 5\nalarms = 5\n"
    machines = ["by-folder", "by-broker", "by-upload"]
    return write_config(folder, machines, text=text, history=database, data="disk/data")


def torment(folder: Path, kills: int, is_small: bool) -> dict[str, Any]:
    """What became of the recordings."""
    moments, events = random.Random(0), Counter[str]()
    database, broker = Database(), Broker(folder / "broker")
    broker.start()
    config = write_killed_config(folder, database.url, broker.port)
    watch = WatchProcess(config)
    deliveries = Deliveries(watch, broker, folder / "incoming")
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
        watch.start()
        print(
            f"{number + 1} of {kills}: {dict(events)}, {len(deliveries.names)} delivered",
            file=sys.stderr,
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


def settle(
    history: Any, names: list[str], events: Counter[str], seconds: float = 300.0
) -> dict[str, Any]:
    """Recordings that are lost or doubled once all were judged, or after some time."""
    end = time.monotonic() + seconds
    missing: set[str] = set(names)
    while missing and time.monotonic() < end:
        counts = Counter(item.file for item in history.reader.recordings(limit=1_000_000))
        missing = set(names) - counts.keys()
        time.sleep(0.5)
    rejections = Counter(item.reason for item in history.reader.rejections(limit=10_000))
    return {
        **events,
        "delivered": len(names),
        "lost": sorted(missing)[:10],
        "lost_count": len(missing),
        "twice": sum(count - 1 for count in counts.values()),
        "rejections": dict(rejections),
        "states": dict(Counter(item.state for item in history.reader.recordings(limit=1_000_000))),
    }


def kills(folder: Path, count: int = 50) -> dict[str, Any]:
    """What became of the recordings of a watch that was killed so often."""
    with small_disk(folder / "disk") as is_small:
        return torment(folder, count, is_small)


def blind(folder: Path) -> dict[str, Any]:
    """What the watch makes of plants that deliver nothing usable."""
    from watch_plants import PLANTS, watch_plant

    def learned_points(config: Path) -> set[str]:
        history = open_history(config)
        try:
            return {point.name for point in history.reader.operating_points("pump-1")}
        finally:
            history.close()

    return {
        name: watch_plant(folder / str(number), plant, learned_points)
        for number, (name, plant) in enumerate(PLANTS.items())
    }


def healthy(folder: Path, machines: int = 20, count: int = 260) -> dict[str, Any]:
    """How many alarms healthy machines raise, of the pump, of a sensor and of deliveries."""
    names = [f"pump-{number:02}" for number in range(machines)]
    config = write_config(folder, names)
    start = time.time() - count * 86_400
    for number in range(count):
        for index, name in enumerate(names):
            values = samples(number * machines + index, rate=SLOW, seconds=1.0, channels=2)
            path = folder / "incoming" / name / f"{number:04}.wav"
            deliver(path, wav(values, SLOW))
            # Sources deliver in parallel, so some recordings come a few minutes late.
            moment = start + number * 300 - 200 * (number % 7 == 0)
            os.utime(path, (moment, moment))
    command = [sys.executable, "-m", "swashtwin", "watch", "run", str(config), "--once", "--json"]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    answer = subprocess.run(command, env=environment, check=True, capture_output=True, text=True)
    problems = json.loads(answer.stdout.splitlines()[-1])["problems"]

    history = open_history(config)
    states = Counter[str]()
    for (_, state), recordings in history.reader.recordings_by_state().items():
        states[state] += recordings
    result = {
        "states": dict(states),
        "alarms": dict(Counter(alarm.kind for alarm in history.reader.alarms(limit=10_000))),
        "rejections": dict(Counter(row.reason for row in history.reader.rejections(limit=10_000))),
        "problems": problems,
    }
    history.close()
    return result


QUESTIONS: dict[str, Callable[..., dict[str, Any]]] = {
    "start": start,
    "latency": latency,
    "plant": plant,
    "kills": kills,
    "blind": blind,
    "healthy": healthy,
}


def main() -> None:
    """Answer the questions that are named."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("questions", nargs="+", choices=QUESTIONS)
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--json", action="store_true", help="print JSON")
    options = parser.parse_args()
    sizes = {"kills": {"count": options.kills}}
    with tempfile.TemporaryDirectory() as folder:
        for question in options.questions:
            answer = QUESTIONS[question](Path(folder) / question, **sizes.get(question, {}))
            print(
                json.dumps({question: answer}) if options.json else f"{question}: {answer}",
                flush=True,
            )


if __name__ == "__main__":
    main()
