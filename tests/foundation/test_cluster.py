"""Batch work on a Dask cluster: refused early with one sentence, and with the bits of one process."""

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from commandline import FACTS, run, write_tones

from swashtwin.cli import signal as signal_commands
from swashtwin.foundation import ClusterError, DataError, cluster, parallel, processes, use_cluster

PARENT = os.getpid()


def square(number: int) -> int:
    return number * number


def scale(factors: np.ndarray, number: int) -> np.ndarray:
    return np.sin(factors) * number


def kill_first_worker(marker: Path, number: int) -> int:
    """Return the number; the first worker that works on number 5 is killed."""
    if number == 5:
        try:
            os.close(os.open(marker, os.O_CREAT | os.O_EXCL))
        except FileExistsError:
            return number
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def kill_worker(number: int) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def refuse(number: int) -> None:
    raise DataError(f"file {number} is damaged.", field="unit")


def look_up(number: int) -> str:
    return {}[number]  # type: ignore[no-any-return]


def wait(seconds: float) -> float:
    time.sleep(seconds)
    return seconds


def count_page_faults() -> int:
    """Return the page faults of an array of 8 MB just after another one was freed."""
    import resource

    np.ones(1_000_000)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    np.ones(1_000_000)
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before


def describe_process() -> tuple[int, bool]:
    """Return the process, and whether it ends with its parent."""
    import threading

    watched = any("_end_after" in thread.name for thread in threading.enumerate())
    return os.getpid(), watched


# ---- without a cluster


@pytest.mark.parametrize("address", ["10.0.0.5:8786", "tcp://host", "http://host:8786", "tcp://:1"])
def test_an_address_that_is_none_is_refused_before_dask_is_loaded(address: str) -> None:
    with (
        pytest.raises(ClusterError, match=r"must be tcp://HOST:PORT, such as") as refusal,
        use_cluster(address),
    ):
        pass
    assert refusal.value.field == "cluster"


def test_the_shell_names_the_option(tmp_path: Path) -> None:
    write_tones(tmp_path, 1)
    files = sorted(tmp_path.glob("*.csv"))
    answer = run("signal", "features", *files, *FACTS, "--cluster", "10.0.0.5:8786", code=3)
    assert "error: Invalid address of a cluster '10.0.0.5:8786'" in answer.stderr
    assert answer.stderr.rstrip().endswith("(--cluster)")


def test_finished_indicators_stay_if_the_cluster_is_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_tones(tmp_path, 1)
    files = sorted(tmp_path.glob("*.csv"))
    describe = signal_commands._describe_recording
    described = []

    def describe_until_lost(*arguments: Any) -> Any:
        described.append(arguments[-1].recording_id)
        if len(described) == 2:
            raise ClusterError("The Dask scheduler is gone.", field="cluster")
        return describe(*arguments)

    monkeypatch.setattr(signal_commands, "_describe_recording", describe_until_lost)
    command = ("signal", "features", *files, *FACTS, "--out", tmp_path / "out.csv")
    run(*command, code=3)
    assert (tmp_path / "out.csv.partial").exists()
    run(*command)
    assert described == ["normal_1", "piston_1", "piston_1"]


def test_without_an_address_this_computer_works() -> None:
    with use_cluster(None):
        assert list(parallel(square, [(2,), (3,)])) == [4, 9]


def test_a_case_is_computed_when_it_is_needed() -> None:
    results = parallel(square, [(2,), ("text",)])
    assert next(results) == 4
    with pytest.raises(TypeError):
        next(results)


class StubClient:
    """A client of Dask that runs each task at once, on workers with the given environments."""

    status = "running"

    class scheduler:
        address = "tcp://10.0.0.5:8786"

    def __init__(self, **environments: Any) -> None:
        self.environments = environments

    def run(self, function: Any, *arguments: Any, **options: Any) -> dict[str, Any]:
        if function is cluster._describe_environment:
            return self.environments
        return {worker: function(*arguments) for worker in self.environments}


def environment(**changes: str) -> dict[str, str]:
    return {**cluster._describe_environment(), "threads": "1", **changes}


def test_workers_like_this_computer_are_accepted() -> None:
    assert cluster._require_workers(StubClient(a=environment(), b=environment())) == 2


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (
            environment(swashtwin="0.0.1"),
            r"^Worker b has swashtwin 0\.0\.1, and this computer .*pip install",
        ),
        (environment(numpy="1.0"), r"^Worker b has numpy 1\.0, .*results could differ"),
        (
            environment(Python="2.7"),
            r"^Worker b has Python 2\.7, .*Install the same version there, and",
        ),
        (environment(threads="8"), r"^Worker b has 8 threads, .*again with one thread \("),
        (ModuleNotFoundError("x", name="swashtwin"), r"^Worker b has no swashtwin\. .*pip install"),
    ],
)
def test_a_worker_with_another_environment_is_refused(answer: Any, message: str) -> None:
    with pytest.raises(ClusterError, match=message):
        cluster._require_workers(StubClient(a=environment(), b=answer))


def test_a_worker_that_comes_during_the_work_is_checked(monkeypatch: pytest.MonkeyPatch) -> None:
    distributed = pytest.importorskip("distributed")
    pickle = pytest.importorskip("distributed.protocol.pickle")
    worker = SimpleNamespace(address="late", state=SimpleNamespace(nthreads=1))
    monkeypatch.setattr(distributed, "get_worker", lambda: worker)
    expected = cluster._describe_environment()
    task = (square, pickle.dumps((3,)), None)
    assert pickle.loads(cluster._run_task(*task, expected)) == 9

    with pytest.raises(ClusterError, match=r"^Worker late has .*results could differ"):
        cluster._run_task(*task, {**expected, "numpy": "1.0"})
    worker.state.nthreads = 2
    with pytest.raises(ClusterError, match=r"^Worker late has 2 threads"):
        cluster._run_task(*task, expected)


def test_a_cluster_without_workers_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "_WORKER_TIMEOUT_S", 0.0)
    with pytest.raises(ClusterError, match=r"5:8786 has had no worker for .*of one thread"):
        cluster._require_workers(StubClient())


def test_a_file_that_a_worker_does_not_see_is_named(tmp_path: Path, monkeypatch: Any) -> None:
    file = tmp_path / "a.csv"
    file.write_text("1")
    client = StubClient(a=environment())
    cluster._require_visible(client, [file, None], tmp_path / "out")

    # the other computer has another file there
    monkeypatch.setattr(cluster, "_find_invisible", lambda sizes: next(iter(sizes)))
    with pytest.raises(ClusterError, match=rf"^Worker a does not see {file} .*the same path"):
        cluster._require_visible(client, [file], None)
    with pytest.raises(ClusterError, match=rf"^Worker a does not see {tmp_path}/out as"):
        cluster._require_visible(client, [], tmp_path / "out")
    assert os.listdir(tmp_path / "out") == []


def test_the_ambient_backend_of_joblib_is_used(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    from joblib import parallel_config

    calls = []
    monkeypatch.setattr(
        processes, "run_on_cluster", lambda *arguments: calls.append(arguments) or []
    )
    client = StubClient()
    client.loop = None  # type: ignore[attr-defined]
    assert cluster.ambient_client() is None
    with parallel_config("threading"):
        assert cluster.ambient_client() is None
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("joblib._dask.as_completed", lambda *_, **__: None)
        with parallel_config("dask", client=client):
            assert list(parallel(square, [(2,)], jobs=2)) == []
    assert calls == [(client, square, [(2,)], (), None)]


# ---- with one


def free_port() -> int:
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        return int(server.getsockname()[1])


class RealCluster:
    """A scheduler and two workers, each a process that its nanny starts again if it dies."""

    def __init__(self) -> None:
        self.address = f"tcp://127.0.0.1:{free_port()}"
        self.processes: list[subprocess.Popen[bytes]] = []

    def start(self, *command: str) -> "subprocess.Popen[bytes]":
        process = subprocess.Popen(
            [
                sys.executable,
                "-m",
                f"distributed.cli.dask_{command[0]}",
                *command[1:],
                "--no-dashboard",
            ],
            env={**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        self.processes.append(process)
        return process

    def start_scheduler(self) -> "subprocess.Popen[bytes]":
        host, port = self.address.removeprefix("tcp://").split(":")
        return self.start("scheduler", "--host", host, "--port", port)

    def start_worker(self) -> "subprocess.Popen[bytes]":
        return self.start("worker", self.address, "--nthreads", "1")

    def stop(self) -> None:
        # the scheduler last: workers that lose it try to connect for a while
        for process in reversed(self.processes):
            process.terminate()
        for process in self.processes:
            try:
                process.wait(5)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


@pytest.fixture
def real_cluster(monkeypatch: pytest.MonkeyPatch) -> Iterator[RealCluster]:
    pytest.importorskip("distributed")
    # for a busy machine
    monkeypatch.setattr(cluster, "_ANSWER_TIMEOUT_S", 100.0)
    monkeypatch.setattr(cluster, "_WORKER_TIMEOUT_S", 200.0)
    started = RealCluster()
    started.start_scheduler()
    for _ in range(2):
        started.start_worker()
    yield started
    started.stop()


@pytest.mark.nightly
@pytest.mark.filterwarnings("default")  # of Dask's own connections, as they end
def test_a_cluster_has_the_bits_of_one_process(real_cluster: RealCluster, tmp_path: Path) -> None:
    factors = np.linspace(0, 9, 300_000)
    cases = [(number,) for number in range(40)]
    expected = list(parallel(partial(scale, factors), cases))

    with use_cluster(real_cluster.address):
        results = list(parallel(partial(scale, factors), cases))
        assert all(np.array_equal(*pair) for pair in zip(results, expected, strict=True))

        # a worker that dies is replaced
        marker = tmp_path / "killed"
        assert list(parallel(partial(kill_first_worker, marker), cases)) == [n for (n,) in cases]
        assert marker.exists()

        # work is done elsewhere, by processes that do not end with a parent
        seen = set(parallel(describe_process, [()] * 20))
        assert PARENT not in {pid for pid, _ in seen}
        assert not any(watched for _, watched in seen)

        # a failure names its file
        files = [tmp_path / "a.csv", tmp_path / "b.csv"]
        for file in files:
            file.write_text("1")
        with pytest.raises(DataError, match=r"^file 1 is damaged") as refusal:
            list(parallel(refuse, [(1,), (2,)], files=files))
        assert refusal.value.field == "unit"
        with pytest.raises(RuntimeError, match=r"a\.csv: KeyError: 1"):
            list(parallel(look_up, [(1,), (2,)], files=files))
        with pytest.raises(ClusterError, match=r"a\.csv: each worker that ran its task died"):
            list(parallel(kill_worker, [(1,)], files=files))

        # memory is kept, though Dask returns it (2,000 pages of 4 kB)
        assert max(parallel(count_page_faults, [()] * 20)) < 100

        # and work goes on
        assert list(parallel(square, cases)) == [n * n for (n,) in cases]


@pytest.mark.nightly
@pytest.mark.filterwarnings("default")
def test_indicators_on_a_cluster_are_those_of_this_computer(
    real_cluster: RealCluster, tmp_path: Path
) -> None:
    tones = write_tones(tmp_path / "tones", 3)
    run("index", tones, *FACTS)
    here, there = tmp_path / "here.csv", tmp_path / "there.csv"

    run("signal", "features", tones, "--out", here)
    run("signal", "features", tones, "--out", there, "--cluster", real_cluster.address)
    assert there.read_bytes() == here.read_bytes()
    assert not list(tmp_path.glob("*.partial"))


@pytest.mark.nightly
@pytest.mark.filterwarnings("default")
def test_a_scheduler_that_ends_during_work_is_an_error(real_cluster: RealCluster) -> None:
    with use_cluster(real_cluster.address):
        results = parallel(wait, [(0.5,)] * 40)
        next(results)
        real_cluster.processes[0].kill()
        with pytest.raises(ClusterError, match="is gone or does not answer"):
            list(results)


@pytest.mark.nightly
@pytest.mark.filterwarnings("default")
def test_a_server_that_is_no_scheduler_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr(cluster, "_ANSWER_TIMEOUT_S", 2.0)
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        server.listen()
        address = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        with pytest.raises(ClusterError, match="No Dask scheduler answers"), use_cluster(address):
            pass
