"""The recordings that a command's arguments name, and the files that it writes, refused early where
they may not be.
"""

import os
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any

import typer

from swashtwin.cli.console import print_note
from swashtwin.cli.options import LAYOUT, READING
from swashtwin.foundation import InputError, SwashTwinError

if TYPE_CHECKING:
    from swashtwin.recordings import Finding, Recording


def require_folder(path: Path | None) -> Path | None:
    """The same path, refused where no folder can be there or nothing can be written into it."""
    if path is not None:
        _require_place(path.absolute(), "a folder")
    return path


Force = Annotated[
    bool,
    typer.Option(
        "--force",
        help="Write even over a file that another command or a hand made; never over an input.",
    ),
]
Report = Annotated[
    Path | None, typer.Option(help="Folder for report.html with its data, or one .html file.")
]
_PAGE = "<footer>Written by swashtwin"
FIGURE = "<!-- figure of swashtwin -->"
"""What an SVG file of swashtwin holds."""


def require_output(
    *paths: Path | None,
    suffixes: Sequence[str] = (),
    inputs: Iterable[Path | None] = (),
    own: Sequence[str] = (),
    force: bool = False,
) -> None:
    """Refuse files that cannot be written, that the same command reads, or that others made, before
    the work for them.

    Parameters
    ----------
    paths : files to be written; None is none.
    suffixes : those that the files may have; all by default.
    inputs : files, indexes and folders that the command reads. Not even `force` replaces them, nor
        what they name.
    own : texts, of which a file that the same command wrote before holds one; such a file may be
        replaced.
    force : replace any other file as well.

    Raises
    ------
    InputError
        A file is refused.
    """
    read = [path for path in inputs if path is not None]
    for path in paths:
        if path is None:
            continue
        if path.is_dir():
            raise InputError(
                f"{path} is a folder; name a file, such as {path / ('result' + (*suffixes, '')[0])}."
            )
        if suffixes and path.suffix.lower() not in suffixes:
            raise InputError(f"{path} must end in {' or '.join(suffixes)}.")
        _require_place(path.absolute().parent, "a file in a folder")
        if any(
            path.resolve() == file.resolve() for file in (_files(read) if path.exists() else read)
        ):
            raise InputError(
                f"{path} is read by this command and would be lost; name another file."
            )
        if path.exists() and not (force or _holds(path, own)):
            raise InputError(f"{path} exists; replace it with --force, or name another file.")


def require_page(
    target: Path | None, *, inputs: Iterable[Path | None] = (), force: bool = False
) -> None:
    """Refuse a page, the file or folder of ``--report``, as `require_output` refuses files."""
    if target is None or target.suffix == ".html":
        require_output(target, inputs=inputs, own=[_PAGE], force=force)
        return
    require_folder(target)
    read = list(inputs)
    figures = [path for path in (target / "figures").glob("*") if path.is_file()]
    require_output(target / "report.html", inputs=read, own=[_PAGE], force=force)
    is_own = (target / "report.html").exists()
    require_output(target / "results.json", *figures, inputs=read, force=force or is_own)


def _require_place(folder: Path, wanted: str) -> None:
    existing = next(parent for parent in (folder, *folder.parents) if parent.exists())
    if not existing.is_dir():
        raise InputError(f"{existing} is a file; name {wanted}.")
    if not os.access(existing, os.W_OK):
        raise InputError(f"{existing} cannot be written to; name another folder.")


def artifact_marks(*kinds: str) -> list[str]:
    """What an artifact of one of the kinds holds, as `require_output` takes it."""
    return [rf"\"kind\": \"{kind}\"" for kind in kinds]


def _holds(path: Path, texts: Sequence[str]) -> bool:
    if not texts:
        return False
    with path.open("rb") as file:
        start = file.read(4_000_000)
    return any(text.encode() in start for text in texts)


def _files(paths: Iterable[Path]) -> Iterator[Path]:
    """The paths, and the files that those of them which are indexes, or folders with one, name."""
    from swashtwin.recordings import source_files

    for path in paths:
        yield path
        if path.is_dir() or path.suffix == ".toml":
            try:
                yield from source_files(path)
            except (
                SwashTwinError
            ):  # another kind of folder or file, or one that the command itself refuses
                continue


def write_page(
    target: Path | None,
    *items: Any,
    recordings: "Sequence[Recording]" = (),
    about: Mapping[str, object] = MappingProxyType({}),
) -> Path | None:
    """Path of the page: `target` itself where it is an HTML file, which needs no other; None
    without a target.

    Parameters
    ----------
    items : what `write_report` takes.
    recordings : those that the results are of.
    about : further facts to stand below the title, by name.
    """
    if target is None:
        return None
    from swashtwin.foundation import write_text
    from swashtwin.report import render_page, write_report

    facts = {name: str(value) for name, value in about.items()}
    if target.suffix == ".html":
        return write_text(target, render_page(*items, recordings=recordings, about=facts))
    return write_report(*items, folder=target, recordings=recordings, about=facts)


@contextmanager
def single_file_options() -> Iterator[None]:
    """Within it, errors that advise to edit the index name the options of a single file instead."""
    try:
        yield
    except SwashTwinError as cause:
        raise type(cause)(by_options(str(cause))) from cause


def by_options(text: str) -> str:
    """A message that advises to edit the index, with the options of a single file instead."""
    text = re.sub(rf"\b({'|'.join(LAYOUT)}) = (\d+|\"[^\"]*\")", _read_option, text)
    keys = rf"\b({'|'.join(READING)}) = (?=[\"'\[\d])"
    text = re.sub(keys, lambda match: f"--{match[1].replace('_', '-')} ", text)
    text = text.replace("the index says", "the option says").replace(
        "correct the index", "correct the option"
    )
    return text.replace("remove unit,", "leave out --unit,").replace(
        "--channels [...]", "--channels NAME"
    )


def _read_option(match: re.Match[str]) -> str:
    """``--read decimal=,`` of ``decimal = ","``, quoted where the shell needs it."""
    value = match[2].strip('"')
    pair = f"{match[1]}={value}"
    return f"--read {pair}" if value.isalnum() else f'--read "{pair}"'


def load_sources(
    paths: list[Path], unreadable: "list[Finding] | None" = None, /, **facts: Any
) -> "list[Recording]":
    """Recordings of indexes, folders with an index, stores, and single files with `facts`, read
    when they are used.

    Those of several paths that share an id get their folders' names before it.

    Parameters
    ----------
    unreadable : gets a finding for each file of an index that cannot be loaded, instead of an error
        for the first.
    """
    from swashtwin.recordings import load_recordings

    recordings: list[Recording] = []
    folders: list[tuple[str, ...]] = []
    for path in paths:
        if is_collection(path, facts):
            loaded = load_recordings(path, unreadable=unreadable)
        else:
            with single_file_options():
                loaded = load_recordings(path, **facts)
            contradicted = loaded[0].attributes.get("contradicted")
            if contradicted and unreadable is None:  # an inspection says it itself
                print_note(f"{path}: {contradicted}.")
        recordings += loaded
        folders += [(path if path.is_dir() else path.parent).absolute().parts[1:]] * len(loaded)
    for name, count in Counter(recording.recording_id for recording in recordings).items():
        alike = (
            [i for i, recording in enumerate(recordings) if recording.recording_id == name]
            if count > 1
            else []
        )
        for depth in range(1, max((len(folders[i]) for i in alike), default=0) + 1):
            longer = {i: "/".join((*folders[i][-depth:], name)) for i in alike}
            if len(set(longer.values())) == count:
                for i, new in longer.items():
                    recordings[i] = recordings[i].replace(recording_id=new)
                break
    return recordings


def is_collection(path: Path, facts: dict[str, Any]) -> bool:
    """Whether a source states the facts of its recordings itself; no option may then state them
    again.
    """
    from swashtwin.recordings import is_store

    if not (path.is_dir() or path.suffix == ".toml" or is_store(path)):
        return False
    if facts:
        key = next(iter(facts))
        option = "--read" if key in LAYOUT else f"--{key.replace('_', '-')}"
        remedy = "convert its files anew" if is_store(path) else "edit its index"
        raise typer.BadParameter(
            f"is for single files, and {path} says it itself; {remedy}.", param_hint=option
        )
    return True
