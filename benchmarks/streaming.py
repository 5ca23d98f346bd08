"""Convert, cut and diagnose a recording larger than memory, and say at what cost.

    python benchmarks/streaming.py --gigabytes 4

An HDF5 file as a recorder writes it (single precision, the library's default layout) is made in a temporary folder.
Each step runs in a process of its own, whose greatest memory (`resource.getrusage`) and speed are told, beside the
speed at which NumPy reads the same bytes. `steps` of the result: `seconds`, `cpu_s` (of the process and its children:
what is left where others use the machine too), `mb_per_s` (bytes of the source), `peak_mb`, and `ratio`, the share of
NumPy's speed. Files that fit into the operating system's cache are read from there by all alike.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np

RATE, CHANNELS, LENGTH = 51200.0, 2, 2048
BLOCK = 1 << 20


def make(folder: Path, size: int) -> int:
    """Write the source, a copy of its numbers without any format, and a classifier; give the samples per channel."""
    from swashtwin.diagnosis import save_classifier
    from swashtwin.learning import TrainingSettings, build_network, cut_windows, fit
    from swashtwin.recordings import Recording

    generator = np.random.default_rng(0)
    count = max(LENGTH, size // (4 * CHANNELS))
    block = generator.standard_normal((CHANNELS, min(BLOCK, count)), dtype=np.float32)
    with h5py.File(folder / "source.h5", "w") as file, (folder / "plain.bin").open("wb") as plain:
        data = file.create_dataset("acc", (CHANNELS, count), np.float32)
        data.attrs.update({"fs": RATE, "unit": "m/s^2"})
        for start in range(0, count, BLOCK):
            part = block[:, : count - start] * (1 + start / count)
            data[:, start : start + BLOCK] = part
            plain.write(part.astype(np.float32).tobytes())
    names = tuple(f"acc/{number}" for number in range(CHANNELS))
    recordings = [
        Recording(generator.normal(size=(CHANNELS, 8 * LENGTH)), RATE, label, channels=names, label=label)
        for label in ("normal", "piston")
    ]
    network = build_network("bitcn", CHANNELS, 2, channels=(4,))
    windows = cut_windows(recordings, length=LENGTH)
    save_classifier(fit(network, windows, settings=TrainingSettings(epochs=1), seed=0), folder / "model.safetensors")
    return count


def numpy_reads(folder: Path) -> str:
    """Read the numbers as NumPy does, a block at a time."""
    total = 0.0
    with (folder / "plain.bin").open("rb") as file:
        while len(part := np.fromfile(file, np.float32, BLOCK)):
            total += float(part[0])
    return f"{total:.3f}"


def h5py_reads(folder: Path) -> str:
    """Read the source with the HDF5 library alone, a block at a time."""
    total = 0.0
    with h5py.File(folder / "source.h5") as file:
        for start in range(0, file["acc"].shape[1], BLOCK):
            total += float(file["acc"][:, start : start + BLOCK][0, 0])
    return f"{total:.3f}"


def convert(folder: Path) -> str:
    """Convert the source to a store."""
    from swashtwin.recordings import load_recording, write_store

    write_store([load_recording(folder / "source.h5")], folder / "store.h5")
    return f"{(folder / 'store.h5').stat().st_size} bytes"


def windows(folder: Path) -> str:
    """Cut the store into windows, in batches."""
    from swashtwin.learning import window_batches
    from swashtwin.recordings import load_recordings

    (stored,) = load_recordings(folder / "store.h5")
    return f"{sum(len(part) for part in window_batches(stored, length=LENGTH))} windows"


def diagnose(folder: Path) -> str:
    """Diagnose the store with a small network."""
    from swashtwin.diagnosis import diagnose, load_classifier
    from swashtwin.recordings import load_recordings

    (stored,) = load_recordings(folder / "store.h5")
    return f"{diagnose(load_classifier(folder / 'model.safetensors'), stored).n_windows} windows"


STEPS: dict[str, Callable[[Path], str]] = {
    step.__name__: step for step in (numpy_reads, h5py_reads, convert, windows, diagnose)
}


def _in_subprocess(step: str, folder: Path) -> dict[str, float | str]:
    command = [sys.executable, __file__, "--step", step, "--folder", str(folder)]
    process = subprocess.run(
        command, capture_output=True, text=True, check=True, env={**os.environ, "OMP_NUM_THREADS": "1"}
    )
    figures: dict[str, float | str] = json.loads(process.stdout)
    return figures


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--gigabytes", type=float, default=4.0, help="size of the recording")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--step", choices=STEPS, help=argparse.SUPPRESS)
    parser.add_argument("--folder", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.step:
        started = time.perf_counter()
        message = STEPS[options.step](options.folder)
        seconds = time.perf_counter() - started
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
        cpu = sum(usage.ru_utime + usage.ru_stime for usage in used)
        print(json.dumps({"seconds": seconds, "cpu_s": cpu, "peak_mb": peak, "said": message}))
        return
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        process = subprocess.run(
            [sys.executable, "-c", "import sys; from pathlib import Path; sys.path.insert(0, sys.argv[1]);"
             "import streaming; print(streaming.make(Path(sys.argv[2]), int(sys.argv[3])))",
             str(Path(__file__).parent), name, str(int(options.gigabytes * 1e9))],
            capture_output=True, text=True, check=True,
        )  # fmt: skip
        size = int(process.stdout) * CHANNELS * 4
        steps = {step: _in_subprocess(step, folder) for step in STEPS}
    for figures in steps.values():
        figures["mb_per_s"] = size / 1e6 / float(figures["seconds"])
        figures["ratio"] = float(steps["numpy_reads"]["seconds"]) / float(figures["seconds"])
    if options.json:
        print(json.dumps({"megabytes": size / 1e6, "channels": CHANNELS, "length": LENGTH, "steps": steps}))
        return
    print(f"{size / 1e6:.0f} MB of single precision, {CHANNELS} channels, windows of {LENGTH}")
    for step, figures in steps.items():
        speed = f"{figures['mb_per_s']:8.0f} MB/s {figures['ratio']:7.3f} of NumPy's"
        used = f"{figures['seconds']:8.2f} s {figures['cpu_s']:8.2f} s CPU {figures['peak_mb']:7.0f} MB"
        print(f"{step:12s} {used} {speed}  {figures['said']}")


if __name__ == "__main__":
    main()
