"""Files that a command writes: refused early if they must not be written, and report pages."""

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any

import typer

from swashtwin.foundation import InputError, SwashTwinError, plural

if TYPE_CHECKING:
    from swashtwin.recordings import Recording

Force = Annotated[
    bool, typer.Option("--force", help="Overwrite existing files (never inputs of the command).")
]
Report = Annotated[
    Path | None,
    typer.Option(help="Report to write: a folder for report.html and its data, or one .html file."),
]


def require_folder(path: Path | None) -> Path | None:
    """Return the path unless no folder can exist there or it is not writable."""
    if path is not None:
        _require_writable(path.absolute(), "a folder")
    return path


def require_output(
    *paths: Path | None,
    suffixes: Sequence[str] = (),
    inputs: Iterable[Path | None] = (),
    force: bool = False,
) -> None:
    """Raise an error if a file must not be written, before the work for it begins.

    A file must not be written if it is an input of the command, if it is not writable, or if it
    exists and `force` is not given.

    Parameters
    ----------
    paths : files to write; None is skipped.
    suffixes : allowed suffixes; all by default.
    inputs : files, indexes and folders that the command reads. Neither they nor the files that they
        name are ever overwritten, not even with `force`.
    force : overwrite a file that exists.

    Raises
    ------
    InputError
        A file must not be written.
    """
    given_inputs = [path for path in inputs if path is not None]
    for path in paths:
        if path is None:
            continue

        if path.is_dir():
            example = path / f"result{suffixes[0] if suffixes else ''}"
            raise InputError(f"{path} is a folder. Specify a file, such as {example}.")
        if suffixes and path.suffix.lower() not in suffixes:
            raise InputError(f"{path} must end in {' or '.join(suffixes)}.")
        _require_writable(path.absolute().parent, "a file in a folder")

        # The files that an index names can only be lost if the output exists.
        read_files = list(_files_of(given_inputs)) if path.exists() else given_inputs
        if any(path.resolve() == file.resolve() for file in read_files):
            raise InputError(
                f"{path} is an input of this command and would be lost. Specify another file."
            )

        if path.exists() and not force:
            raise InputError(f"{path} exists. Overwrite it with --force, or specify another file.")


def require_page(
    target: Path | None, *, inputs: Iterable[Path | None] = (), force: bool = False
) -> None:
    """Raise an error if the page of ``--report`` must not be written, like `require_output`."""
    if target is None or target.suffix == ".html":
        require_output(target, inputs=inputs, force=force)
        return

    require_folder(target)
    page = target / "report.html"
    given_inputs = list(inputs)
    require_output(page, inputs=given_inputs, force=force)

    # Data and figures beside a page of swashtwin belong to it.
    figures = [path for path in (target / "figures").glob("*") if path.is_file()]
    require_output(
        target / "results.json", *figures, inputs=given_inputs, force=force or page.exists()
    )


def _require_writable(folder: Path, expected: str) -> None:
    """Raise an error if `folder`, or its nearest existing parent, is not a writable folder."""
    existing = next(parent for parent in (folder, *folder.parents) if parent.exists())
    if not existing.is_dir():
        raise InputError(f"{existing} is a file. Specify {expected}.")
    if not os.access(existing, os.W_OK):
        raise InputError(f"{existing} is not writable. Specify another folder.")


def _files_of(paths: Iterable[Path]) -> Iterator[Path]:
    """Yield the paths, and the files that are named by those of them that are indexes."""
    from swashtwin.recordings import source_files

    for path in paths:
        yield path
        if not (path.is_dir() or path.suffix == ".toml"):
            continue
        try:
            yield from source_files(path)
        except SwashTwinError:
            # A folder or TOML file of another kind; the command itself reports what is wrong.
            continue


def describe_model_file(path: Path) -> str:
    """Return the name of a model file, with the date on which it was written and its age."""
    if not path.is_file():
        return f"{path}, shipped with swashtwin"

    written = datetime.fromtimestamp(path.stat().st_mtime, UTC)
    age = datetime.now(UTC) - written
    return f"{path}, written {written.date()}, {plural(max(age.days, 0), 'day')} old"


def write_page(
    target: Path | None,
    *results: Any,
    recordings: "Sequence[Recording]" = (),
    about: Mapping[str, object] = MappingProxyType({}),
) -> Path | None:
    """Write a report page and return its path; None without a target.

    Parameters
    ----------
    target : folder, or an HTML file.
    results : what `swashtwin.report.write_report` takes.
    recordings : recordings on which the results rest.
    about : further facts below the title, by name.
    """
    if target is None:
        return None

    from swashtwin.foundation import write_text
    from swashtwin.report import render_page, write_report

    facts = {name: str(value) for name, value in about.items()}
    if target.suffix == ".html":
        return write_text(target, render_page(*results, recordings=recordings, about=facts))
    return write_report(*results, folder=target, recordings=recordings, about=facts)
