"""Attack the readers and the models, and make one table of what comes of it.

    python benchmarks/fuzz_readers.py --jobs 2 --out docs/reference/robustness.md

Parts of it replace their rows of the table only: `--format csv,models,kills`.

Of the files of each format three quarters are mutated (bytes changed, left out, repeated; files cut off), and one
quarter is whole but lies (`lying_files`): rates, units, shapes, number types and facts that cannot be or contradict.
Then come files that ask for too much memory or time (`bombs`), models whose card or weights were changed and sealed
again (`hostile_models`), commands that are killed (`kill_and_resume`), and trainings in threads.

A file must be refused in one line by a SwashTwinError, or read with the rate, the unit, the length and the samples that
it states. A mutated file of a format without a checksum may hold other samples, but not another rate. The only
exceptions, counted apart as `stated_rate`: HDF5 files of the layout that MATLAB and many others write, and
uncompressed MATLAB files, in which nothing has a checksum, so that changed bytes (not missing ones) that state the
rate, or say where it stands, cannot be told from true ones unless the rate is absurd; and TDMS files of which only one
channel is left, so that no other contradicts. A crash of this process, a hang, another exception or something silently
wrong is a failure. Each format is fuzzed in a process of its own, so that a crash is seen.
"""

import argparse
import gzip
import json
import subprocess
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, as_completed
from importlib import import_module
from pathlib import Path
from select import select

import h5py
import numpy as np
from lying_files import LIES, Truth

from swashtwin.foundation import SwashTwinError
from swashtwin.recordings import Recording, join_blocks, load_recording, load_recordings, write_recording, write_store

RATE = 25600.0
TELLS_ONCE = ("mat73", "hdf5_foreign", "mat5_plain")
"""Formats whose rate stands in one place, found by addresses, and of which nothing has a checksum."""
CHECKED = ("csv_gz", "text_gz", "mat5", "hdf5", "store", "npz")
"""Formats with checksums of everything, which must never be read as anything else than what was written."""
FAILURES = ("wrong_rate", "wrong_samples", "wrong_unit", "exception", "two_lines", "crash", "hang")
SILENT = ("wrong_rate", "wrong_samples", "wrong_unit")
_PATIENCE = 90.0
ATTACKS = {"bombs": ("hostile_files", 35), "models": ("hostile_models", 320), "threads": ("hostile_models", 8)}
"""What is tried beside the formats: the module, and how often."""
KILLS = "kills"
"""Name of the commands that are killed (`kill_and_resume`), as a part."""
MARK = "<!-- table of benchmarks/fuzz_readers.py -->"
HEADER = (
    "| what | tried | refused | crashes | tracebacks | silent wrong | hangs | seconds |\n"
    "| --- | --- | --- | --- | --- | --- | --- | --- |"
)
LYING = 4
"""Each so many files one is whole and lies."""
STATES_UNIT = (
    "csv", "csv_gz", "mat5", "mat5_plain", "hdf5", "hdf5_foreign", "tdms", "uff", "parquet", "npz", "mdf", "store",
)  # fmt: skip
"""Formats that state the unit."""
_WORDS = (b"\x00" * 4, b"\xff" * 4, b"\xff\xff\xff\x7f", b"\x00\x00\x00\x80", b"\x01\x00\x00\x00", b"\xff" * 8)


def recording() -> Recording:
    """What every file holds."""
    signal = np.random.default_rng(0).standard_normal((2, 60))
    return Recording(signal, RATE, "a", channels=("x", "y"), label="normal", attributes={"sensor": "352C33"})


def _plain(suffix: str) -> Callable[[Path], Path]:
    return lambda folder: write_recording(recording(), folder / f"a.{suffix}")


def _gzipped(folder: Path) -> Path:
    text = write_recording(recording(), folder / "b.csv").read_bytes()
    (folder / "a.csv.gz").write_bytes(gzip.compress(text))
    return folder / "a.csv.gz"


def _header_lines(folder: Path) -> Path:
    rows = zip(recording().time, *recording().signal, strict=True)
    lines = "".join("\t".join(f"{value:.10f}" for value in row) + "\n" for row in rows)
    text = "%\n% Convert TDMS to ASCII\n% File created on 10-4-2026\n%\n\nTime     \tch 0     \tch 1     \n" + lines
    (folder / "a.dat.gz").write_bytes(gzip.compress(text.encode()))
    return folder / "a.dat.gz"


def _matlab_7_3(folder: Path) -> Path:
    path = folder / "a.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, value in {"x": recording().signal, "fs": np.array([[RATE]])}.items():
            file[name] = value
            file[name].attrs["MATLAB_class"] = np.bytes_("double")
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(116) + bytes(8) + b"\x00\x02IM")
    return path


def _matlab_plain(folder: Path) -> Path:
    from scipy.io import savemat

    first, second = recording().signal
    content = {"x": first, "y": second, "fs": RATE, "unit": "g", "rig": {"note": "352C33", "levels": np.arange(3.0)}}
    savemat(folder / "a.mat", content, do_compression=False)
    return folder / "a.mat"


def _foreign(folder: Path) -> Path:
    with h5py.File(folder / "a.h5", "w") as file:
        file["acc"] = recording().signal
        file["acc"].attrs.update({"fs": RATE, "unit": "g"})
    return folder / "a.h5"


def _store(folder: Path) -> Path:
    return write_store([recording()], folder / "a.h5")


def _universal(folder: Path) -> Path:
    import pyuff

    sets = [
        pyuff.prepare_58(
            id1=f"point {number}", func_type=1, rsp_node=number, rsp_dir=1, ref_node=0, ref_dir=0, ord_data_type=4,
            num_pts=len(row), abscissa_spacing=1, abscissa_min=0.0, abscissa_inc=1 / RATE, abscissa_spec_data_type=17,
            ordinate_spec_data_type=12, orddenom_spec_data_type=0, ordinate_axis_units_lab="g", data=row,
            x=recording().time,
        )
        for number, row in enumerate(recording().signal)
    ]  # fmt: skip
    pyuff.UFF(str(folder / "a.uff")).write_sets(sets, mode="overwrite")
    return folder / "a.uff"


FORMATS: dict[str, Callable[[Path], Path]] = {
    "csv": _plain("csv"),
    "csv_gz": _gzipped,
    "text_gz": _header_lines,
    "mat5": _plain("mat"),
    "mat5_plain": _matlab_plain,
    "mat73": _matlab_7_3,
    "hdf5": _plain("h5"),
    "hdf5_foreign": _foreign,
    "store": _store,
    "wav": _plain("wav"),
    "tdms": _plain("tdms"),
    "uff": _universal,
    "parquet": _plain("parquet"),
    "npz": _plain("npz"),
    "mdf": _plain("mf4"),
}
"""Writer of a valid file of each format."""
PARTS = (*FORMATS, *ATTACKS, KILLS)
"""Lines of the table."""


def mutated(content: bytes, generator: np.random.Generator) -> bytes:
    """`content` cut off, or with some of its bytes changed, left out, repeated or set to telling values."""
    kind = generator.integers(0, 10)
    if kind < 3:
        return content[: int(generator.integers(0, len(content)))]
    changed = bytearray(content)
    reach = len(changed) if generator.random() < 0.5 else min(400, len(changed))  # half of them in the header
    at = int(generator.integers(0, reach))
    size = int(2 ** generator.uniform(0, np.log2(max(2, len(content) // 4))))
    if kind < 7:
        for offset in generator.integers(0, reach, int(generator.integers(1, 12))):
            changed[offset] = (
                int(generator.integers(0, 256)) if kind < 6 else changed[offset] ^ (1 << generator.integers(8))
            )
    elif kind == 7:
        word = _WORDS[generator.integers(0, len(_WORDS))]
        changed[at : at + len(word)] = word
    elif kind == 8:
        del changed[at : at + size]
    else:
        changed[at:at] = changed[at : at + size]
    return bytes(changed)


def loaded(name: str, path: Path, *, in_blocks: bool) -> tuple[Recording, np.ndarray]:
    """Recording of a file and its samples, read with what a file of the format cannot state."""
    facts = {} if name in STATES_UNIT else {"unit": "1" if name != "wav" else "m/s^2"}
    if name == "store":
        (result,) = load_recordings(path)
    else:
        channels = {"channels": ["x", "y"]} if name == "mat5_plain" and path.name != "lie.mat" else {}
        result = load_recording(path, **facts, **channels)
    return result, join_blocks(result.blocks()).signal if in_blocks else result.signal


def outcome(name: str, path: Path, original: bytes, *, in_blocks: bool) -> tuple[str, str]:
    """Class of what came of reading a mutated file, and what was said."""
    try:
        result, signal = loaded(name, path, in_blocks=in_blocks)
    except SwashTwinError as error:
        return ("two_lines" if "\n" in str(error) else "refused"), str(error)
    except Exception as error:  # what is looked for
        return "exception", f"{type(error).__name__}: {error}"
    if abs(result.sample_rate / RATE - 1) > 1e-6:
        unchecked = name in TELLS_ONCE and len(path.read_bytes()) >= len(original)
        alone = name == "tdms" and result.n_channels == 1  # the one whose rate would contradict is lost as well
        return ("stated_rate" if unchecked or alone else "wrong_rate"), f"{result.sample_rate:g} Hz"
    if name in CHECKED and not np.allclose(signal, recording().signal, rtol=0, atol=1e-9):
        return "wrong_samples", f"{signal.shape}"
    if name in CHECKED and result.unit not in ("1", "m/s^2"):
        return "wrong_unit", result.unit
    return "same" if signal.shape == (2, 60) and path.read_bytes() == original else "read", ""


def outcome_of_lie(name: str, path: Path, truth: Truth | None, *, in_blocks: bool) -> tuple[str, str]:
    """Class of what came of reading a lying file, and what was said."""
    try:
        result, signal = loaded(name, path, in_blocks=in_blocks)
    except SwashTwinError as error:
        return ("two_lines" if "\n" in str(error) else "refused"), str(error)
    except Exception as error:  # what is looked for
        return "exception", f"{type(error).__name__}: {error}"
    if truth is None:
        return "wrong_samples", f"read at {result.sample_rate:g} Hz in {result.unit}, but contradicts itself"
    if not abs(result.sample_rate / truth.rate - 1) <= 1e-5:
        return "wrong_rate", f"{result.sample_rate:g} Hz, not {truth.rate:g} Hz"
    if result.unit != truth.unit:
        return "wrong_unit", f"{result.unit!r}, not {truth.unit!r}"
    if signal.shape != truth.signal.shape or not np.allclose(signal, truth.signal, rtol=1e-6, atol=1e-9):
        return "wrong_samples", f"{signal.shape}, not {truth.signal.shape}"
    return "read", ""


def fuzz(name: str, first: int, count: int, seed: int, folder: Path, report: Callable[[int, str, str], None]) -> None:
    """Tell the outcome of each of `count` mutations of a file, from number `first` on."""
    warnings.simplefilter("ignore")
    valid = FORMATS[name](folder)
    content, suffix = valid.read_bytes(), "".join(valid.suffixes)
    kind, message = outcome(name, valid, content, in_blocks=True)
    if kind != "same":
        raise ValueError(f"the valid {name} file is {kind}: {message}")
    for number in range(first, first + count):
        generator = np.random.default_rng([seed, *name.encode(), number])
        in_blocks = number % 2 == 1
        if name in LIES and number % LYING == 0:
            path, truth = LIES[name](folder, generator)
            report(number, *outcome_of_lie(name, path, truth, in_blocks=in_blocks))
        else:
            path = folder / f"mutated_{number}{suffix}"
            path.write_bytes(mutated(content, generator))
            report(number, *outcome(name, path, content, in_blocks=in_blocks))
        path.unlink(missing_ok=True)


def _run(name: str, count: int, seed: int) -> dict[str, object]:
    counts: Counter[str] = Counter()
    failures: list[dict[str, object]] = []
    finished, started, slowest = 0, time.perf_counter(), 0.0
    while finished < count:
        what = (name, str(finished), str(count - finished), str(seed))
        command = [sys.executable, "-W", "ignore", __file__, "--inside", *what]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
            assert process.stdout is not None
            asked_at, last = time.perf_counter(), ""
            while True:
                ready, _, _ = select([process.stdout], [], [], _PATIENCE)
                last = process.stdout.readline() if ready else "hang"
                if not last.endswith("\n"):
                    break
                number, kind, message = json.loads(last)
                counts[kind] += 1
                if finished > 0:
                    slowest = max(slowest, time.perf_counter() - asked_at)
                asked_at, finished = time.perf_counter(), number + 1
                if kind in FAILURES:
                    failures.append({"number": number, "kind": kind, "said": message})
            if last == "hang":
                process.kill()
        if finished < count:
            kind = "hang" if last == "hang" else "crash"
            counts[kind] += 1
            failures.append({"number": finished, "kind": kind, "said": ""})
            finished += 1
    return {
        "format": name,
        "count": count,
        "outcomes": dict(counts),
        "failures": failures,
        "seconds": round(time.perf_counter() - started, 1),
        "slowest_s": round(slowest, 2),
    }


def _killed_commands(count: int, seed: int) -> dict[str, object]:
    """Outcomes of `kill_and_resume`, which ends with 0 where each command went on to the undisturbed result."""
    started = time.perf_counter()
    command = [sys.executable, str(Path(__file__).with_name("kill_and_resume.py")), "--count", str(count), "--seed"]
    run = subprocess.run([*command, str(seed), "--json"], capture_output=True, text=True, check=False)
    counts: Counter[str] = Counter()
    failures: list[dict[str, object]] = []
    try:
        killed = json.loads(run.stdout)["rows"]
    except ValueError:
        killed, said = [], (run.stderr.splitlines() or [""])[-1]
        failures.append({"number": 0, "kind": "exception", "said": said})
    for row in killed:
        for what, kind in (("refused", "exception"), ("different", "wrong_samples"), ("left_behind", "wrong_samples")):
            failures += [{"number": 0, "kind": kind, "said": f"{row['command']}: {what}: {said}"} for said in row[what]]
        if row["alive"]:
            failures.append(
                {"number": 0, "kind": "hang", "said": f"{row['command']}: {row['alive']} processes live on"}
            )
    counts.update(str(failure["kind"]) for failure in failures)
    seconds = round(time.perf_counter() - started, 1)
    tried = sum(row["kills"] for row in killed)
    return {"format": KILLS, "count": tried, "outcomes": dict(counts), "failures": failures, "seconds": seconds}


def _lines(rows: list[dict[str, object]]) -> dict[str, str]:
    """Line of the table for each row, by its name."""
    lines = {}
    for row in rows:
        counts = row["outcomes"]
        assert isinstance(counts, dict)
        cells = [
            row["format"], row["count"], counts.get("refused", 0), counts.get("crash", 0),
            counts.get("exception", 0) + counts.get("two_lines", 0), sum(counts.get(kind, 0) for kind in SILENT),
            counts.get("hang", 0), row["seconds"],
        ]  # fmt: skip
        lines[str(row["format"])] = "| " + " | ".join(str(cell) for cell in cells) + " |"
    return lines


def _write_table(page: Path, lines: dict[str, str]) -> None:
    """Replace lines of the table of a page, which begins at `MARK` and ends at an empty line."""
    before, _, after = page.read_text(encoding="utf-8").partition(MARK)
    table, _, rest = after.partition("\n\n")
    saved = {line.split(" | ")[0].removeprefix("| "): line for line in table.splitlines()} | lines
    table = "\n".join(saved[name] for name in PARTS if name in saved)
    page.write_text(f"{before}{MARK}\n{HEADER}\n{table}\n\n{rest}", encoding="utf-8")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=2000, help="files of each format")
    parser.add_argument("--format", default=",".join(PARTS), help="parts, such as csv,models; by default all")
    parser.add_argument("--kills", type=int, default=50, help="commands that are killed")
    parser.add_argument("--jobs", type=int, default=1, help="parts at the same time")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, help="page whose lines of these parts are replaced")
    parser.add_argument("--inside", nargs=4, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.inside:
        name, first, count, seed = options.inside
        with tempfile.TemporaryDirectory() as folder:
            source = fuzz if name in FORMATS else getattr(import_module(ATTACKS[name][0]), name)
            source(name, int(first), int(count), int(seed), Path(folder),
                   lambda *what: print(json.dumps(what), flush=True))  # fmt: skip
        return 0
    names = options.format.split(",")
    if unknown := set(names) - set(PARTS):
        parser.error(f"no part {', '.join(sorted(unknown))}; parts are {', '.join(PARTS)}")

    def row(name: str) -> dict[str, object]:
        if name == KILLS:
            return _killed_commands(options.kills, options.seed)
        return _run(name, ATTACKS[name][1] if name in ATTACKS else options.count, options.seed)

    slowest_first = sorted(names, key=PARTS.index, reverse=True)
    rows = []
    print(HEADER)
    with ThreadPoolExecutor(options.jobs) as threads:
        for done in as_completed([threads.submit(row, name) for name in slowest_first]):
            rows.append(done.result())
            lines = _lines(rows[-1:])
            print(*lines.values(), flush=True)
            for failure in rows[-1]["failures"][:8]:
                print(rows[-1]["format"], failure)
            if options.out:
                _write_table(options.out, lines)
    return int(any(row["failures"] for row in rows))


if __name__ == "__main__":
    sys.exit(main())
