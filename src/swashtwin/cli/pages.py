"""The page that a command writes with ``--report``: a folder with its data, or one HTML file."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any

import typer

from swashtwin.cli.exits import require_target
from swashtwin.cli.options import as_folder

if TYPE_CHECKING:
    from swashtwin.recordings import Recording


def as_page(path: Path | None) -> Path | None:
    """The same path, refused before any work where the page could not be written."""
    if path is None or path.suffix != ".html":
        return as_folder(path)
    require_target(path)
    return path


Report = Annotated[
    Path | None,
    typer.Option(help="Folder for report.html with its data, or one .html file.", callback=as_page),
]


def write_page(
    target: Path | None,
    *items: Any,
    recordings: "Sequence[Recording]" = (),
    about: Mapping[str, object] = MappingProxyType({}),
) -> Path | None:
    """Path of the page: `target` itself where it is an HTML file, which needs no other; None without a target.

    Parameters
    ----------
    items : what `write_report` takes.
    recordings : those that the results are of.
    about : further facts to stand below the title, by name.
    """
    if target is None:
        return None
    from swashtwin.foundation import write_text
    from swashtwin.report import page_text, write_report

    facts = {name: str(value) for name, value in about.items()}
    if target.suffix == ".html":
        return write_text(target, page_text(*items, recordings=recordings, about=facts))
    return write_report(*items, folder=target, recordings=recordings, about=facts)


def page_entry(page: Path | None) -> dict[str, Path]:
    """Entry of a JSON answer that names the page; empty where none was asked for."""
    return {} if page is None else {"report": page}
