"""A plant for the benchmarks of the watch: recordings of humming pumps, a configuration, and a watch as a process."""

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import psutil

RATE, SECONDS, CHANNELS = 25_600.0, 4.0, ("x", "y", "z")


def samples(seed: int, *, rate: float = RATE, seconds: float = SECONDS, channels: int = 3) -> np.ndarray:
    """Vibration of a pump at 1500 rpm (channel, time), float32 [m/s^2]; each seed gives another one."""
    random = np.random.default_rng(seed)
    moments = np.arange(int(rate * seconds)) / rate
    tone = sum(np.sin(2 * np.pi * 225 * order * moments + random.uniform(0, 6)) / order for order in range(1, 6))
    noise = random.standard_normal((channels, moments.size), np.float32)
    return (noise + np.asarray(tone, np.float32)).astype(np.float32)


def wav(values: np.ndarray, rate: float = RATE) -> bytes:
    """A float32 WAV file of samples (channel, time)."""
    data = np.ascontiguousarray(values.T, "<f4").tobytes()
    count = values.shape[0]
    fields = (3).to_bytes(2, "little") + count.to_bytes(2, "little") + int(rate).to_bytes(4, "little")
    fields += (
        (int(rate) * count * 4).to_bytes(4, "little") + (count * 4).to_bytes(2, "little") + (32).to_bytes(2, "little")
    )
    chunks = b"fmt " + (16).to_bytes(4, "little") + fields + b"data" + len(data).to_bytes(4, "little") + data
    return b"RIFF" + (4 + len(chunks)).to_bytes(4, "little") + b"WAVE" + chunks


def message(values: np.ndarray, rate: float = RATE, **facts: Any) -> bytes:
    """A message of a broker with samples (channel, time)."""
    header = {"rate": f"{rate} Hz", "unit": "m/s^2", "channels": list("xyz"[: len(values)]), **facts}
    return json.dumps(header).encode() + b"\n" + np.ascontiguousarray(values.T, "<f4").tobytes()


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
    """Configuration of a watch of the folder ``incoming`` and of uploads; its page has a free port."""
    (folder / "incoming").mkdir(parents=True, exist_ok=True)
    lines = [f'folder = "{data}"', f'history = "{history}"' if history else ""]
    facts = 'speed = "1500 rpm"\ndischarge_pressure = "15 MPa"\nunit = "m/s^2"'
    lines += [f'[[machine]]\nname = "{name}"\n{facts}' for name in machines]
    lines += ['[[source]]\nkind = "folder"\npath = "incoming"\nremove = true', '[[source]]\nkind = "http"']
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

    def __init__(self, config: Path) -> None:
        self.config = config
        port = int(config.read_text(encoding="utf-8").split("port = ")[1].split()[0])
        self.address = f"http://127.0.0.1:{port}"
        self.process: subprocess.Popen[bytes] | None = None

    def start(self, seconds: float = 120, **variables: str) -> float:
        """Time [s] until the page answers; `variables` are added to the environment."""
        began = time.monotonic()
        with self.config.with_name("log.txt").open("ab") as log:
            command = [sys.executable, "-m", "swashtwin", "watch", str(self.config)]
            environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "PYTHONUNBUFFERED": "1"}
            environment |= variables
            self.process = subprocess.Popen(command, stdout=log, stderr=log, env=environment)
        while time.monotonic() - began < seconds:
            if self.process.poll() is not None:
                raise RuntimeError(f"the watch ended with {self.process.returncode}; see {log.name}")
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
        """CPU time [s] and memory [MB] of it and of the processes it started; its open handles and threads."""
        assert self.process is not None
        parent = psutil.Process(self.process.pid)
        family = [parent, *parent.children(recursive=True)]
        times = [member.cpu_times() for member in family]
        return {
            "cpu_s": sum(item.user + item.system for item in times),
            "memory_mb": sum(member.memory_info().rss for member in family) / 1e6,
            "handles": parent.num_fds(),
            "threads": parent.num_threads(),
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
            f"listener {self.port} 127.0.0.1\nallow_anonymous true\npersistence true\npersistence_location {folder}/\n"
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
        programs = sorted(Path("/usr/lib/postgresql").glob("*/bin"), key=lambda path: int(path.parent.name))[-1]
        self._folder, self.port = Path(tempfile.mkdtemp(prefix="watch-chaos-")), free_port()
        self._user = "postgres" if os.geteuid() == 0 else None
        if self._user is not None:
            shutil.chown(self._folder, self._user)
        self._programs = programs
        self._run("initdb", "-D", "data", "-U", "swashtwin", "-A", "trust", "-E", "UTF8", "--locale=C")
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
        subprocess.run(
            command,
            cwd=self._folder,
            user=self._user,
            check=True,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            timeout=120,
        )


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
