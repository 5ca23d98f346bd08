"""What a command writes, and how it ends: one JSON object or tables, progress, its exit code and
one line of why.

Text may come from a stranger's file. `safe_streams` and `escape_controls` see to it that it never
steers the terminal, and that a console of any encoding shows it.
"""

import errno
import io
import logging
import math
import sys
import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal, TypeVar

import typer
from typer.core import TyperGroup

from swashtwin.cli.options import LAYOUT, option_name, spell_as_option
from swashtwin.foundation import SwashTwinError, escape_controls, json_text

T = TypeVar("T")

MOST_ROWS = 24
"""Rows of recordings that are printed; --json has all."""
_UNLIMITED = 200  # columns where no terminal limits a table
_LEAST = 16  # columns of a text that is folded
_LONGEST = 2000  # characters of a cell; a label of megabytes would take minutes to fold
_PAUSE = 20.0  # seconds between two lines of progress where there is no terminal


def safe_streams() -> None:
    """Let the console show whatever it cannot encode as codes, and warnings and logs of libraries
    without controls.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    handler = logging.StreamHandler()
    handler.setFormatter(_Printable("%(levelname)s: %(message)s"))
    logging.basicConfig(handlers=[handler])
    logging.captureWarnings(capture=True)


class _Printable(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
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


def note_merged(notes: Iterable[tuple[str, str]], kind: str = "note") -> None:
    """Print notes on recordings, or why they were left out, to standard error, one line for equal
    notes of several.
    """
    names_by_text: dict[str, list[str]] = {}
    for name, text in notes:
        names_by_text.setdefault(text, []).append(name)
    for text, names in names_by_text.items():
        more = f" and {len(names) - 3} more" if len(names) > 3 else ""
        where = (
            names[0]
            if len(names) == 1
            else f"in {len(names)} recordings ({', '.join(names[:3])}{more})"
        )
        note(f"{kind}: {where}: {text}")


def table(title: str, header: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
    """Print a table to standard output, numbers to the right; a narrow terminal folds long text,
    and no number.
    """
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    drawn = Table(box=SIMPLE_HEAD)
    for column, name in enumerate(header):
        values = [row[column] for row in rows]
        is_number = any(map(_is_number, values)) and all(
            value is None or _is_number(value) for value in values
        )
        least = min(max(len(_word(cell)) for cell in [name, *values]), _LEAST)
        justify: Literal["left", "right"] = "right" if is_number else "left"
        drawn.add_column(
            Text(_word(name)), justify=justify, no_wrap=is_number, overflow="fold", min_width=least
        )
    for row in rows:
        drawn.add_row(*(Text(_word(cell)) for cell in row))
    console = Console(width=None if sys.stdout.isatty() else _UNLIMITED)
    unlimited = console.options.update_width(sys.maxsize)
    console.width = max(console.width, console.measure(drawn, options=unlimited).minimum)
    console.print(Text(_word(title), style="table.title"))
    console.print(drawn)


def show_rows(
    title: str, header: Sequence[str], rows: Sequence[Sequence[object]], rest: str = "--json has"
) -> None:
    """Print the first rows of a table, and where the rest is."""
    table(title, header, rows[:MOST_ROWS])
    if len(rows) > MOST_ROWS:
        say(f"{len(rows) - MOST_ROWS} more rows: {rest} them.")


def class_words(label: str | None) -> str:
    """Name of a class as a reader should see it."""
    return (label or "no class").replace("_", " ")


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


@contextmanager
def progress(title: str) -> Iterator[Callable[..., None]]:
    """Bar on standard error while the block runs; call what it yields with (count, total, optional
    words).

    Without a terminal it is a line every 20 s.
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

    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(escape_controls(title), total=None)

        def update(count: int, total: int, words: str = title) -> None:
            bar.update(task, completed=count, total=total, description=escape_controls(words))

        yield update


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


BUG, BAD_DATA, NO_VERDICT, NOT_ENOUGH, INTERRUPTED = 1, 3, 4, 5, 130
"""Exit codes; 0 is success and 2 a wrong command line. 4: the command ended well, but a recording
has no verdict. 5: the recordings are sound, but too few.
"""

_CLICK_ERROR: Any = next(
    kind for kind in typer.BadParameter.__mro__ if kind.__name__ == "ClickException"
)


class GuardedGroup(TyperGroup):
    """Commands whose errors become one line on standard error and an exit code."""

    def make_context(self, *arguments: Any, **options: Any) -> Any:
        """Context of a command line; what is wrong with its words is said without control
        characters.
        """
        with _printable_error():
            return super().make_context(*arguments, **options)

    def invoke(self, ctx: Any) -> Any:
        """Result of the command; an error that is not the command line's ends it here."""
        try:
            with _printable_error():
                return super().invoke(ctx)
        except KeyboardInterrupt as cause:
            line = "interrupted; nothing is half-written, and where finished parts are kept the same command continues."
            raise self._exit(line, INTERRUPTED) from cause
        except SwashTwinError as cause:
            raise self._exit(f"error: {_error_line(cause)}", BAD_DATA) from cause
        except MemoryError as cause:
            raise self._exit(
                "error: not enough memory; ask for less at a time.", BAD_DATA
            ) from cause
        except OSError as cause:
            if cause.errno == errno.EPIPE:
                raise
            where = f"{cause.filename}: " if cause.filename else ""
            reason = f"error: {where}{_line(cause.strerror or cause)}; nothing is half-written."
            raise self._exit(reason, BAD_DATA) from cause
        except Exception as cause:
            if isinstance(cause, (_CLICK_ERROR, typer.Exit, typer.Abort)):
                raise
            if type(cause).__name__ == "SafetensorError":  # what safetensors raises on a full disk
                raise self._exit(
                    f"error: {_line(cause)}; nothing is half-written.", BAD_DATA
                ) from cause
            if ctx.params.get("debug"):
                typer.echo(escape_controls(traceback.format_exc(), keep="\n"), err=True)
            line = f"unexpected {type(cause).__name__}: {_line(cause)} This is a bug: please report it with the "
            raise self._exit(f"{line}traceback that swashtwin --debug shows.", BUG) from cause

    @staticmethod
    def _exit(line: str, code: int) -> typer.Exit:
        typer.echo(f"swashtwin: {escape_controls(line)}", err=True)
        return typer.Exit(code)


@contextmanager
def _printable_error() -> Iterator[None]:
    try:
        yield
    except _CLICK_ERROR as cause:
        cause.message = escape_controls(cause.message, keep="\n")
        key = getattr(cause, "option_name", "").lstrip("-").replace("-", "_")
        if key in LAYOUT or key == "device":
            cause.possibilities = [f"--read {key}=..." if key in LAYOUT else "--set device=..."]
        raise


def _error_line(error: SwashTwinError) -> str:
    """Return an error as one line that names the options of the command line."""
    line = _line(error.describe(spell_as_option))
    option = option_name(error.field)
    if error.field and option not in line:
        line += f" ({option})"
    return line


def _line(cause: object) -> str:
    return " ".join(str(cause).split())


def require_files(paths: Sequence[Path | None]) -> None:
    """Refuse a file that is not there, before anything slow begins."""
    from swashtwin.foundation import MissingFileError

    for path in paths:
        if path is not None and not path.exists():
            raise MissingFileError(f"{path} does not exist.")
