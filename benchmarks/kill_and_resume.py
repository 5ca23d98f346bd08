"""Kill commands at random moments, run them again to the end, and compare with what an undisturbed run leaves.

    python benchmarks/kill_and_resume.py --count 50

The commands are rig, convert, train, calibrate and study, all on tiny data. Half of the kills strike while a file is
being written. The same command then runs again, and is killed again, up to five times, before it may end. All files
must then equal those of the undisturbed run byte by byte, but for times of day and durations; no other file may be left
in the folder or among the temporary files, and no process may live longer than twenty seconds after a kill. The last is
asked where the system lists processes in /proc.
"""

import argparse
import json
import multiprocessing
import os
import re
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from multiprocessing.context import BaseContext
from multiprocessing.process import BaseProcess
from pathlib import Path

import numpy as np

KILLS_IN_A_ROW = 5
PATIENCE = 1200.0
"""Seconds that a tiny command may take, on a machine that is busy with other work too."""
LONGEST_LIFE = 20.0
"""Seconds within which the workers of a killed command must end; one that just starts must first import much."""

COMMANDS: Mapping[str, Callable[[Path], str]] = {
    "rig": lambda rig: "bench rig rig",
    "convert": lambda rig: f"data convert {rig} --out store.h5 --overwrite",
    "train": lambda rig: (
        f"train {rig} --network bitcn --set epochs=12 --set stride=32 --set channels=8,8 --out model.safetensors "
        "--checkpoint training --resume"
    ),
    "calibrate": lambda rig: (
        f"calibrate {rig} --method direct-adam --set epochs=120 --nuisances none --no-phases --out calibration.json "
        "--resume"
    ),
    "study": lambda rig: (
        "bench case1 --rig --out out --jobs 2 --classifiers extra_trees --training-sets measured,calibrated"
    ),
}
"""Each command, for the folder of a rig."""

_VOLATILE = re.compile(
    rb'"(wall_s|cpu_s|command)": ("[^"]*"|[\d.e+-]+|\{[^}]*\})|[\d.,]+ (ms|s|min|h)\b|took [^<.]*|date="[^"]*"|'
    rb'swashtwin [^<"]*'
)
"""What may differ between two undisturbed runs: durations, and the command line with its folders."""

_PRELOADED = (
    "swashtwin.cli.app", "torch", "scipy.signal", "scipy.optimize", "h5py", "sklearn.ensemble", "matplotlib.figure",
    "swashtwin.bench.rigs.writing", "swashtwin.bench.studies.runner", "swashtwin.bench.studies.cases",
    "swashtwin.learning.training.loop", "swashtwin.recordings.store", "swashtwin.calibration.procedure",
)  # fmt: skip


@dataclass
class Row:
    """What came of the kills of one command."""

    command: str
    kills: int = 0
    while_writing: int = 0
    """Kills that left a half-written file."""
    finished: int = 0
    """Runs that ended after kills."""
    refused: list[str] = field(default_factory=list)
    """What was said by runs that would not go on."""
    different: list[str] = field(default_factory=list)
    """Files that differ from those of the undisturbed run, or are not there."""
    left_behind: list[str] = field(default_factory=list)
    """Files that an undisturbed run does not leave."""
    alive: int | None = None
    """Processes that outlived a kill by twenty seconds; None where the system does not list them."""
    seconds: float = 0.0

    @property
    def is_sound(self) -> bool:
        """Whether nothing went wrong."""
        return not (self.refused or self.different or self.left_behind or self.alive)


def kill_and_resume(
    count: int, seed: int, commands: tuple[str, ...] = tuple(COMMANDS), recordings: Path | None = None
) -> list[Row]:
    """Results of at least `count` kills, dealt evenly to the commands.

    Parameters
    ----------
    seed : of the moments.
    recordings : folder with an index, which convert, train and calibrate read; by default a tiny rig.
    """
    context = multiprocessing.get_context("spawn" if os.name == "nt" else "forkserver")
    if os.name != "nt":
        context.set_forkserver_preload(list(_PRELOADED))
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        if recordings is None:
            recordings = Path(folder) / "given" / "rig"
            _finish(context, "bench rig rig", recordings.parent)
        for number, name in enumerate(commands):
            kills = -(-(count - sum(row.kills for row in rows)) // (len(commands) - number))
            generator = np.random.default_rng([seed, number])
            rows.append(_kill_command(context, name, COMMANDS[name](recordings), kills, generator, Path(folder) / name))
    return rows


def _kill_command(
    context: BaseContext, name: str, words: str, kills: int, generator: np.random.Generator, folder: Path
) -> Row:
    row, started = Row(name), time.monotonic()
    duration = _finish(context, words, folder / "whole")
    expected = _contents(folder / "whole")
    while row.kills < kills:
        killed = folder / f"killed-{row.kills}"
        for _ in range(min(KILLS_IN_A_ROW, kills - row.kills)):
            while_writing = generator.random() < 0.5
            if not _kill(context, words, killed, duration * generator.uniform(0.02, 0.9), while_writing):
                break
            row.kills += 1
            row.while_writing += any(killed.rglob(".swashtwin-*.part*"))
            if (alive := _survivors(killed)) is not None:
                row.alive = (row.alive or 0) + alive
        try:
            _finish(context, words, killed)
        except RuntimeError as refusal:
            row.refused.append(str(refusal))
            continue
        row.finished += 1
        contents = _contents(killed)
        row.different += [
            f"{file}: {_difference(expected[file], contents.get(file, b''))}"
            for file in expected
            if contents.get(file) != expected[file]
        ]
        row.left_behind += [file for file in contents if file not in expected]
        shutil.rmtree(killed)
    row.seconds = round(time.monotonic() - started, 1)
    return row


def _finish(context: BaseContext, words: str, folder: Path) -> float:
    """Seconds that an undisturbed run took."""
    started = time.monotonic()
    with _started(context, words, folder) as process:
        process.join(PATIENCE)
        if process.exitcode != 0:
            lines = (folder.parent / f"{folder.name}.log").read_text(encoding="utf-8").splitlines()
            raise RuntimeError(f"exit code {process.exitcode}: {(lines or [''])[-1]}")
    return time.monotonic() - started


def _kill(context: BaseContext, words: str, folder: Path, seconds: float, while_writing: bool) -> bool:
    """Whether a run was killed; it may have ended before."""
    with _started(context, words, folder) as process:
        process.join(seconds)
        if while_writing:
            while process.is_alive() and not any(folder.rglob(".swashtwin-*.part*")):
                time.sleep(0.001)
        if not process.is_alive():
            return False
        process.kill()
        process.join()
    return True


@contextmanager
def _started(context: BaseContext, words: str, folder: Path) -> Iterator[BaseProcess]:
    (folder / "temporary").mkdir(parents=True, exist_ok=True)
    process = context.Process(target=partial(_run, words, folder))  # type: ignore[attr-defined]
    process.start()
    try:
        yield process
    finally:
        process.kill()
        process.join()
        process.close()


def _run(words: str, folder: Path) -> None:
    """Run a command in `folder`."""
    os.chdir(folder)
    os.environ["SWASHTWIN_KILLED"] = str(folder)
    os.environ["TMPDIR"] = tempfile.tempdir = str(folder / "temporary")
    log = os.open(f"{folder}.log", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(log, 1)
    os.dup2(log, 2)
    from swashtwin.cli import main

    if words.startswith("bench"):
        _make_tiny()
    sys.argv = ["swashtwin", *words.split()]
    try:
        main()
    except SystemExit as end:
        os._exit(int(end.code or 0))  # multiprocessing would wait for the idle workers of joblib


def _make_tiny() -> None:
    """Let rigs and studies of this process be so small that they take seconds."""
    from swashtwin.bench.rigs import writing
    from swashtwin.bench.studies import cases, sources
    from swashtwin.calibration import GaussNewton
    from swashtwin.foundation import MPa

    few = {"windows": 2, "scarce_windows": 3, "synthetic": 2, "held_out": 1}
    cases.SCENARIOS["quick"] = replace(cases.SCENARIOS["quick"], method=GaussNewton(starts=1), **few)
    writing.SIZES = sources.SIZES = {"small": writing.RigSize(specimens=2, repeats=2, duration=1.3)}
    writing.PRESSURES = (MPa(15),)
    sources.require_rig = lambda *_: None


def _contents(folder: Path) -> dict[str, bytes]:
    """Contents of every file in a folder, without what may differ between two runs."""
    contents = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            content = path.read_bytes().replace(str(folder).encode(), b"")
            if path.suffix in (".json", ".html"):
                content = _VOLATILE.sub(b"", content)
            contents[path.relative_to(folder).as_posix()] = content
    return contents


def _difference(expected: bytes, content: bytes) -> str:
    """First difference of two files, with what stands before it."""
    pairs = zip(expected, content, strict=False)
    at = max(0, next((at for at, (one, other) in enumerate(pairs) if one != other), 0) - 40)
    return f"{content[at : at + 80]!r} for {expected[at : at + 80]!r}"


def _survivors(folder: Path) -> int | None:
    """Processes of a killed command that still live after twenty seconds."""
    if not Path("/proc/self/environ").is_file():
        return None
    until = time.monotonic() + LONGEST_LIFE
    while (alive := _alive(folder)) and time.monotonic() < until:
        time.sleep(0.05)
    return alive


def _alive(folder: Path) -> int:
    mark, count = f"SWASHTWIN_KILLED={folder}\0".encode(), 0
    for environment in Path("/proc").glob("[0-9]*/environ"):
        try:
            count += mark in environment.read_bytes()
        except OSError:
            continue  # it has ended, or is another user's
    return count


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=50, help="kills in all")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--commands", default=",".join(COMMANDS), help="such as rig,train")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    rows = kill_and_resume(options.count, options.seed, tuple(options.commands.split(",")))
    if options.json:
        print(json.dumps({"seed": options.seed, "rows": [asdict(row) for row in rows]}))
    else:
        print(f"{'command':10s} kills while-writing finished   refused different left-over alive seconds")
        for row in rows:
            lists = (row.refused, row.different, row.left_behind)
            lengths = " ".join(f"{len(problems):9d}" for problems in lists)
            counts = f"{row.command:10s} {row.kills:5d} {row.while_writing:13d} {row.finished:8d}"
            print(f"{counts} {lengths} {row.alive!s:>5s} {row.seconds:7.1f}")
            for problem in dict.fromkeys(problem for problems in lists for problem in problems):
                print("   ", problem)
    return int(not all(row.is_sound for row in rows))


if __name__ == "__main__":
    sys.exit(main())
