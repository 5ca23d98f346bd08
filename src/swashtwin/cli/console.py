"""Output of a command: JSON or tables, progress, notes, and the exit code with one line of reason.

Texts may come from a file of unknown origin. `safe_streams` and `escape_controls` ensure that they
never control the terminal, and that a console of any encoding displays them.
"""

import errno
import io
import logging
import math
import re
import sys
import threading
import time
import traceback
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal, TypeVar

import typer
from typer.core import TyperGroup

from swashtwin.cli.options import LAYOUT, option_name, spell_as_option
from swashtwin.foundation import SwashTwinError, escape_controls, json_text

T = TypeVar("T")

MAX_ROWS = 24
"""Rows of recordings that are printed, about one screen; ``--json`` prints all."""
MAX_SINGLE_NOTES = 3
"""Notes that differ in their numbers only and are printed one by one; more become one line."""
PROGRESS_INTERVAL_S = 20.0
"""Time between two lines of progress in a log file, which has no bar that could be redrawn."""
SILENCE_S = 60.0
"""Time without a finished unit of work after which a log file states that the command runs."""
MIN_ESTIMATED_S = 10.0
"""Duration of an activity from which a log file states at once how long it will take."""
MAX_LONG_UNITS = 10
"""Number of units of work up to which the first one counts for the estimate, however short."""
MAX_START_S = 60.0
"""Duration up to which the first of many units is left out of the estimate: it includes the start
of processes, which may have taken longer than the unit.
"""
MIN_COUNTED_UNITS = 3
"""Units after one that was left out from which on there is an estimate: processes that work side by
side finish their first units at about the same time.
"""

# A number in a note, with its sign, decimals and exponent.
_NUMBER = re.compile(r"[-+−]?\d[\d.,]*(?:e[-+]?\d+)?")

# Columns of a table if no terminal limits it.
_UNLIMITED_WIDTH = 200

# Columns that a folded text keeps on a narrow terminal, so that it stays readable.
_MAX_FOLDED_WIDTH = 16

# Characters of a cell; folding a label of several megabytes would take minutes.
_MAX_CELL_LENGTH = 2000

BUG = 1
BAD_DATA = 3
NO_VERDICT = 4
NOT_ENOUGH = 5
INTERRUPTED = 130
"""Exit codes; 0 is success, and 2 an invalid command line (set by typer).

`NO_VERDICT`: the command ended normally, but a recording has no verdict. `NOT_ENOUGH`: the
recordings are sound but too few. `INTERRUPTED`: the convention for SIGINT, 128 + 2.
"""


def safe_streams() -> None:
    """Let the console print characters that it cannot encode, and library logs, as escape codes.

    A warning of joblib about what it mends itself is left out.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")

    handler = logging.StreamHandler()
    handler.setFormatter(_EscapingFormatter("%(levelname)s: %(message)s"))
    logging.basicConfig(handlers=[handler])
    logging.captureWarnings(capture=True)
    # loky replaces a process whose memory has grown; no work is lost, and no user can mend it.
    warnings.filterwarnings("ignore", message="A worker stopped while some jobs")


class _EscapingFormatter(logging.Formatter):
    """Formats a log record without control characters."""

    def format(self, record: logging.LogRecord) -> str:
        return escape_controls(super().format(record), keep="\n")


def print_result(result: Mapping[str, Any], as_json: bool, show: Callable[[], None]) -> None:
    """Print a result as one JSON object, or call `show`, which prints it for people."""
    if not as_json:
        show()
        return

    is_unicode = (sys.stdout.encoding or "").lower().startswith("utf")
    typer.echo(escape_controls(json_text(result, ensure_ascii=not is_unicode)))


def print_text(text: str) -> None:
    """Print a text to standard output."""
    typer.echo(escape_controls(text, keep="\n"))


def print_note(text: str) -> None:
    """Print a text to standard error, so that standard output holds results only."""
    typer.echo(escape_controls(text, keep="\n"), err=True)


def print_merged_notes(notes: Iterable[tuple[str, str]], kind: str = "note") -> None:
    """Print notes on recordings to standard error, and notes of one kind as one line.

    These are equal notes, and more than `MAX_SINGLE_NOTES` that differ in numbers only.

    Parameters
    ----------
    notes : pairs of a recording's name and the note on it.
    kind : first word of each line.
    """
    pairs = list(notes)
    names_by_text: dict[str, list[str]] = {}
    for name, text in pairs:
        names_by_text.setdefault(text, []).append(name)

    texts_by_pattern: dict[str, list[str]] = {}
    for text, names in names_by_text.items():
        # The recording's name may stand in the text, too.
        pattern = _NUMBER.sub("#", text.replace(names[0], "#"))
        texts_by_pattern.setdefault(pattern, []).append(text)

    for texts in texts_by_pattern.values():
        if len(texts) > MAX_SINGLE_NOTES:
            names = list(dict.fromkeys(name for name, text in pairs if text in texts))
            print_note(f"{kind}: {_note_subject(names)}, such as {names[0]}: {texts[0]}")
            continue
        for text in texts:
            print_note(f"{kind}: {_note_subject(names_by_text[text])}: {text}")


def _note_subject(names: Sequence[str]) -> str:
    """Return the recordings that a note is on: the only one, or their number and first names."""
    from swashtwin.recordings import join_names

    if len(names) == 1:
        return names[0]
    return f"in {len(names)} recordings ({join_names(names)})"


def print_table(title: str, header: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
    """Print a table to standard output, with numbers aligned to the right.

    A narrow terminal folds long texts, but never a number.
    """
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    layout = Table(box=SIMPLE_HEAD)
    for column, name in enumerate(header):
        values = [row[column] for row in rows]
        is_number = any(map(_is_number, values)) and all(
            value is None or _is_number(value) for value in values
        )
        justify: Literal["left", "right"] = "right" if is_number else "left"
        longest = max(len(_format_cell(cell)) for cell in [name, *values])
        layout.add_column(
            Text(_format_cell(name)),
            justify=justify,
            no_wrap=is_number,
            overflow="fold",
            min_width=min(longest, _MAX_FOLDED_WIDTH),
        )
    for row in rows:
        layout.add_row(*(Text(_format_cell(cell)) for cell in row))

    console = Console(width=None if sys.stdout.isatty() else _UNLIMITED_WIDTH)

    # Wider than the terminal if it must be: rich would cut numbers otherwise.
    unlimited = console.options.update_width(sys.maxsize)
    console.width = max(console.width, console.measure(layout, options=unlimited).minimum)
    console.print(Text(_format_cell(title), style="table.title"))
    console.print(layout)


def print_rows(
    title: str,
    header: Sequence[str],
    rows: Sequence[Sequence[object]],
    source_of_all: str = "--json has",
) -> None:
    """Print the first rows of a table, and how to get the others.

    Parameters
    ----------
    source_of_all : subject and verb of the sentence that names the source of all rows.
    """
    print_table(title, header, rows[:MAX_ROWS])
    if len(rows) > MAX_ROWS:
        print_text(f"{len(rows) - MAX_ROWS} more rows: {source_of_all} them.")


def format_label(label: str | None) -> str:
    """Return the name of a class as people read it."""
    return (label or "no class").replace("_", " ")


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _format_cell(value: object) -> str:
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return "-"
    if isinstance(value, float):
        return f"{value:.4g}"

    text = escape_controls(str(value))
    if len(text) > _MAX_CELL_LENGTH:
        return f"{text[:_MAX_CELL_LENGTH]}..."
    return text


class _Activity:
    """What a command does now: units of work that are finished, and an estimate of the rest."""

    def __init__(self, description: str) -> None:
        self.description = description
        self.count = 0
        self.total = 0
        self.begun = time.monotonic()
        """Time at which it began: with the command, or when the previous activity ended."""
        self.updated = self.begun
        self.is_announced = False
        """Whether a line has stated how long it takes."""
        self.is_first_done = False
        # Units that do not count: those of an earlier run of the command, and the first of many.
        self._n_before: int | None = None
        # Time from which the others count.
        self._counted_from = self.begun
        self._is_first_left_out = False

    def update(self, count: int, total: int, description: str) -> None:
        """Take over what is finished.

        What follows a comma is a detail, such as a loss; another text before it, a smaller count or
        another total is another activity.
        """
        is_new_pass = count < self.count or (self.total and total != self.total)
        if is_new_pass or description.split(",")[0] != self.description.split(",")[0]:
            self.begun = self.updated
            self.is_announced = False
            self.is_first_done = False
            self._n_before = None
            self._counted_from = self.begun
            self._is_first_left_out = False

        self.updated = time.monotonic()
        if self._n_before is None:
            self._n_before = max(count - 1, 0)
        is_first = not self.is_first_done and count > self._n_before
        if is_first and total > MAX_LONG_UNITS and self.updated - self.begun < MAX_START_S:
            self._n_before = count
            self._counted_from = self.updated
            self._is_first_left_out = True
        self.is_first_done = count > 0
        self.description = description
        self.count = count
        self.total = total

    def estimate(self) -> tuple[float, float] | None:
        """Return how long the activity takes in total, and how long it still takes [s]."""
        n_done = self.count - (self._n_before or 0)
        n_needed = MIN_COUNTED_UNITS if self._is_first_left_out else 1
        if n_done < n_needed or not self.total:
            return None

        now = time.monotonic()
        waited = now - self.updated
        # The unit under way may take longer than the others did.
        mean_duration = (self.updated - self._counted_from) / n_done
        per_unit = max(mean_duration, (now - self._counted_from) / (n_done + 1))
        left = max(per_unit * (self.total - self.count) - min(waited, per_unit), 0.0)
        return now - self.begun + left, left

    def remainder(self) -> str:
        """Return how long it takes, and how long it still takes; else how long it has taken."""
        estimate = self.estimate()
        if estimate is None:
            return f"{format_run_time(time.monotonic() - self.begun)} so far"
        total, left = map(format_run_time, estimate)
        return f"about {left} of {total} left"

    def line(self) -> str:
        """Return a line of a log file."""
        counts = f"{self.count} of {self.total}, " if self.total else ""
        return f"{self.description}: {counts}{self.remainder()}"


def format_run_time(seconds: float) -> str:
    """Return a duration in a unit that suits its size.

    Examples
    --------
    >>> format_run_time(41.0), format_run_time(200.0), format_run_time(8000.0)
    ('41 s', '3 min', '2 h 13 min')
    """
    if seconds < 100:
        return f"{seconds:.0f} s"
    hours, minutes = divmod(round(seconds / 60), 60)
    if not hours:
        return f"{minutes} min"
    return f"{hours} h {minutes} min"


@contextmanager
def progress(title: str) -> Iterator[Callable[..., None]]:
    """Show progress on standard error while the block runs.

    Yields a function of (count, total, optional description). On a terminal it moves a bar; without
    one it prints a line every `PROGRESS_INTERVAL_S` seconds. Both state about how long the activity
    still takes as soon as a unit of work is finished.
    """
    activity = _Activity(title)
    if not sys.stderr.isatty():
        with _print_progress(activity) as print_line:
            yield print_line
        return

    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.fields[remainder]}", markup=False),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(escape_controls(title), total=None, remainder="")

        def move_bar(count: int, total: int, description: str = title) -> None:
            activity.update(count, total, description)
            remainder = activity.remainder() if activity.estimate() else ""
            bar.update(
                task,
                completed=count,
                total=total,
                description=escape_controls(description),
                remainder=remainder,
            )

        yield move_bar


@contextmanager
def _print_progress(activity: _Activity) -> Iterator[Callable[..., None]]:
    """Print progress as lines; a thread prints one if nothing is finished for `SILENCE_S`."""
    title = activity.description
    printed_at = time.monotonic()
    is_finished = threading.Event()

    def print_activity() -> None:
        nonlocal printed_at
        printed_at = time.monotonic()
        print_note(activity.line())

    def print_line(count: int, total: int, description: str = title) -> None:
        activity.update(count, total, description)
        estimate = activity.estimate()
        is_long = estimate is not None and estimate[0] >= MIN_ESTIMATED_S
        is_due = time.monotonic() - printed_at >= PROGRESS_INTERVAL_S
        # The first of many units has no estimate; the next one, soon after, has.
        is_due = is_due and (estimate is not None or total <= MAX_LONG_UNITS)
        if is_due or (is_long and not activity.is_announced):
            activity.is_announced = is_long
            print_activity()

    def break_silence() -> None:
        while not is_finished.wait(SILENCE_S / 2):
            if time.monotonic() - printed_at >= SILENCE_S:
                print_activity()

    threading.Thread(target=break_silence, daemon=True).start()
    try:
        yield print_line
    finally:
        is_finished.set()


def iterate_with_progress(entries: Sequence[T], title: str) -> Iterator[T]:
    """Yield the entries, and show how many are finished."""
    with progress(title) as bar:
        for count, entry in enumerate(entries):
            bar(count, len(entries))
            yield entry


# typer has its own copy of click in some versions, so that the class is taken from its errors.
_CLICK_ERROR: Any = next(
    kind for kind in typer.BadParameter.__mro__ if kind.__name__ == "ClickException"
)


class GuardedGroup(TyperGroup):
    """Commands whose errors become one line on standard error and an exit code."""

    def make_context(self, *arguments: Any, **options: Any) -> Any:
        """Return the context of a command line; its errors hold no control characters."""
        with _escaped_click_errors():
            return super().make_context(*arguments, **options)

    def invoke(self, ctx: Any) -> Any:
        """Run the command, and exit with one line if it fails."""
        try:
            with _escaped_click_errors():
                return super().invoke(ctx)
        except KeyboardInterrupt as cause:
            line = (
                "interrupted: no file is half-written. The same command continues if it keeps "
                "finished parts."
            )
            raise self._exit(line, INTERRUPTED) from cause
        except SwashTwinError as cause:
            raise self._exit(f"error: {_error_line(cause)}", BAD_DATA) from cause
        except MemoryError as cause:
            line = "error: not enough memory: process less data at a time."
            raise self._exit(line, BAD_DATA) from cause
        except OSError as cause:
            # A closed pipe is not an error: the reader, such as head, has enough.
            if cause.errno == errno.EPIPE:
                raise
            raise self._exit(f"error: {_os_error_line(cause)}", BAD_DATA) from cause
        except Exception as cause:
            if isinstance(cause, (_CLICK_ERROR, typer.Exit, typer.Abort)):
                raise
            # safetensors raises its own error if the disk is full
            if type(cause).__name__ == "SafetensorError":
                line = f"error: {_one_line(cause)}; no file is half-written."
                raise self._exit(line, BAD_DATA) from cause
            if ctx.params.get("debug"):
                typer.echo(escape_controls(traceback.format_exc(), keep="\n"), err=True)
            line = (
                f"unexpected {type(cause).__name__}: {_one_line(cause)} This is a bug: please "
                "report it with the traceback that swashtwin --debug prints."
            )
            raise self._exit(line, BUG) from cause

    @staticmethod
    def _exit(line: str, code: int) -> typer.Exit:
        typer.echo(f"swashtwin: {escape_controls(line)}", err=True)
        return typer.Exit(code)


@contextmanager
def _escaped_click_errors() -> Iterator[None]:
    """Escape control characters in errors about the command line, and correct their suggestions."""
    try:
        yield
    except _CLICK_ERROR as cause:
        cause.message = escape_controls(cause.message, keep="\n")

        # Some settings are no options themselves, but values of one.
        key = getattr(cause, "option_name", "").lstrip("-").replace("-", "_")
        if key in LAYOUT:
            cause.possibilities = [option_name(key)]
        elif key == "device":
            cause.possibilities = ["--set device=..."]
        raise


def _error_line(error: SwashTwinError) -> str:
    """Return an error as one line that names the options of the command line."""
    line = _one_line(error.describe(spell_as_option))
    option = option_name(error.field)
    if error.field and option not in line:
        line += f" ({option})"
    return line


def _os_error_line(error: OSError) -> str:
    """Return an error of the operating system as one line that names the file."""
    file_name = f"{error.filename}: " if error.filename else ""
    return f"{file_name}{_one_line(error.strerror or error)}; no file is half-written."


def _one_line(cause: object) -> str:
    return " ".join(str(cause).split())


def require_existing(paths: Sequence[Path | None]) -> None:
    """Raise an error if a file does not exist, before anything slow begins."""
    from swashtwin.foundation import MissingFileError

    for path in paths:
        if path is not None and not path.exists():
            raise MissingFileError(f"{path} does not exist.")
