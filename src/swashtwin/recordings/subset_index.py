"""An index of some of another index's recordings."""

import os
import tomllib
from collections.abc import Iterable, Sequence
from pathlib import Path

from swashtwin.foundation import InputError
from swashtwin.recordings.index import index_path, save_index
from swashtwin.recordings.recording import Recording


def narrow_index(index: Path | str, recordings: Sequence[Recording], ids: Iterable[str], path: Path | str) -> Path:
    """Path of a new index that holds only the entries of some recordings of `index`.

    A split that is written down so serves calibration, synthesis, training and evaluation alike.

    Parameters
    ----------
    index : folder that holds ``recordings.toml``, or the index file itself.
    recordings : what `read_recordings` gave for it.
    ids : recordings to keep.
    path : new index file.

    Raises
    ------
    InputError
        `recordings` are not those of `index`, or one of `ids` is not among them.
    """
    source, path = index_path(Path(index)), Path(path)
    table = tomllib.loads(source.read_text(encoding="utf-8"))
    if len(table["recording"]) != len(recordings):
        raise InputError(f"{source} has {len(table['recording'])} entries, for {len(recordings)} recordings.")
    wanted = {str(name) for name in ids}
    missing = sorted(wanted - {one.recording_id for one in recordings})
    if missing:
        raise InputError(f"{source} has no recording {missing[0]!r}.")
    pairs = zip(table["recording"], recordings, strict=True)
    table["recording"] = [entry for entry, one in pairs if one.recording_id in wanted]
    root = (source.parent / table.get("root", "")).resolve()
    table.pop("root", None)
    if root != path.parent.resolve():
        table["root"] = Path(os.path.relpath(root, path.parent.resolve())).as_posix()
    last = ("defaults", "recording")  # tables stand after the plain keys
    return save_index({key: table[key] for key in sorted(table, key=lambda key: key in last)}, path)
