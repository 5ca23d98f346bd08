"""Attack the readers with the files of `hostile_files`, and make one table of what comes of it.

    python benchmarks/fuzz_readers.py --jobs 2 --out docs/reference/robustness.md

A crash of this process, a hang, another exception than a refusal, or something silently wrong is a
failure. Each format is fuzzed in a process of its own, so that a crash is seen.
"""

import argparse
import sys
import tempfile
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from hostile_files import BOMBS, FAILURES, FORMATS, SILENT, tried
from joblib.externals.loky import BrokenProcessPool, ProcessPoolExecutor

PATIENCE = 90.0
MARK = "<!-- table of benchmarks/fuzz_readers.py -->"
HEADER = (
    "| what | tried | refused | crashes | tracebacks | silent wrong | hangs | seconds |\n"
    "| --- | --- | --- | --- | --- | --- | --- | --- |"
)
PARTS = (*FORMATS, "bombs")
"""Lines of the table."""


def run(name: str, count: int) -> dict[str, Any]:
    """Outcomes and failures of so many files of a part."""
    counts: Counter[str] = Counter()
    failures, started = [], time.perf_counter()
    pool = ProcessPoolExecutor(1)
    with tempfile.TemporaryDirectory() as folder:
        for number in range(count):
            try:
                kind, message = pool.submit(tried, name, number, 0, Path(folder)).result(PATIENCE)
            except (TimeoutError, BrokenProcessPool) as cause:
                kind, message = "hang" if isinstance(cause, TimeoutError) else "crash", ""
                pool.shutdown(kill_workers=True)
                pool = ProcessPoolExecutor(1)
            counts[kind] += 1
            failures += [(number, kind, message)] if kind in FAILURES else []
        pool.shutdown(kill_workers=True)
    return {
        "format": name,
        "outcomes": counts,
        "failures": failures,
        "seconds": time.perf_counter() - started,
    }


def line_of(row: dict[str, Any]) -> str:
    """Line of the table."""
    counts = row["outcomes"]
    cells = [
        row["format"],
        counts.total(),
        counts["refused"],
        counts["crash"],
        counts["exception"] + counts["two_lines"],
        sum(counts[kind] for kind in SILENT),
        counts["hang"],
        f"{row['seconds']:.1f}",
    ]
    return f"| {' | '.join(map(str, cells))} |"


def write_line(page: Path, line: str) -> None:
    """Replace a line of the table of a page, which begins at `MARK` and ends at an empty line."""
    before, _, after = page.read_text(encoding="utf-8").partition(MARK)
    table, _, rest = after.partition("\n\n")
    saved = {
        each.split(" | ")[0].removeprefix("| "): each for each in (*table.splitlines()[3:], line)
    }
    order = (
        *(name for name in PARTS if name in saved),
        *(name for name in saved if name not in PARTS),
    )
    page.write_text(
        f"{before}{MARK}\n{HEADER}\n" + "\n".join(map(saved.get, order)) + f"\n\n{rest}",
        encoding="utf-8",
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=2000, help="files of each format")
    parser.add_argument(
        "--format", default=",".join(PARTS), help="parts, such as csv,bombs; by default all"
    )
    parser.add_argument("--jobs", type=int, default=1, help="parts at the same time")
    parser.add_argument("--out", type=Path, help="page whose lines of these parts are replaced")
    options = parser.parse_args()
    names = options.format.split(",")
    if unknown := set(names) - set(PARTS):
        parser.error(f"no part {', '.join(sorted(unknown))}; parts are {', '.join(PARTS)}")
    counts = {name: len(BOMBS) if name == "bombs" else options.count for name in names}
    has_failed = False
    print(HEADER)
    with ThreadPoolExecutor(options.jobs) as threads:
        slowest_first = sorted(names, key=PARTS.index, reverse=True)
        for done in as_completed(
            [threads.submit(run, name, counts[name]) for name in slowest_first]
        ):
            row = done.result()
            print(line_of(row), *row["failures"][:8], sep="\n", flush=True)
            has_failed |= bool(row["failures"])
            if options.out:
                write_line(options.out, line_of(row))
    return int(has_failed)


if __name__ == "__main__":
    sys.exit(main())
