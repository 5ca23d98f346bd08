"""What a plant's computer pays for verdicts: this tree beside an earlier commit, both in
environments of their own.

    python benchmarks/plant.py --json

Each side is installed as ``swashtwin[monitor,readers]``, and is then given the same recordings (4
s, three channels at 25.6 kHz, two classes) by the same commands, one side after the other in each
row. Times are of the processor, of all processes that a command started; `verdict_ms` is the median
of diagnoses of one recording once the model is loaded. Sizes are of site-packages without pip and
setuptools, and `bytecode_mb` of what Python compiled in them.
"""

import argparse
import itertools
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
import venv
from pathlib import Path
from typing import Any

os.environ["OMP_NUM_THREADS"] = "1"

from watch import SECONDS, WatchProcess, deliver, samples, wav, write_config

ROOT = Path(__file__).parents[1]
WINDOWS = 12
"""Windows of the default's 8192 samples in a recording."""
FACTS = ("--speed", "1500 rpm", "--pressure", "15 MPa", "--unit", "m/s^2")
VERDICTS = """
import json, statistics, sys, time
from swashtwin.diagnosis import diagnose, load_model
from swashtwin.recordings import load_recordings
model, recording = load_model(sys.argv[1]), load_recordings(sys.argv[2])[0]
model = getattr(model, "fitted_", model)
spent = []
for _ in range(21):
    began = time.process_time()
    diagnose(model, recording)
    spent.append(time.process_time() - began)
print(json.dumps(1000 * statistics.median(spent[1:])))
"""


class Side:
    """One version of swashtwin in an environment of its own."""

    def __init__(self, source: Path, folder: Path) -> None:
        self.python = folder / ("Scripts" if os.name == "nt" else "bin") / "python"
        if not self.python.exists():
            venv.create(folder, with_pip=True)
            subprocess.run(
                [self.python, "-m", "pip", "install", "-q", f"{source}[monitor,readers]"],
                check=True,
            )
        self.packages = next(folder.glob("[Ll]ib/**/site-packages"))

    def cpu_s(self, *words: object) -> float:
        """Processor time [s] of a run of its Python."""
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
        done = subprocess.run(
            [self.python, *map(str, words)], env=environment, capture_output=True, text=True
        )
        if done.returncode:
            raise SystemExit(f"{self.python} {' '.join(map(str, words))}\n{done.stderr[-2000:]}")
        self.printed = done.stdout
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime

    def sizes(self) -> dict[str, float]:
        """Megabytes of what is installed, and of the largest packages."""
        each: dict[str, float] = {}
        code = 0.0
        for path in self.packages.rglob("*"):
            name = path.relative_to(self.packages).parts[0].partition(".")[0].partition("-")[0]
            if path.is_file() and name not in ("pip", "setuptools", "pkg_resources"):
                each[name] = each.get(name, 0) + path.stat().st_size / 1e6
                code += path.stat().st_size / 1e6 if path.suffix == ".pyc" else 0.0
        largest = dict(sorted(each.items(), key=lambda item: -item[1])[:12])
        return {"site_packages_mb": sum(each.values()), "bytecode_mb": code, **largest}


def watched(side: Side, model: Path, folder: Path, count: int) -> dict[str, float]:
    """Memory [MB] of a watch at rest and after so many recordings, and processor time [s] of each
    of these.
    """
    shutil.rmtree(folder, ignore_errors=True)
    config = write_config(folder, ["pump-1"])
    config.write_text(
        config.read_text().replace('name = "pump-1"', f'name = "pump-1"\nmodel = "{model}"')
    )
    watch = WatchProcess(config, side.python)
    watch.start()
    time.sleep(5)
    rest = watch.usage()
    incoming = folder / "incoming"
    for number in range(count):
        deliver(incoming / "pump-1" / f"{number}.wav", wav(samples(number)))
        while sum(1 for _ in incoming.rglob("*.wav")) > 20:
            time.sleep(0.05)
    while any(incoming.rglob("*.wav")):
        time.sleep(0.2)
    time.sleep(5)
    after = watch.usage()
    watch.stop()
    spent = (after["cpu_s"] - rest["cpu_s"]) / count
    return {
        "watch_rest_mb": rest["memory_mb"],
        "watch_after_mb": after["memory_mb"],
        "watch_recording_cpu_s": spent,
    }


def write_recordings(folder: Path, count: int) -> None:
    """So many WAV files of two classes and four pumps."""
    for number in range(count):
        label, pump = ("normal", "piston")[number % 2], "ABCD"[number // 2 % 4]
        values = samples(number)
        if label == "piston":
            values[:, ::1024] += 5
        deliver(folder / f"{label}_{pump}_{number}.wav", wav(values))


def compare(
    sides: dict[str, Side], folder: Path, watched_recordings: int
) -> dict[str, dict[str, float]]:
    """All that is measured, by side."""
    training, new = folder / "training", folder / "new"
    rows = {name: side.sizes() for name, side in sides.items()}
    names, first = "(?P<label>[a-z]+)_(?P<specimen>[A-D])_", next(new.glob("*.wav"))

    def measure(what: str, *words: object) -> None:
        for name, side in sides.items():
            rows[name][what] = side.cpu_s(*(str(word).replace("SIDE", name) for word in words))
            print(name, what, f"{rows[name][what]:.2f} s", file=sys.stderr)

    shell, model = ("-m", "swashtwin"), folder / "SIDE.safetensors"
    for recordings in (training, new):
        for name, side in sides.items():
            index = recordings / "recordings.toml"
            index.unlink(missing_ok=True)
            rows[name]["index_cpu_s"] = side.cpu_s(
                *shell, "index", recordings, "--label-pattern", names, *FACTS
            )
            index.replace(recordings / f"{name}.toml")  # each has its own words
    measure("import_cpu_s", "-c", "import swashtwin")
    measure("train_cpu_s", *shell, "train", training / "SIDE.toml", "--out", model, "--force")
    for _ in range(2):  # the second time with what the first has compiled
        measure("diagnose_cpu_s", *shell, "diagnose", model, first, *FACTS)
    measure("folder_cpu_s", *shell, "diagnose", model, new / "SIDE.toml")
    for name, side in sides.items():
        side.cpu_s("-c", VERDICTS, folder / f"{name}.safetensors", new / f"{name}.toml")
        rows[name]["verdict_ms"] = json.loads(side.printed)
        if watched_recordings:
            rows[name] |= watched(
                side, folder / f"{name}.safetensors", folder / f"{name}-watch", watched_recordings
            )
    return rows


def main() -> None:
    """Print a table of both sides, or JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--commit", default="3b268ae3", help="commit to compare with")
    parser.add_argument("--windows", type=int, default=3000, help="windows to train on")
    parser.add_argument(
        "--recordings", type=int, default=1000, help="recordings of the folder that is diagnosed"
    )
    parser.add_argument(
        "--watched", type=int, default=300, help="recordings that are delivered to a watch"
    )
    parser.add_argument(
        "--folder", type=Path, help="where environments and recordings stay for the next run"
    )
    parser.add_argument("--json", action="store_true", help="print JSON")
    options = parser.parse_args()
    folder = (options.folder or Path(tempfile.mkdtemp(prefix="plant-"))).resolve()
    if not (folder / "earlier").exists():
        subprocess.run(
            [
                "git",
                "-C",
                ROOT,
                "worktree",
                "add",
                "-q",
                "--detach",
                folder / "earlier",
                options.commit,
            ],
            check=True,
        )
    sides = {
        "earlier": Side(folder / "earlier", folder / "earlier-venv"),
        "now": Side(ROOT, folder / "now-venv"),
    }
    if not (folder / "new").exists():
        write_recordings(folder / "training", options.windows // WINDOWS)
        write_recordings(folder / "new", options.recordings)
    rows = compare(sides, folder, options.watched)
    facts: dict[str, Any] = {
        **rows,
        "windows": options.windows,
        "recordings": options.recordings,
        "watched": options.watched,
        "seconds": SECONDS,
        "load": os.getloadavg()[0],
    }
    if options.json:
        print(json.dumps(facts, indent=1))
        return
    for what in dict.fromkeys(itertools.chain(*rows.values())):
        earlier, now = (row.get(what, 0.0) for row in rows.values())
        print(
            f"{what:28}{earlier:12.4g}{now:12.4g}" + (f"{now / earlier:10.2f}" if earlier else "")
        )


if __name__ == "__main__":
    main()
