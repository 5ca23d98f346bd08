"""Whether a watch stands hostile messages, requests and files at each of its ports.

    python benchmarks/watch_hostile.py --count 10000 --json

Messages and uploads of random sizes, types, names, paths and encodings: bytes that are no JSON, headers with wrong and
huge values, files of every suffix that are garbage, cut off or another format; requests that are malformed, that ask
for paths outside, or that come byte by byte from many clients at once. In the end the watch must judge a sound
recording of each way, its memory must be bounded, no file may stand outside its folder, and nobody without the token
may have read or changed anything.
"""

import argparse
import json
import random
import socket
import tempfile
import threading
import time
import urllib.error
import urllib.request
from collections import Counter
from pathlib import Path
from typing import Any

from watch_plant import Broker, WatchProcess, deliver, message, open_history, samples, wav, write_config

RATE = 5120.0
SUFFIXES = (".wav", ".h5", ".csv", ".txt", ".mat", ".npz", ".parquet", ".tdms", ".uff", ".mf4", ".exe", "", ".json")
NAMES = (
    "../../escaped", "/etc/escaped", "..\\..\\escaped", "a\x00b", "con", "x" * 3000, "\u202egpj", "%2e%2e%2fescaped",
    "{{7*7}}", "<script>alert(1)</script>", "'; DROP TABLE recordings; --", "pump-1", "\U0001f600", "", " ", ".", "-rf",
)  # fmt: skip
VALUES = (
    None, True, 0, -1, 1e308, 10**40, [], {}, [[[]]], "", "1e999 Hz", "25600", "0 Hz", "-5 rpm", "nan rpm", "5 furlong",
    "9" * 1999, "x,y", ["x"] * 5000, "1970-01-01", "9999-12-31T23:59:59Z", "2026-13-45", "\u0000", "1 Hz * 2",
)  # fmt: skip
PATHS = (
    "/", "/alarms", "/api/recordings", "/api/machines", "/../../etc/passwd", "/static/../../../etc/passwd",
    "/%2e%2e/%2e%2e", "/recordings/-1", "/recordings/99999999999999999999", "/machines/%00", "/machines/" + "a" * 5000,
    "/alarms/1/acknowledge", "/api/alarms/1/acknowledge", "/metrics", "/health", "/openapi.json",
    "/api/recordings?limit=-1&since=x", "/\u00e9\U0001f600",
)  # fmt: skip


class Attacker:
    """Makes hostile things from a seed."""

    def __init__(self, seed: int) -> None:
        self._random = random.Random(seed)
        self._sound = wav(samples(seed, rate=RATE, seconds=0.5, channels=1), RATE)

    def message(self) -> bytes:
        """A message of the broker."""
        pick = self._random
        kind = pick.randrange(6)
        if kind == 0:
            return pick.randbytes(int(10 ** pick.uniform(0, 5)))
        if kind == 1:
            return b"[" * pick.randrange(1, 60_000) + b"\n" + pick.randbytes(100)
        header: dict[str, Any] = {"rate": f"{RATE} Hz", "unit": "m/s^2", "channels": ["x", "y"], "machine": "pump-1"}
        for _ in range(pick.randrange(3)):
            key = pick.choice((*header, "speed", "pressure", "time", "temperature", "file", "__class__"))
            header[key] = pick.choice((*VALUES, *NAMES))
        if kind == 2:
            header = {"file": self.name(), "machine": pick.choice(("pump-1", *NAMES))}
            return json.dumps(header).encode("utf-8", "replace") + b"\n" + self.content()
        return json.dumps(header).encode("utf-8", "replace") + b"\n" + pick.randbytes(pick.randrange(5000))

    def name(self) -> str:
        """A name of a file."""
        return self._random.choice((*NAMES, "a")) + self._random.choice(SUFFIXES)

    def content(self) -> bytes:
        """What a file holds."""
        pick, data = self._random, bytearray(self._sound)
        kind = pick.randrange(5)
        if kind == 0:
            return pick.randbytes(pick.randrange(5000))
        if kind == 1:
            return bytes(data[: pick.randrange(len(data))])
        if kind == 2:
            for _ in range(20):
                data[pick.randrange(60)] = pick.randrange(256)
            return bytes(data)
        if kind == 3:
            return b"time;x\n" + b"\n".join(pick.randbytes(20).hex().encode() for _ in range(200))
        return bytes(pick.randrange(5000))

    def request(self, port: int, token: str) -> str:
        """What the page answers to a request: its status, or what became of the connection."""
        pick = self._random
        kind = pick.randrange(6)
        if kind == 0:
            return raw_request(port, pick.randbytes(pick.randrange(1, 2000)))
        if kind == 1:
            lines = [f"POST /api/recordings HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nContent-Length: "]
            lines.append(str(pick.choice((-1, 0, 10**12, "x", 5))) + "\r\n\r\nab")
            return raw_request(port, "".join(lines).encode())
        if kind == 2:
            host = pick.choice(("evil.example", "", "127.0.0.1:1", "x" * 9000))
            return raw_request(
                port, f"GET {pick.choice(PATHS)} HTTP/1.1\r\nHost: {host}\r\n\r\n".encode("utf-8", "replace")
            )
        if kind == 3:
            path = pick.choice(PATHS)
            method = pick.choice(("GET", "POST", "PUT", "DELETE", "OPTIONS"))
            return raw_request(
                port, f"{method} {path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n".encode("utf-8", "replace")
            )
        facts = {pick.choice(("machine", "speed", "pressure", "rate", "unit", "time")): str(pick.choice(VALUES))[:3000]}
        boundary = pick.choice(("b", "--", "x" * 200))
        fields = "".join(
            f'--{boundary}\r\nContent-Disposition: form-data; name="{k}"\r\n\r\n{v}\r\n' for k, v in facts.items()
        )
        name = self.name().replace('"', "").replace("\r", "").replace("\n", "").replace("\x00", "")
        form = f'{fields}--{boundary}\r\nContent-Disposition: form-data; name="file"; filename="{name}"\r\n\r\n'
        body = form.encode("utf-8", "replace") + self.content() + f"\r\n--{boundary}--\r\n".encode()
        headers = {"Content-Type": f"multipart/form-data; boundary={boundary}"}
        if pick.random() < 0.8:
            headers["Authorization"] = f"Bearer {token}"
        request = urllib.request.Request(f"http://127.0.0.1:{port}/api/recordings", body, headers)
        return answer_to(request)


def raw_request(port: int, data: bytes) -> str:
    """Status that the page answers to bytes, or what became of the connection."""
    try:
        with socket.create_connection(("127.0.0.1", port), 20) as connection:
            connection.sendall(data)
            connection.shutdown(socket.SHUT_WR)
            answer = connection.recv(4096)
    except OSError as cause:
        return type(cause).__name__
    return answer.split(b" ")[1].decode("ascii", "replace") if answer.startswith(b"HTTP/") else "closed"


def answer_to(request: urllib.request.Request) -> str:
    """Status of the answer to a request."""
    try:
        with urllib.request.urlopen(request, timeout=30) as answer:
            return str(answer.status)
    except urllib.error.HTTPError as cause:
        return str(cause.code)
    except OSError as cause:
        return type(cause).__name__


def slow_clients(port: int, count: int, stop: threading.Event) -> list[threading.Thread]:
    """Clients that send an upload byte by byte."""

    def crawl() -> None:
        while not stop.is_set():
            try:
                with socket.create_connection(("127.0.0.1", port), 20) as connection:
                    head = f"POST /api/recordings HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nContent-Length: 1000000\r\n\r\n"
                    for byte in head.encode():
                        connection.sendall(bytes([byte]))
                        if stop.wait(0.5):
                            return
            except OSError:
                stop.wait(0.5)

    threads = [threading.Thread(target=crawl, daemon=True) for _ in range(count)]
    for thread in threads:
        thread.start()
    return threads


def attack(folder: Path, count: int, seed: int) -> dict[str, Any]:
    """What became of the watch."""
    from paho.mqtt.publish import multiple

    from swashtwin.monitoring import add_token

    (folder / "plant").mkdir(parents=True)
    (folder / "secret.txt").write_text("secret", encoding="utf-8")
    broker = Broker(folder / "broker")
    broker.start()
    text = 'tokens = "users.json"\n[[source]]\nkind = "mqtt"\nhost = "127.0.0.1"\ntopic = "plant/+/raw"\n'
    text += f"port = {broker.port}\n"
    config = write_config(folder / "plant", ["pump-1", "pump-2"], text=text)
    token = add_token(folder / "plant" / "users.json", "uploader")
    watch = WatchProcess(config)
    watch.start()
    before = {path for path in folder.rglob("*") if "data" not in path.parts and "broker" not in path.parts}
    port, stop = int(watch.address.rsplit(":", 1)[1]), threading.Event()
    threads = slow_clients(port, 50, stop)
    attacker, answers, largest, history = Attacker(seed), Counter[str](), 0.0, open_history(config)
    for number in range(0, count, 100):
        payloads = [
            (f"plant/pump-{attacker._random.randrange(4)}/raw", attacker.message(), 1, False) for _ in range(50)
        ]
        multiple(payloads, hostname="127.0.0.1", port=broker.port)
        answers.update(attacker.request(port, token) for _ in range(50))
        deliver(
            folder / "plant" / "incoming" / "pump-1" / f"{number}{attacker._random.choice(SUFFIXES)}",
            attacker.content(),
        )
        usage = watch.usage()
        largest = max(largest, usage["memory_mb"])
    content = wav(samples(10**6, rate=RATE, seconds=1.0, channels=1), RATE)
    deliver(folder / "plant" / "incoming" / "pump-2" / "sound-file.wav", content)
    payload = message(samples(10**6 + 1, rate=RATE, seconds=1.0, channels=1), RATE, channels=["channel_0"])
    multiple([("plant/pump-2/raw", payload, 1, False)], hostname="127.0.0.1", port=broker.port)
    names: set[str] = set()
    end = time.monotonic() + 600
    while not {"sound-file.wav", "message.f32"} <= names and time.monotonic() < end:
        names = {item.file for item in history.read.recordings("pump-2", limit=1000)}
        time.sleep(0.5)
    stop.set()
    for thread in threads:
        thread.join(5)
    after = {path for path in folder.rglob("*") if "data" not in path.parts and "broker" not in path.parts}
    incoming = folder / "plant" / "incoming"
    result = {
        "messages": count // 2,
        "requests": count // 2,
        "answers": dict(sorted(answers.items())),
        "read_without_token": answer_to(urllib.request.Request(f"{watch.address}/api/recordings")),
        "sound_recordings_judged": sorted(names & {"sound-file.wav", "message.f32"}),
        "largest_memory_mb": largest,
        "files_outside": sorted(
            str(path) for path in after - before if incoming not in path.parents and path != incoming
        ),
        "rejections": dict(Counter(item.reason for item in history.read.rejections(limit=100_000))),
        "errors": sorted({item.detail for item in history.read.rejections(limit=100_000) if item.reason == "error"})[
            :9
        ],
        "judged": dict(Counter(item.state for item in history.read.recordings(limit=100_000))),
        "usage": watch.usage(),
    }
    history.close()
    result["exit_code"] = watch.stop()
    broker.stop()
    return result


def main() -> None:
    """Attack a watch, and print what became of it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=10_000, help="messages and requests together")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        result = attack(Path(folder), options.count, options.seed)
    print(json.dumps(result) if options.json else result)


if __name__ == "__main__":
    main()
