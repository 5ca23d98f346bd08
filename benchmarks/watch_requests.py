"""Hostile requests to the page of a watch: python benchmarks/watch_requests.py [--requests 10000] [--seed 0]

Each is a random mix of paths, methods, headers, bodies, encodings and half-sent requests over real connections, some of
them slow. The page must answer health in between, write nothing outside its folder, show and change nothing without a
login, and keep its memory.
"""

import argparse
import collections
import json
import os
import random
import socket
import subprocess
import sys
import tempfile
import time
import urllib.request
from pathlib import Path

import psutil

SERVER = """
import sys
from pathlib import Path
from swashtwin.monitoring.config import load_watch_config
from swashtwin.monitoring.history import History
from swashtwin.monitoring.page.application import build_app
from swashtwin.monitoring.page.serving import serve_page
config = load_watch_config(Path(sys.argv[1]))
history = History.open("", config.folder)
with history.machine("pump-1") as machine:
    machine.add_event("note", "benchmark", "a secret of the plant")
def upload(path, name, machine, facts):
    raise AssertionError("a stranger's recording was taken")
serve_page(build_app(config, history, upload=upload), "127.0.0.1", config.page.port).run()
"""
PATHS = (
    "/", "/machines/pump-1", "/machines/%2e%2e%2f%2e%2e", "/recordings/1", "/recordings/-1", "/recordings/1e9",
    "/alarms",
    "/alarms/1/acknowledge", "/machines/pump-1/silence", "/machines/pump-1/events", "/login", "/logout", "/language",
    "/static/../users.json", "/static/%2e%2e/%2e%2e/users.json", "/static/page.js", "/api/machines", "/api/recordings",
    "/api/openapi.json", "/api/alarms/1/acknowledge", "/charts/recordings/1", "/charts/machines/pump-1/trend?level=x",
    "/metrics", "/live", "/health", "//evil.example/", "/%00", "/\u00e4", "/?state=%F0%28&page=-1", "/" + "a" * 5000,
)  # fmt: skip
METHODS = ("GET", "POST", "PUT", "DELETE", "HEAD", "OPTIONS", "TRACE", "PATCH", "get", "BREW", "")
BODIES = (
    b"", b"x", b"\0" * 100, b"{" * 5000, b"[" * 50000, b'{"note": 1e999}', b"name=ada&password=" + b"x" * 3000,
    b"form_token=" + b"%" * 500,
    b"--a\r\nContent-Disposition: form-data; name=\"file\"; filename=\"../../x\"\r\n\r\nx\r\n--a--\r\n",
    bytes(range(256)) * 40, b"name=\xff\xfe&password=\xff", b"a=1&" * 5000, os.urandom(70_000),
)  # fmt: skip
TYPES = ("application/json", "application/x-www-form-urlencoded", "multipart/form-data; boundary=a", "text/\x00", "",
         "multipart/form-data", "application/octet-stream", "multipart/form-data; boundary=" + "b" * 300)  # fmt: skip
HOSTS = ("127.0.0.1", "localhost", "evil.example", "", "127.0.0.1:99999999", "[::1", "\u00e4")


def request_of(chance: random.Random, port: int) -> bytes:
    """One hostile request."""
    body = chance.choice(BODIES)
    host = chance.choice(HOSTS) if chance.random() < 0.3 else f"127.0.0.1:{port}"
    lines = [f"{chance.choice(METHODS)} {chance.choice(PATHS)} HTTP/{chance.choice(('1.1', '1.1', '1.0', '9.9'))}"]
    lines.append(f"Host: {host}")
    if chance.random() < 0.8:
        length = len(body) if chance.random() < 0.8 else chance.choice((-1, 0, 10**9, 10**30, "x"))
        lines.append(f"Content-Length: {length}")
    else:
        lines.append("Transfer-Encoding: chunked")
        body = b"%x\r\n%b\r\n0\r\n\r\n" % (len(body), body) if chance.random() < 0.5 else body
    lines.append(f"Content-Type: {chance.choice(TYPES)}")
    for name, values in (
        ("Cookie", ("swashtwin_visit=x", "swashtwin_visit=" + "a" * 4000, "=;=;", "swashtwin_language=xx")),
        ("Authorization", ("Bearer st_x", "Bearer ", "Basic YWRhOmFkYQ==", "Bearer \u00e4")),
        ("Origin", ("null", "http://evil.example", "x", f"http://127.0.0.1:{port}")),
        ("X-File-Name", ("../../etc/cron.d/x", "\u00e4", "a" * 2000)),
        ("Range", ("bytes=0-1", "bytes=-1")),
        ("Accept-Encoding", ("gzip", "br;q=x")),
        ("X-Forwarded-For", ("127.0.0.1", "evil")),
    ):
        if chance.random() < 0.25:
            lines.append(f"{name}: {chance.choice(values)}")
    head = "\r\n".join(lines).encode("utf-8", "surrogatepass") + b"\r\n\r\n"
    whole = head + body
    if chance.random() < 0.1:
        whole = whole[: chance.randrange(len(whole))]
    if chance.random() < 0.05:
        whole = bytes(byte if chance.random() > 0.02 else chance.randrange(256) for byte in whole)
    return whole


def send(port: int, content: bytes) -> bytes:
    """The beginning of the answer; empty where there is none within half a second."""
    with socket.create_connection(("127.0.0.1", port), timeout=0.5) as connection:
        try:
            connection.sendall(content)
            connection.shutdown(socket.SHUT_WR)
            answer = b""
            while len(answer) < 20_000 and (piece := connection.recv(65536)):
                answer += piece
        except OSError:
            pass
        return answer


def health(port: int) -> float:
    """Seconds until the page says that it is well."""
    began = time.perf_counter()
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/health", timeout=30) as answer:
        assert json.load(answer) == {"status": "ok"}
    return time.perf_counter() - began


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--requests", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    chance = random.Random(options.seed)
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with tempfile.TemporaryDirectory() as name:
        run(Path(name), port, chance, options.requests)


def run(folder: Path, port: int, chance: random.Random, count: int) -> None:
    """Start a page in `folder`, send `count` requests to it, and print what came of them."""
    from swashtwin.monitoring.page.security.users import add_user

    add_user(folder / "users.json", "ada", "a long password")
    page = f'[page]\nport = {port}\nusers = "users.json"\n'
    source = '[[source]]\nkind = "http"\n'
    (folder / "watch.toml").write_text(
        f'folder = "data"\n{page}[[machine]]\nname = "pump-1"\n{source}', encoding="utf-8"
    )
    log = (folder / "log.txt").open("w", encoding="utf-8")
    server = subprocess.Popen([sys.executable, "-c", SERVER, str(folder / "watch.toml")], stderr=log)
    try:
        for _ in range(300):
            try:
                health(port)
                break
            except OSError:
                time.sleep(0.1)
        process = psutil.Process(server.pid)
        slow = [socket.create_connection(("127.0.0.1", port)) for _ in range(50)]
        for connection in slow:
            connection.sendall(b"POST /login HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 100\r\n\r\na")
        codes: collections.Counter[str] = collections.Counter()
        slowest, leaks, memory = 0.0, 0, [process.memory_info().rss]
        for number in range(count):
            answer = send(port, request_of(chance, port))
            codes[answer[9:12].decode("latin-1") if answer.startswith(b"HTTP/1.1 ") else "none"] += 1
            leaks += b"a secret of the plant" in answer or b"argon2" in answer or b"Traceback" in answer
            if number % 250 == 0:
                slowest = max(slowest, health(port))
            if number == count // 10:
                memory.append(process.memory_info().rss)
        memory.append(process.memory_info().rss)
        handles = process.num_fds()
        for connection in slow:
            connection.close()
        files = sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())
        print(f"{count} requests, answers by code: {dict(codes.most_common())}")
        print(f"leaks {leaks}, slowest health {slowest:.2f} s, handles {handles} (50 of them slow clients)")
        print("memory [MB] at start, after a tenth, at the end:", *(f"{size / 1e6:.0f}" for size in memory))
        print("files:", *files)
        assert leaks == 0
        assert server.poll() is None
    finally:
        server.terminate()
        server.wait(20)
        log.close()
        lines = (folder / "log.txt").read_text(encoding="utf-8", errors="replace").splitlines()
        errors = collections.Counter(line[:100] for line in lines if line[:1].strip() and "Error" in line)
        print(f"lines in the log: {len(lines)}; errors: {dict(errors.most_common(5))}")


if __name__ == "__main__":
    main()
