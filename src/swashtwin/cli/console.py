"""What a command writes: one JSON object or tables to standard output, progress to standard error.

Text may come from a stranger's file. `safe_streams` and `escape_controls` see to it that it never steers the terminal,
and that a console of any encoding shows it.
"""

import io
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

from swashtwin.foundation import escape_controls, json_text

T = TypeVar("T")

_UNLIMITED = 200  # columns where no terminal limits a table
_LONGEST = 2000  # characters of a cell; a label of megabytes would take minutes to fold
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
        typer.echo(escape_controls(json_text(result, ensure_ascii=not is_unicode)))
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


def note_merged(notes: Iterable[tuple[str, str]], kind: str = "note") -> None:
    """Print notes on recordings, or why they were left out, to standard error, one line for equal notes of several."""
    names_by_text: dict[str, list[str]] = {}
    for name, text in notes:
        names_by_text.setdefault(text, []).append(name)
    for text, names in names_by_text.items():
        more = f" and {len(names) - 3} more" if len(names) > 3 else ""
        where = names[0] if len(names) == 1 else f"in {len(names)} recordings ({', '.join(names[:3])}{more})"
        note(f"{kind}: {where}: {text}")


def table(title: str, header: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
    """Print a table to standard output, numbers to the right.

    Where the terminal is too narrow, further columns follow below, each time beside those that say which row is which.
    No number is cut. The table is wide where no terminal limits it.
    """
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    console = Console(width=None if sys.stdout.isatty() else _UNLIMITED)
    numeric = [
        any(map(_is_number, values)) and all(value is None or _is_number(value) for value in values)
        for values in ([row[column] for row in rows] for column in range(len(header)))
    ]
    keys = list(range(numeric.index(True) if True in numeric else len(header)))

    def grid(columns: Sequence[int], widest: int | None) -> Table:
        drawn = Table(box=SIMPLE_HEAD)
        for column in columns:
            name, most = Text(_word(header[column])), widest if column in keys else None
            if numeric[column]:
                cells = [*_word(header[column]).split(), *(_word(row[column]) for row in rows)]
                drawn.add_column(name, justify="right", min_width=max(map(len, cells)))
            else:
                drawn.add_column(name, overflow="fold", max_width=most)
        for row in rows:
            drawn.add_row(*(Text(_word(row[column])) for column in columns))
        return drawn

    def is_wide(columns: Sequence[int], widest: int | None) -> bool:
        unlimited = console.options.update_width(sys.maxsize)
        return console.measure(grid(columns, widest), options=unlimited).minimum > console.width

    everything = range(len(header))
    widest = (
        console.width // 2 // max(len(keys), 1) - 3 if is_wide(everything, None) and len(keys) < len(header) else None
    )
    parts: list[list[int]] = [[]]
    for column in everything[len(keys) :]:
        if parts[-1] and is_wide([*keys, *parts[-1], column], widest):
            parts.append([])
        parts[-1].append(column)
    console.print(Text(_word(title), style="table.title"))
    for part in parts:
        console.print(grid([*keys, *part], widest))


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


@contextmanager
def progress(title: str) -> Iterator[Callable[..., None]]:
    """Bar on standard error while the block runs; call what it yields with (count, total, optional words).

    The bar appears after a second, so a quick command prints none. Without a terminal it is a line every 20 s.
    """
    if not sys.stderr.isatty():
        printed = time.monotonic()

        def print_line(count: int, total: int, words: str = title) -> None:
            nonlocal printed
            if time.monotonic() - printed >= _PAUSE:
                printed = time.monotonic()
                note(f"{words}: {count} of {total}")

        yield print_line
        return

    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    bar = Progress(*columns, console=Console(stderr=True))
    task = bar.add_task(escape_controls(title), total=None)

    def update(count: int, total: int, words: str = title) -> None:
        bar.update(task, completed=count, total=total, description=escape_controls(words))

    timer = Timer(_PATIENCE, bar.start)
    timer.daemon = True
    timer.start()
    try:
        yield update
    finally:
        timer.cancel()
        timer.join()
        if bar.live.is_started:
            bar.stop()


def with_bar(items: Sequence[T], title: str) -> Iterator[T]:
    """The items one after the other, with a bar that says how many are done."""
    with progress(title) as bar:
        for number, item in enumerate(items):
            bar(number, len(items))
            yield item


def _word(value: object) -> str:
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return "-"
    if isinstance(value, float):
        return f"{value:.4g}"
    text = escape_controls(str(value))
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."
