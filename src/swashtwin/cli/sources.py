"""The recordings that a command's arguments name."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from swashtwin.cli.advice import SINGLE_FILE_OPTIONS, single_file_options
from swashtwin.cli.options import read_pairs, read_words

if TYPE_CHECKING:
    from swashtwin.recordings import Finding, Recording


def load_sources(paths: list[Path], unreadable: "list[Finding] | None" = None, /, **facts: Any) -> "list[Recording]":
    """Recordings of indexes, folders with an index, stores, and single files with `facts`, read when they are used.

    Parameters
    ----------
    unreadable : gets a finding for each file of an index that cannot be loaded, instead of an error for the first.
    """
    from swashtwin.recordings import load_recordings

    recordings: list[Recording] = []
    for path in paths:
        if is_collection(path, facts):
            recordings += load_recordings(path, unreadable=unreadable)
        else:
            with single_file_options():
                recordings += load_recordings(path, **facts)
    return recordings


def refuse_source(target: Path, paths: list[Path]) -> None:
    """Refuse to write a file that is also read."""
    from swashtwin.foundation import InputError
    from swashtwin.recordings import source_files

    for path in paths:
        if any(target.resolve() == file.resolve() for file in source_files(path)):
            raise InputError(f"{target} is read from {path} and would be lost; name another --out.")


def is_collection(path: Path, facts: dict[str, Any]) -> bool:
    """Whether a source states the facts of its recordings itself; no option may then state them again."""
    from swashtwin.recordings import is_store

    if not (path.is_dir() or path.suffix == ".toml" or is_store(path)):
        return False
    if facts:
        option = SINGLE_FILE_OPTIONS[next(iter(facts))]
        remedy = "convert its files anew" if is_store(path) else "edit its index"
        raise typer.BadParameter(f"is for single files, and {path} says it itself; {remedy}.", param_hint=option)
    return True


Dataset = Annotated[
    Path, typer.Argument(metavar="INDEX", help="Index file or the folder that holds one, a store, or a --public-set.")
]
PublicSet = Annotated[
    str | None, typer.Option(help="Name of the public set that the folder holds, such as pump_cavitation.")
]
Only = Annotated[
    list[str] | None,
    typer.Option(metavar="ATTRIBUTE=VALUE,...", help="Recordings to use, by label, specimen, attribute; repeatable."),
]


def choose_recordings(source: Path, public_set: str | None, only: list[str] | None) -> "list[Recording]":
    """Recordings of an index, a store or a public set; with `only` those whose attributes have the values named."""
    from swashtwin.bench import read_public_set
    from swashtwin.foundation import DataError
    from swashtwin.recordings import load_recordings

    choices = read_pairs(only, "--only")
    recordings = list(load_recordings(source)) if public_set is None else read_public_set(public_set, source)
    for name, text in choices.items():
        values = set(read_words(text))
        recordings = [recording for recording in recordings if _attribute(recording, name) in values]
        if not recordings:
            raise DataError(f"no recording has {name} = {text}; swashtwin inspect shows what there is.")
    return recordings


def _attribute(recording: "Recording", name: str) -> str:
    if name in ("label", "specimen"):
        return getattr(recording, name) or ""
    return str(recording.attributes.get(name, ""))
