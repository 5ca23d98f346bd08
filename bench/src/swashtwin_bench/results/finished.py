"""Values of single tasks, kept in files, so that a study that was interrupted goes on."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from swashtwin.foundation import ArtifactError, read_text, write_text
from swashtwin_bench.results.runs import FORMAT, Task


def finished_values(out: Path | None, task: Task, compute: Callable[[], Mapping[str, Any]]) -> dict[str, Any]:
    """Values of a task: read from ``OUT/STUDY/KEY/values.json`` where it lies there, else computed and written there.

    Parameters
    ----------
    out : folder of the studies; None writes nothing.
    compute : gives what JSON can hold.

    Raises
    ------
    ArtifactError
        The file is damaged.
    """
    path = None if out is None else Path(out) / task.study / task.key / "values.json"
    if path is not None and path.is_file():
        try:
            table = json.loads(read_text(path))
            return dict(table["values"])
        except (OSError, ValueError, KeyError, TypeError) as cause:
            raise ArtifactError(
                f"{path} is damaged ({type(cause).__name__}); delete it to run the task again."
            ) from cause
    values = dict(compute())
    if path is not None:
        table = {"format": FORMAT, "seed": task.seed, "factors": dict(task.factors), "settings": dict(task.settings)}
        text = json.dumps({**table, "values": values}, indent=1, ensure_ascii=False, default=str)
        write_text(path, text + "\n")
    return values
