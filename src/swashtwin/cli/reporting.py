"""The command that gathers finished studies into one page: report."""

from pathlib import Path
from typing import Annotated

import typer

from swashtwin.cli.console import say, table, tell
from swashtwin.cli.options import Json, as_folder


def report(
    folder: Annotated[Path, typer.Argument(help="Folder that studies wrote their runs to (their --out).")],
    out: Annotated[Path, typer.Option(help="Folder for report.html, its figures and their data.", callback=as_folder)],
    as_json: Json = False,
) -> None:
    """Gather every finished run of a folder into one page: tables and figures, the paper's figures beside ours."""
    from swashtwin.bench import collect_studies, write_study_report

    found = collect_studies(folder)
    page = write_study_report(*found, folder=out)
    studies = [
        {
            "study": one.study,
            "size": one.size,
            "seeds": list(one.seeds),
            "runs": len(one.runs),
            "answer": list(one.answer),
        }
        for one in found
    ]

    def show() -> None:
        rows = [(one.study, one.size, ", ".join(map(str, one.seeds)), len(one.runs)) for one in found]
        table("Studies", ("study", "size", "seeds", "runs"), rows)
        say(f"Report: {page}")

    tell({"report": page, "studies": studies}, as_json, show)
