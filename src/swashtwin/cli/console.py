"""What a command writes: one JSON object or tables to standard output, progress to standard error.

Text may come from a stranger's file. `safe_streams` and `escape_controls` see to it that it never steers the terminal,
and that a console of any encoding shows it.
"""

import io
import json
import logging
import math
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from threading import Timer
from typing import Any, TypeVar

import typer

from swashtwin.foundation import escape_controls

T = TypeVar("T")

_UNLIMITED = 200  # columns where no terminal limits a table
_WORD = 20  # characters of a single word that a column is not broken within
_LONGEST = 2000  # characters of a cell; a label of megabytes would take minutes to fold
_NARROW = 8  # characters of a word that stay together on a narrow terminal
_PATIENCE = 1.0  # seconds until a bar is shown, so that quick commands show none
_PAUSE = 20.0  # seconds between two lines of progress where there is no terminal


def safe_streams() -> None:
    """Let the console show whatever it cannot encode as codes, and warnings and logs of libraries without controls."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    handler = logging.StreamHandler()
    handler.setFormatter(_Printable("%(levelname)s: %(message)s"))
    logging.basicConfig(handlers=[handler])
    logging.captureWarnings(capture=True)


class _Printable(logging.Formatter):
    """Log lines without control characters."""

    def format(self, record: logging.LogRecord) -> str:
        """The line of a record."""
        return escape_controls(super().format(record), keep="\n")


def tell(result: Mapping[str, Any], as_json: bool, show: Callable[[], None]) -> None:
    """Print `result` as one JSON object, or what `show` prints."""
    if as_json:
        is_unicode = (sys.stdout.encoding or "").lower().startswith("utf")
        typer.echo(escape_controls(json.dumps(_plain(result), ensure_ascii=not is_unicode, allow_nan=False)))
    else:
        show()


def say(text: str) -> None:
    """Print a line to standard output."""
    typer.echo(escape_controls(text, keep="\n"))


def note(text: str) -> None:
    """Print a line to standard error, beside the progress."""
    typer.echo(escape_controls(text, keep="\n"), err=True)


def note_done_before(activity: str, out: Path | None) -> None:
    """Note runs of an earlier command that are not repeated."""
    if activity.endswith("done before"):
        note(f"{activity}, in {out}")


def note_left_out(left_out: Iterable[tuple[str, str]]) -> None:
    """Print why recordings were left out, one line for each reason, to standard error."""
    names_by_reason: dict[str, list[str]] = {}
    for name, reason in left_out:
        names_by_reason.setdefault(reason, []).append(name)
    for reason, names in names_by_reason.items():
        more = f" and {len(names) - 1} more" if len(names) > 1 else ""
        note(f"left out: {names[0]}{more}: {reason}")


def note_merged(notes: Iterable[tuple[str, str]]) -> None:
    """Print notes on recordings to standard error, one line for equal notes of several."""
    names_by_text: dict[str, list[str]] = {}
    for name, text in notes:
        names_by_text.setdefault(text, []).append(name)
    for text, names in names_by_text.items():
        more = f" and {len(names) - 3} more" if len(names) > 3 else ""
        where = names[0] if len(names) == 1 else f"in {len(names)} recordings ({', '.join(names[:3])}{more})"
        note(f"note: {where}: {text}")


def table(title: str, header: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
    """Print a table to standard output, numbers to the right.

    Where the terminal is too narrow, further columns follow below, each time beside those that say which row is which.
    No number is cut. The table is wide where no terminal limits it.
    """
    from rich.box import SIMPLE_HEAD
    from rich.cells import cell_len
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    console = Console(width=None if sys.stdout.isatty() else _UNLIMITED)
    numeric, narrowest, widest = [], [], []
    for column, name in enumerate(header):
        values = [row[column] for row in rows]
        numeric.append(any(_is_number(value) for value in values) and all(map(_is_number_or_none, values)))
        cells, words = [cell_len(_word(value)) for value in values], [cell_len(word) for word in _word(name).split()]
        whole = numeric[-1] or all(map(_is_word, values))
        narrowest.append(max([*words, *(cells if whole else [min(_WORD, *cells, _WORD)]), 1]))
        widest.append(max([cell_len(_word(name)), *cells, 1]))
    keys = list(range(numeric.index(True) if True in numeric else len(header)))
    if _width(narrowest, keys) > console.width // 2:
        for column in keys:
            narrowest[column] = min(narrowest[column], _NARROW)
    parts: list[list[int]] = [[]]
    for column in range(len(keys), len(header)):
        if parts[-1] and _width(narrowest, [*keys, *parts[-1], column]) > console.width:
            parts.append([])
        parts[-1].append(column)
    console.print(Text(_word(title), style="table.title"))
    for part in parts:
        columns = [*keys, *part]
        spare = console.width - _width(narrowest, columns)
        grid = Table(box=SIMPLE_HEAD)
        for column in columns:
            extra = max(0, min(widest[column] - narrowest[column], spare))
            spare -= extra
            justify: Any = "right" if numeric[column] else "left"
            grid.add_column(
                Text(_word(header[column])), justify=justify, overflow="fold", width=narrowest[column] + extra
            )
        for row in rows:
            grid.add_row(*(Text(_word(row[column])) for column in columns))
        console.print(grid)


def _width(widths: Sequence[int], columns: Sequence[int]) -> int:
    """Characters of a line with some columns, with the blanks between them."""
    return sum(widths[column] for column in columns) + 3 * len(columns) + 1


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _is_number_or_none(value: object) -> bool:
    return value is None or isinstance(value, (int, float))


def _is_word(value: object) -> bool:
    text = _word(value)
    return len(text) <= _WORD and " " not in text


@contextmanager
def progress(title: str) -> Iterator[Callable[..., None]]:
    """Bar on standard error while the block runs; call what it yields with (count, total, optional words).

    The bar appears after a second, so a quick command prints none. Without a terminal it is a line every 20 s.
    """
    if not sys.stderr.isatty():
        yield _lines_of_progress(title)
        return
    state: dict[str, Any] = {"total": None, "completed": 0, "description": escape_controls(title)}
    bars: list[Any] = []

    def show() -> None:
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

        columns = (
            TextColumn("{task.description}", markup=False),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
        )
        bars.append(Progress(*columns, console=Console(stderr=True)))
        bars[0].add_task(**state)
        bars[0].start()

    def refresh() -> None:
        for bar in bars:
            for task in bar.task_ids:
                bar.update(task, **state)

    def update(count: int, total: int, words: str = title) -> None:
        state.update(completed=count, total=total, description=escape_controls(words))
        refresh()

    timer = Timer(_PATIENCE, show)
    timer.daemon = True
    timer.start()
    try:
        yield update
    finally:
        timer.cancel()
        timer.join()
        refresh()
        for bar in bars:
            bar.stop()


def _lines_of_progress(title: str) -> Callable[..., None]:
    """Prints a line where the last one is old enough."""
    printed = time.monotonic()

    def update(count: int, total: int, words: str = title) -> None:
        nonlocal printed
        if time.monotonic() - printed >= _PAUSE:
            printed = time.monotonic()
            note(f"{words}: {count} of {total}")

    return update


def with_bar(items: Sequence[T], title: str) -> Iterator[T]:
    """The items one after the other, with a bar that says how many are done."""
    with progress(title) as bar:
        for number, item in enumerate(items):
            bar(number, len(items))
            yield item


def _word(value: object) -> str:
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "-"
    if isinstance(value, float):
        return f"{value:.4g}"
    text = escape_controls(str(value))
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, Path):
        return str(value)
    return None if isinstance(value, float) and not math.isfinite(value) else value
