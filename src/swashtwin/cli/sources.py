"""Recordings that the arguments of a command name."""

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from swashtwin.cli.console import print_merged_notes
from swashtwin.cli.options import LAYOUT, option_name

if TYPE_CHECKING:
    from swashtwin.recordings import Finding, Recording


def load_sources(
    paths: list[Path], unreadable: "list[Finding] | None" = None, /, **facts: Any
) -> "list[Recording]":
    """Load the recordings of indexes, folders with an index, stores and single files.

    Samples are read when they are used. Recordings of several paths that share an id get the names
    of their folders before it.

    Parameters
    ----------
    unreadable : gets a finding for each file of an index that cannot be loaded; without it, the
        first such file raises an error.
    facts : facts of single files, by keys of an index.
    """
    from swashtwin.recordings import load_recording, load_recordings

    recordings: list[Recording] = []
    folders: list[tuple[str, ...]] = []
    contradictions: list[tuple[str, str]] = []
    for path in paths:
        if is_collection(path, facts):
            loaded = list(load_recordings(path, unreadable=unreadable))
        else:
            recording = load_recording(path, **facts)
            if len(paths) > 1:
                # A file that is read whole when it is opened would stay in memory.
                recording.samples.release()
            loaded = [recording]

            # An inspection reports a contradiction itself.
            contradiction = recording.attributes.get("contradicted")
            if contradiction and unreadable is None:
                contradictions.append((str(path), f"{contradiction}."))

        recordings += loaded
        folder = path if path.is_dir() else path.parent
        folders += [folder.absolute().parts[1:]] * len(loaded)

    print_merged_notes(contradictions)
    _make_ids_unique(recordings, folders)
    return recordings


def _make_ids_unique(recordings: "list[Recording]", folders: list[tuple[str, ...]]) -> None:
    """Put the names of folders before equal ids of recordings, as many as tell them apart."""
    counts = Counter(recording.recording_id for recording in recordings)
    for recording_id, count in counts.items():
        if count == 1:
            continue
        rows = [
            row
            for row, recording in enumerate(recordings)
            if recording.recording_id == recording_id
        ]
        max_depth = max(len(folders[row]) for row in rows)
        for depth in range(1, max_depth + 1):
            unique_ids = {row: "/".join((*folders[row][-depth:], recording_id)) for row in rows}
            if len(set(unique_ids.values())) == count:
                for row, unique_id in unique_ids.items():
                    recordings[row] = recordings[row].replace(recording_id=unique_id)
                break


def is_collection(path: Path, facts: dict[str, Any]) -> bool:
    """Return whether a source is an index, a folder with an index, or a store.

    Raises
    ------
    typer.BadParameter
        Such a source specifies the facts of its recordings itself, and an option specifies one too.
    """
    from swashtwin.recordings import is_store

    if not (path.is_dir() or path.suffix == ".toml" or is_store(path)):
        return False

    if facts:
        key = next(iter(facts))
        remedy = "Convert its files again" if is_store(path) else "Edit its index"
        raise typer.BadParameter(
            f"applies to single files, but {path} specifies it for each recording. {remedy}.",
            param_hint="--read" if key in LAYOUT else option_name(key),
        )
    return True
