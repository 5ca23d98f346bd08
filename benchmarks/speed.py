"""How fast this tree is beside a frozen commit, night by night.

    python benchmarks/speed.py --history benchmarks/history.csv --chart docs/figures/speed.svg

Five short tasks, one for each benchmark that compares: the simulator, a plant's verdict, the
training on new pumps, the watch and the explorer. Each task runs in the trees of both commits, in
turns, with the same Python and the same installed packages, and counts the processor time of its
repeated part. A ratio is the time of the reference over that of this tree: 2 is twice as fast as
the reference. The row of the night is appended to the history. The run fails if a ratio is more
than a fifth below the median of the last five rows of the same reference, or below 1 if there is
none; the row is then not appended.

A task uses public names only, so that it runs in both trees. If one of them must change, or if a
task became slower on purpose, set `REFERENCE` to a newer commit: its rows start anew.
"""

import argparse
import csv
import json
import math
import os
import platform
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

ROOT = Path(__file__).parents[1]
REFERENCE = "16cc3bda"
"""Commit of 2026-12-01 that all rows are compared with."""
MAX_FALL = 0.2
"""Largest loss of speed that passes; ratios of equal trees were 0.96 to 1.16 on a busy machine."""
N_COMPARED = 5
"""Rows of the history whose median a new one is compared with."""

COMMON = """
import json, statistics, tempfile, time
from pathlib import Path
import numpy as np
import swashtwin as st

def spent(run, times):
    run()
    each = []
    for _ in range(times):
        began = time.process_time()
        run()
        each.append(time.process_time() - began)
    print(json.dumps(statistics.median(each)))

def rig():
    from swashtwin_bench import SIZES, rig_recordings
    return [pair[0] for pair in rig_recordings(0, SIZES["tiny"], version="2")]
"""

TASKS = {
    # value and gradient of the spectrum at 500 sets of values
    "simulator": """
import torch
from swashtwin.physics import Twin
from swashtwin.pump import OperatingCondition, SwashPlateDefect, load_pump

condition = OperatingCondition(speed=st.rpm(860), discharge_pressure=st.MPa(15))
defect = SwashPlateDefect(length=st.mm(30), width=st.mm(24), depth=st.mm(0.6))
twin = Twin(load_pump("25scy14-1b"), condition, defect)
spread = np.exp(np.random.default_rng(0).normal(0, 0.3, (500, 6)))
values = torch.tensor(twin.values.numpy() * spread, requires_grad=True)
spent(lambda: torch.autograd.grad(twin.acceleration(values).abs().square().sum(), values), 20)
""",
    # verdicts of a loaded model on 30 recordings
    "plant": """
from swashtwin.diagnosis import FaultClassifier
recordings = rig()
classifier = FaultClassifier().fit(recordings)
spent(lambda: [classifier.diagnose(recording) for recording in recordings[:30]], 5)
""",
    # the ordinary training
    "new_pumps": """
from swashtwin.diagnosis import FaultClassifier
recordings = rig()
spent(lambda: FaultClassifier().fit(recordings), 1)
""",
    # judgments of 40 recordings of one machine, half of them after its baseline is learned
    "watch": """
from swashtwin.monitoring import OperatingPointMonitor
from swashtwin.recordings import Recording
rng = np.random.default_rng(0)
recordings = [
    Recording(rng.normal(size=(3, 25600)), 25600.0, f"r{number}", channels=("x", "y", "z"))
    for number in range(40)
]
def watch():
    monitor, state = OperatingPointMonitor("pump-1"), None
    for recording in recordings:
        state = monitor.judge(recording, state).state
spent(watch, 3)
""",
    # the picture of a dragged slider: lines of the twin beside those of a recording
    "explorer": """
from swashtwin.explorer import Workspace, build_explorer
from swashtwin_bench import build_rig
from starlette.testclient import TestClient
with tempfile.TemporaryDirectory() as folder:
    index = build_rig(Path(folder) / "rig", seed=0, size="tiny")
    explorer = build_explorer(Workspace(index), address_token="speed")
    client = TestClient(explorer, base_url="http://127.0.0.1:8643")
    page = client.get("/", params={"token": "speed"}).text
    headers = {"x-explorer": page.split('name="token" content="')[1].split('"')[0]}
    name = next(row["name"] for row in client.get("/api/rows").json()["rows"])
    def drag():
        for step in range(20):
            setting = {"start": "25scy14-1b", "recording": name, "mpa": 12 + 0.01 * step}
            answer = client.post("/api/twin_lines", json=setting, headers=headers)
            assert answer.status_code == 200, answer.text
    spent(drag, 5)
""",
}


def task_time(tree: Path, task: str) -> float:
    """Return the processor time [s] of the repeated part of a task in a tree."""
    paths = [str(tree / "src"), str(tree / "bench" / "src")]
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(paths),
        "OMP_NUM_THREADS": "1",
        "OMP_WAIT_POLICY": "PASSIVE",
    }
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            [sys.executable, "-W", "ignore", "-c", COMMON + TASKS[task]],
            env=environment,
            cwd=folder,
            capture_output=True,
            text=True,
            check=False,
        )
    if done.returncode:
        raise SystemExit(f"Task {task} failed in {tree}:\n{done.stderr[-2000:]}")
    return float(json.loads(done.stdout.splitlines()[-1]))


def ratios(reference: Path, rounds: int) -> dict[str, float]:
    """Return how many times faster than the reference each task is in this tree.

    The trees take turns, so that a load that comes or goes meets both.
    """
    speed = {}
    for task in TASKS:
        pairs = []
        for _ in range(rounds):
            pairs.append((task_time(reference, task), task_time(ROOT, task)))
        reference_times, times = zip(*pairs, strict=True)
        speed[task] = statistics.median(reference_times) / statistics.median(times)
        print(
            f"{task}: {statistics.median(reference_times):.3g} s at {REFERENCE}, "
            f"{statistics.median(times):.3g} s now, ratio {speed[task]:.2f}",
            flush=True,
        )
    return speed


@contextmanager
def reference_tree() -> Iterator[Path]:
    """Check out the reference commit beside this tree, and remove it in the end."""
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "reference"
        git("worktree", "add", "-q", "--detach", str(tree), REFERENCE)
        try:
            yield tree
        finally:
            git("worktree", "remove", "--force", str(tree))


def git(*words: str) -> str:
    """Return what a command of git prints."""
    done = subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(
            f"git {' '.join(words)}: {done.stderr.strip()} (the reference needs the full history)"
        )
    return done.stdout.strip()


def read_rows(path: Path) -> list[dict[str, str]]:
    """Return the rows of the history that have this reference."""
    if not path.exists():
        return []
    with path.open(encoding="utf-8", newline="") as file:
        return [row for row in csv.DictReader(file) if row["reference"] == REFERENCE]


def find_falls(rows: Sequence[dict[str, str]], speed: dict[str, float]) -> list[str]:
    """Return a sentence for each task that lost more than `MAX_FALL` of its speed.

    Parameters
    ----------
    rows : earlier rows of the history, the newest last.
    speed : new ratios by task.
    """
    sentences = []
    for task, ratio in speed.items():
        earlier = [float(row[task]) for row in rows[-N_COMPARED:] if row.get(task)]
        expected = statistics.median(earlier) if earlier else 1.0
        if ratio < (1 - MAX_FALL) * expected:
            sentences.append(
                f"{task} is slower: {ratio:.2f} times the speed of {REFERENCE}, "
                f"{expected:.2f} before."
            )
    return sentences


def append_row(path: Path, speed: dict[str, float]) -> None:
    """Append a row with date and commit to the history."""
    names = ["date", "commit", "reference", "python", "machine", *TASKS]
    is_new = not path.exists()
    row = {
        "date": datetime.now(UTC).date().isoformat(),
        "commit": git("rev-parse", "--short=8", "HEAD"),
        "reference": REFERENCE,
        "python": platform.python_version(),
        "machine": f"{platform.machine()}, {os.cpu_count()} cores",
        **{task: f"{ratio:.3f}" for task, ratio in speed.items()},
    }
    with path.open("a", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, names, lineterminator="\n")
        if is_new:
            writer.writeheader()
        writer.writerow(row)


def draw(rows: Sequence[dict[str, str]], path: Path) -> None:
    """Draw the ratios of the history over its rows."""
    import matplotlib as mpl
    import matplotlib.pyplot as plt

    mpl.rcParams["svg.hashsalt"] = "speed"  # the same rows give the same file
    mpl.rcParams["svg.fonttype"] = "none"
    figure, axes = plt.subplots(figsize=(7, 3), layout="constrained")
    labels = [f"{row['date']}\n{row['commit']}" for row in rows]
    for task, marker in zip(TASKS, "osD^v", strict=True):
        axes.plot([float(row[task]) for row in rows], marker=marker, markersize=5, label=task)
    axes.axhline(1.0, color="0.6", linewidth=1, zorder=0)
    highest = max(float(row[task]) for row in rows for task in TASKS)

    shown = range(0, len(rows), max(1, math.ceil(len(rows) / 5)))
    axes.set_xticks(list(shown), [labels[index] for index in shown], fontsize=8)
    axes.set_ylabel(f"speed over that of {REFERENCE}")
    axes.margins(x=0.1)
    axes.set_ylim(0, 1.1 * max(highest, 1.0))
    axes.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside right", frameon=False)
    figure.savefig(path, metadata={"Date": None}, facecolor="white")


def main() -> None:
    """Measure, compare, append and draw."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rounds", type=int, default=3, help="turns of each tree")
    parser.add_argument("--history", type=Path, default=ROOT / "benchmarks" / "history.csv")
    parser.add_argument("--chart", type=Path, help="SVG file of the ratios over time")
    options = parser.parse_args()

    with reference_tree() as tree:
        speed = ratios(tree, options.rounds)
    falls = find_falls(read_rows(options.history), speed)
    if falls:
        raise SystemExit("\n".join(falls))

    append_row(options.history, speed)
    if options.chart is not None:
        draw(read_rows(options.history), options.chart)


if __name__ == "__main__":
    main()
