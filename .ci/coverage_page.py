"""Write the measured coverage into its page.

    coverage run -m pytest && coverage combine && coverage json -o coverage.json
    python .ci/coverage_page.py coverage.json docs/explanation/quality.md

The table has the ten modules with the smallest covered share, with the lines that no test ran.
Modules of fewer than `MIN_STATEMENTS` statements are left out, since one line decides them.
"""

import json
import re
import subprocess
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

MIN_STATEMENTS = 25
N_WORST = 10
N_RANGES = 8
"""Ranges of lines that a row names."""
START, END = "<!-- coverage -->", "<!-- end of coverage -->"


def line_ranges(lines: Sequence[int]) -> str:
    """Return ascending line numbers as ranges, such as ``3-5, 9``; the longest `N_RANGES` ones."""
    ranges: list[list[int]] = []
    for line in lines:
        if ranges and line <= ranges[-1][1] + 1:
            ranges[-1][1] = line
        else:
            ranges.append([line, line])

    longest = sorted(ranges, key=lambda limits: limits[0] - limits[1])[:N_RANGES]
    texts = [f"{first}-{last}" if last > first else str(first) for first, last in sorted(longest)]
    if len(ranges) > N_RANGES:
        texts.append("...")
    return ", ".join(texts)


def worst_modules(files: dict[str, Any]) -> list[tuple[str, dict[str, Any]]]:
    """Return names and measurements of the modules with the smallest covered share."""
    large = [
        (name, file)
        for name, file in files.items()
        if file["summary"]["num_statements"] >= MIN_STATEMENTS
    ]
    return sorted(large, key=lambda item: item[1]["summary"]["percent_covered"])[:N_WORST]


def render(measured: dict[str, Any], commit: str, date: str) -> str:
    """Return the part of the page."""
    rows = ["| module | covered | statements | not run: lines |", "| --- | --- | --- | --- |"]
    for name, file in worst_modules(measured["files"]):
        summary = file["summary"]
        rows.append(
            f"| {name} | {summary['percent_covered']:.0f} % | {summary['num_statements']} | "
            f"{line_ranges(file['missing_lines'])} |"
        )

    totals = measured["totals"]
    text = (
        f"**{totals['percent_covered']:.1f} %** of statements and branches together at {commit} "
        f"({date}): {totals['covered_lines']:,} of {totals['num_statements']:,} statements, "
        f"{totals['covered_branches']:,} of {totals['num_branches']:,} branches. The ten modules "
        f"with the smallest share, of those with at least {MIN_STATEMENTS} statements:"
    )
    return text + "\n\n" + "\n".join(rows)


def main() -> None:
    """Replace the part of the page."""
    measured = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    page = Path(sys.argv[2])
    text = render(measured, current_commit(), datetime.now(UTC).date().isoformat())
    print(text)

    part = re.compile(f"{START}.*{END}", re.DOTALL)
    content = part.sub(lambda _: f"{START}\n{text}\n{END}", page.read_text(encoding="utf-8"))
    page.write_text(content, encoding="utf-8")


def current_commit() -> str:
    """Return the name of the commit that is checked out."""
    command = ["git", "rev-parse", "--short=8", "HEAD"]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


if __name__ == "__main__":
    main()
