"""The evidence: one file for each question that was answered, and the page made of them.

    python -m swashtwin_bench.evidence page                      writes docs/bench/evidence.md
    python -m swashtwin_bench.evidence add case1 --study answer.json --question "What do twins add?"
    ...

A file contains the question, the answer in a sentence, the aim, the table, n, the meaning of the
intervals, the command, and the commit at which it runs. ``add`` makes a file from what a study
prints with ``--json``; edit its answer by hand.
"""

import argparse
import json
import re
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "evidence"
PAGE = ROOT.parent / "docs" / "bench" / "evidence.md"

DEFAULT_COMMIT = "3b268ae3"
"""Commit at which most commands run: the last before their studies left the tree."""

DEFAULT_INTERVALS = ("mean ± std", "mean ± std over fleets", "mean ± std over pumps")
"""Meanings of the intervals that the head of the page explains."""

_PICTURE_NAMES = (
    "excitation",
    "waveforms",
    "spectra",
    "identification-rates",
    "training-sets",
    "confusion",
    "confusion-case2",
    "tsne",
    "tsne-case2",
    "training-loss",
    "ablation",
    "noise",
    "algorithms",
    "related",
)
_PICTURES = ", ".join(f"[{name}](../figures/paper/{name}.svg)" for name in _PICTURE_NAMES)

HEAD = f"""# The evidence
<!-- Made by `python -m swashtwin_bench.evidence page` from the files in bench/evidence. -->

One table for each question, failures included. Most figures are of the [virtual rig](rig.md),
**not of a machine**; none is of a real axial piston pump. Commands run at the commit
`{DEFAULT_COMMIT}` unless another is named. Before `8fad2e1b` the default training selected among 24
candidates.

± is the standard deviation over what n counts. Brackets are 95 % intervals; those of differences
are paired. Exceptions are stated. Figures are by window unless stated otherwise.

L0: random windows; L1: later time; L2: other recordings; L3: another pressure; L4: other pumps;
L5: synthetic to measured. *Scarce cell*: the swash plate fault at 15 MPa. *Nominal* and
*calibrated*: training sets or twins from the pump file, or calibrated on recordings. *Trees*: extra
trees. Other terms: [nomenclature](../reference/nomenclature.md).

Pictures of the paper's experiments (medium, fleets 20 to 22, those of Case II 30 to 33):
{_PICTURES}.
"""


@dataclass(frozen=True)
class Evidence:
    """The answer to one question; the fields are the keys of its file."""

    part: str
    """Heading on the page."""
    place: int
    """Order on the page."""
    question: str
    answer: str
    n: str
    """What was counted, and its number."""
    interval: str
    """Meaning of ± and brackets."""
    command: str
    commit: str
    """Hash of the commit at which the command runs."""
    columns: list[str]
    rows: list[list[str]]
    aim: str | None = None

    def section(self) -> str:
        """Return the section of the page as Markdown."""
        facts = []
        if self.aim:
            facts.append(f"*Aim*: {self.aim}.")
        if self.interval in DEFAULT_INTERVALS:
            facts.append(f"*n*: {self.n}.")
        else:
            facts.append(f"*n*: {self.n}; {self.interval}.")

        source = f"`{self.command}`"
        if self.commit != DEFAULT_COMMIT:
            source += f" at `{self.commit}`"

        lines = [self.columns, ["---"] * len(self.columns), *self.rows]
        table = "\n".join("|" + "|".join(cells) + "|" for cells in lines)

        text = f"### {self.question}\n{self.answer} {' '.join(facts)}\n\n{source}\n\n{table}\n"
        for pattern, short_form in _SHORT_FORMS:
            text = re.sub(pattern, short_form, text)
        return text


# Short forms of ranges and pairs of numbers: the tables are wide.
_SHORT_FORMS = (
    (r"(?<=[\d%]) to (?=[-+]?\d)", "…"),
    (r"(?<=[\d%).*]) / (?=[-+*\d])", "/"),
    (r"(?<=\d) ± (?=\d)", "±"),
)


def load_evidence(folder: Path = FOLDER) -> list[Evidence]:
    """Return all evidence of a folder in the order of the page."""
    evidence = []
    # Sorted by name first: some questions share a place.
    for path in sorted(folder.glob("*.json")):
        evidence.append(Evidence(**json.loads(path.read_text(encoding="utf-8"))))

    return sorted(evidence, key=lambda entry: entry.place)


def build_page(evidence: Iterable[Evidence]) -> str:
    """Return the page as Markdown."""
    sections = [HEAD]
    part = ""
    for entry in evidence:
        if entry.part != part:
            part = entry.part
            sections.append(f"## {part}\n")
        sections.append(entry.section())

    return "\n".join(sections)


def tabulate_rows(rows: list[dict[str, Any]]) -> tuple[list[str], list[list[str]]]:
    """Return columns and cells of a study's rows; mean and deviation share a cell."""
    columns = [
        name
        for name, value in rows[0].items()
        if not isinstance(value, dict | list) or "mean" in value
    ]
    cells = []
    for row in rows:
        cells.append([_format_cell(row[name]) for name in columns])

    return columns, cells


def _format_cell(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.3f}"
    if not isinstance(value, dict):
        return str(value)
    if value.get("std") is None:
        return f"{value['mean']:.3f}"
    return f"{value['mean']:.3f} ± {value['std']:.3f}"


def main() -> None:
    """Write the page, or first add a file of evidence."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    actions = parser.add_subparsers(dest="action", required=True)
    actions.add_parser("page", help="write the page")

    add = actions.add_parser("add", help="make a file from the output of a study")
    add.add_argument("name", help="name of the file")
    add.add_argument("--study", type=Path, required=True, help="output of a study with --json")
    for name in ("part", "question", "answer", "n", "interval", "command", "commit"):
        add.add_argument(f"--{name}", required=True)
    add.add_argument("--aim")

    options = vars(parser.parse_args())
    if options.pop("action") == "add":
        _add_evidence(options.pop("name"), options.pop("study"), options)

    PAGE.write_text(build_page(load_evidence()), encoding="utf-8")


def _add_evidence(name: str, study_file: Path, facts: dict[str, Any]) -> None:
    """Write the file of a question, which comes last on the page."""
    study = json.loads(study_file.read_text(encoding="utf-8"))
    columns, rows = tabulate_rows(study["rows"])

    # Steps of ten leave room to move a question by hand.
    place = 10 + max((entry.place for entry in load_evidence()), default=0)
    evidence = Evidence(place=place, columns=columns, rows=rows, **facts)
    text = json.dumps(asdict(evidence), indent=1, ensure_ascii=False) + "\n"
    (FOLDER / f"{name}.json").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
