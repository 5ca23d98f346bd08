"""What every study's command prints and writes, and the page of finished runs."""

import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from swashtwin.cli import Json, as_folder, require_files, say, table, tell

if TYPE_CHECKING:
    from swashtwin_bench import StudyTable


def tell_study(study: "StudyTable", folder: Path | None, as_json: bool) -> None:
    """Write the report if a folder is named, and print the study as one JSON object or as a table."""
    from swashtwin_bench import write_study_report

    page = None if folder is None else write_study_report(study, folder=folder)
    result = {**study.to_dict(), "report": page}

    def show() -> None:
        show_study(study)
        if page is not None:
            say(f"Report: {page}")

    tell(result, as_json, show)


def show_study(study: "StudyTable") -> None:
    """Print a study as a table with its answer and its notes."""
    result = study.to_dict()
    metrics = {name: words for name, words in study.metrics.items() if not name.startswith("recall_")}
    rows = [
        [*(row[name] for name in study.factors), _count_seeds(row), *(_spread(row[name]) for name in metrics)]
        for row in [*result["rows"], *result.get("rivals", ())]
    ]
    seeds = ", ".join(map(str, study.seeds))
    title = f"{study.title}; seed {seeds}, {study.wall_s:.0f} s"
    table(title, (*study.factors, "seeds", *metrics.values()), rows)
    for text in (*study.answer, *study.notes, study.origin):
        say(text)


def _count_seeds(row: dict[str, Any]) -> int:
    """Seeds behind a row, which need not be all of the study's."""
    return max(len(value["values"]) for value in row.values() if isinstance(value, dict))


def _spread(value: dict[str, Any]) -> str:
    if value["mean"] is None:
        return "-"
    return f"{value['mean']:.3f}" + ("" if value["std"] is None else f" ± {value['std']:.3f}")


def typed_command() -> str:
    """The command line as it was typed, for a result to record."""
    return shlex.join(["swashtwin", *sys.argv[1:]])


def report(
    folders: Annotated[list[Path], typer.Argument(metavar="FOLDER...", help="Folders of studies' runs.")],
    out: Annotated[Path, typer.Option(help="Folder for report.html, its figures and their data.", callback=as_folder)],
    as_json: Json = False,
) -> None:
    """Write one page of the finished runs of studies."""
    from swashtwin_bench import collect_studies, write_study_report

    require_files(folders)
    studies = [study for folder in folders for study in collect_studies(folder)]
    page = write_study_report(*studies, folder=out)
    rows = [(study.study, study.size, ", ".join(map(str, study.seeds)), len(study.runs)) for study in studies]
    told = [
        {"study": study.study, "size": study.size, "seeds": [*study.seeds], "runs": len(study.runs),
         "answer": [*study.answer]}
        for study in studies
    ]  # fmt: skip

    def show() -> None:
        table("Studies", ("study", "size", "seeds", "runs"), rows)
        say(f"Report: {page}")

    tell({"report": page, "studies": told}, as_json, show)
