"""The recordings that a command's arguments name."""

import re
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from swashtwin.cli.console import note
from swashtwin.cli.options import LAYOUT, READING
from swashtwin.foundation import SwashTwinError

if TYPE_CHECKING:
    from swashtwin.recordings import Finding, Recording


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
    text = text.replace("the index says", "the option says").replace("correct the index", "correct the option")
    return text.replace("remove unit,", "leave out --unit,").replace("--channels [...]", "--channels NAME")


def _read_option(match: re.Match[str]) -> str:
    """``--read decimal=,`` of ``decimal = ","``, quoted where the shell needs it."""
    value = match[2].strip('"')
    pair = f"{match[1]}={value}"
    return f"--read {pair}" if value.isalnum() else f'--read "{pair}"'


def load_sources(paths: list[Path], unreadable: "list[Finding] | None" = None, /, **facts: Any) -> "list[Recording]":
    """Recordings of indexes, folders with an index, stores, and single files with `facts`, read when they are used.

    Those of several paths that share an id get their folders' names before it.

    Parameters
    ----------
    unreadable : gets a finding for each file of an index that cannot be loaded, instead of an error for the first.
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
                note(f"{path}: {contradicted}.")
        recordings += loaded
        folders += [(path if path.is_dir() else path.parent).absolute().parts[1:]] * len(loaded)
    for name, count in Counter(recording.recording_id for recording in recordings).items():
        alike = [i for i, recording in enumerate(recordings) if recording.recording_id == name] if count > 1 else []
        for depth in range(1, max((len(folders[i]) for i in alike), default=0) + 1):
            longer = {i: "/".join((*folders[i][-depth:], name)) for i in alike}
            if len(set(longer.values())) == count:
                for i, new in longer.items():
                    recordings[i] = recordings[i].replace(recording_id=new)
                break
    return recordings


def is_collection(path: Path, facts: dict[str, Any]) -> bool:
    """Whether a source states the facts of its recordings itself; no option may then state them again."""
    from swashtwin.recordings import is_store

    if not (path.is_dir() or path.suffix == ".toml" or is_store(path)):
        return False
    if facts:
        key = next(iter(facts))
        option = "--read" if key in LAYOUT else f"--{key.replace('_', '-')}"
        remedy = "convert its files anew" if is_store(path) else "edit its index"
        raise typer.BadParameter(f"is for single files, and {path} says it itself; {remedy}.", param_hint=option)
    return True
