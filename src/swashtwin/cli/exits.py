"""How a command ends: its exit code, and one line for the person who waits."""

import errno
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import typer
from typer.core import TyperGroup

from swashtwin.cli.options import LAYOUT
from swashtwin.foundation import SwashTwinError, escape_controls

BUG, BAD_DATA, NO_VERDICT, NOT_ENOUGH, INTERRUPTED = 1, 3, 4, 5, 130
"""Exit codes; 0 is success and 2 a wrong command line. 4: the command ended well, but a recording has no verdict. 5:
the recordings are sound, but too few."""

_CLICK_ERROR: Any = next(kind for kind in typer.BadParameter.__mro__ if kind.__name__ == "ClickException")


class Interrupted(KeyboardInterrupt):
    """Ctrl-C, with a hint at how to resume."""


class GuardedGroup(TyperGroup):
    """Commands whose errors become one line on standard error and an exit code."""

    def make_context(self, *arguments: Any, **options: Any) -> Any:
        """Context of a command line; what is wrong with its words is said without control characters."""
        with _printable_error():
            return super().make_context(*arguments, **options)

    def invoke(self, ctx: Any) -> Any:
        """Result of the command; an error that is not the command line's ends it here."""
        try:
            with _printable_error():
                return super().invoke(ctx)
        except KeyboardInterrupt as cause:
            hint = str(cause) or "nothing is half-written"
            raise self._exit(f"interrupted; {hint}.", INTERRUPTED) from cause
        except SwashTwinError as cause:
            option = f" (--{cause.field.replace('_', '-')})" if cause.field else ""
            raise self._exit(f"error: {_line(cause)}{option}", BAD_DATA) from cause
        except MemoryError as cause:
            raise self._exit("error: not enough memory; ask for less at a time.", BAD_DATA) from cause
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
                raise self._exit(f"error: {_line(cause)}; nothing is half-written.", BAD_DATA) from cause
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


def _line(cause: object) -> str:
    return " ".join(str(cause).split())


def require_files(paths: Sequence[Path | None]) -> None:
    """Refuse a file that is not there, before anything slow begins."""
    from swashtwin.foundation import MissingFileError

    for path in paths:
        if path is not None and not path.exists():
            raise MissingFileError(f"{path} does not exist.")


@contextmanager
def resumable(hint: str) -> Iterator[None]:
    """Within it, Ctrl-C says how to resume."""
    try:
        yield
    except KeyboardInterrupt as cause:
        raise Interrupted(hint) from cause
