"""The evidence: one file for each question that was answered, and the page made of them.

    python -m swashtwin_bench.evidence page                      writes docs/bench/evidence.md
    python -m swashtwin_bench.evidence add case1 --study answer.json --question "What do twins add?"
    ...

A file holds the question, the answer in a sentence, the aim, the table, n, what the intervals are,
the command and the commit at which it runs. ``add`` makes one of what a study prints with
``--json``; edit its answer by hand.
"""

import argparse
import json
import re
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
FOLDER, PAGE = ROOT / "evidence", ROOT.parent / "docs" / "bench" / "evidence.md"
USUAL = "evidence-0.2"
"""Tag at which most commands run."""
USUAL_INTERVALS = ("mean ± std", "mean ± std over fleets", "mean ± std over pumps")
"""Intervals that the head of the page explains."""
_PICTURES = ", ".join(
    f"[{name}](../figures/paper/{name}.svg)"
    for name in (
        "excitation", "waveforms", "spectra", "identification-rates", "training-sets", "confusion", "confusion-case2",
        "tsne", "tsne-case2", "training-loss", "ablation", "noise", "algorithms", "related",
    )
)  # fmt: skip
HEAD = f"""# The evidence
<!-- Made by `python -m swashtwin_bench.evidence page` from the files in bench/evidence. -->

One table for each question, misses included. Most figures are of the [virtual rig](rig.md), **no machine**; none is of
a real axial piston pump. Commands run at the tag `{USUAL}` unless a commit is named.
Before `8fad2e1b` the default chose among 24 candidates. ± is the standard deviation over
what n counts, brackets are 95 % intervals, of differences paired, unless said. L0: random windows; L1: later time; L2:
other recordings; L3: another pressure; L4: other pumps; L5: synthetic to measured. *Scarce cell*: the swash plate fault
at 15 MPa. *Nominal* and *calibrated*: training sets or twins by the pump file, by recordings. *Trees*: extra
trees. By window unless said; other [terms](../reference/nomenclature.md).

Pictures of the paper's experiments (medium, fleets 20 to 22, those of Case II 30 to 33): {_PICTURES}.
"""


@dataclass(frozen=True)
class Evidence:
    """What is known about one question."""

    part: str
    """Heading under which it stands."""
    place: int
    """Order on the page."""
    question: str
    answer: str
    n: str
    """What was counted, and how many."""
    interval: str
    """What ± and brackets are."""
    command: str
    commit: str
    """Commit or tag at which the command runs."""
    columns: list[str]
    rows: list[list[str]]
    aim: str | None = None

    def section(self) -> str:
        """Section of the page."""
        facts = [f"*Aim*: {self.aim}."] if self.aim else []
        facts += [
            f"*n*: {self.n}" + ("." if self.interval in USUAL_INTERVALS else f"; {self.interval}.")
        ]
        source = f"`{self.command}`" + ("" if self.commit == USUAL else f" at `{self.commit}`")
        lines = [self.columns, ["---"] * len(self.columns), *self.rows]
        table = "\n".join("|" + "|".join(cells) + "|" for cells in lines)
        text = f"### {self.question}\n{self.answer} {' '.join(facts)}\n\n{source}\n\n{table}\n"
        for spelled, short in _SHORT:
            text = re.sub(spelled, short, text)
        return text


# How ranges and pairs of numbers are written on the page.
_SHORT = (
    (r"(?<=[\d%]) to (?=[-+]?\d)", "…"),
    (r"(?<=[\d%).*]) / (?=[-+*\d])", "/"),
    (r"(?<=\d) ± (?=\d)", "±"),
)


def load(folder: Path = FOLDER) -> list[Evidence]:
    """All evidence of a folder, in the order of the page."""
    files = [json.loads(path.read_text(encoding="utf-8")) for path in sorted(folder.glob("*.json"))]
    return sorted((Evidence(**content) for content in files), key=lambda evidence: evidence.place)


def page(evidence: Iterable[Evidence]) -> str:
    """The page as Markdown."""
    sections, part = [HEAD], ""
    for one in evidence:
        if one.part != part:
            part = one.part
            sections.append(f"## {part}\n")
        sections.append(one.section())
    return "\n".join(sections)


def table_of(rows: list[dict[str, Any]]) -> tuple[list[str], list[list[str]]]:
    """Columns and cells of a study's rows; a measure with mean and deviation becomes one cell."""
    columns = [
        name
        for name, value in rows[0].items()
        if not isinstance(value, dict | list) or "mean" in value
    ]

    def cell(value: Any) -> str:
        if isinstance(value, dict):
            deviation = value.get("std")
            return f"{value['mean']:.3f}" + ("" if deviation is None else f" ± {deviation:.3f}")
        return f"{value:.3f}" if isinstance(value, float) else str(value)

    return columns, [[cell(row[name]) for name in columns] for row in rows]


def main() -> None:
    """Write the page, or add a file of evidence."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    actions = parser.add_subparsers(dest="action", required=True)
    actions.add_parser("page", help="write the page")
    adding = actions.add_parser("add", help="make a file of what a study printed")
    adding.add_argument("name", help="of the file")
    adding.add_argument(
        "--study", type=Path, required=True, help="what a study printed with --json"
    )
    for name in ("part", "question", "answer", "n", "interval", "command", "commit"):
        adding.add_argument(f"--{name}", required=True)
    adding.add_argument("--aim")
    options = parser.parse_args()
    if options.action == "add":
        facts = {
            name: value
            for name, value in vars(options).items()
            if name not in ("action", "name", "study")
        }
        columns, rows = table_of(json.loads(options.study.read_text(encoding="utf-8"))["rows"])
        place = 10 + max((one.place for one in load()), default=0)
        made = Evidence(place=place, columns=columns, rows=rows, **facts)
        text = json.dumps(asdict(made), indent=1, ensure_ascii=False) + "\n"
        (FOLDER / f"{options.name}.json").write_text(text, encoding="utf-8")
    PAGE.write_text(page(load()), encoding="utf-8")


if __name__ == "__main__":
    main()
