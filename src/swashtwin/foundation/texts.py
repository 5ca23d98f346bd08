"""Texts from outside, made safe for terminals, spreadsheets, JSON and XML."""

import csv
import io
import json
import math
import re
import unicodedata
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

CONTROLS = "\x00-\x1f\x7f-\x9f\u200b\u200e\u200f\u2028-\u202e\u2060-\u2069\ufeff"
"""Control characters, line ends, and marks that change the direction of writing or have no width,
as ranges of `re`."""
_CONTROLS = re.compile(f"[{CONTROLS}]+")

# The same, and what XML does not allow.
_HIDDEN = re.compile(f"[{CONTROLS}\ud800-\udfff\ufffe\uffff]")


# Characters of a parser's error that a message repeats.
_MAX_TOML_REASON_LENGTH = 160


def plain_text(text: str) -> str:
    """Return `text` in Unicode form NFC, without control characters and surrounding blanks.

    Examples
    --------
    >>> plain_text(" a\\x1b[31m "), plain_text("u\\u0308") == plain_text("\\xfc")
    ('a[31m', True)
    """
    return _CONTROLS.sub("", unicodedata.normalize("NFC", text)).strip()


def spreadsheet_text(text: str) -> str:
    """Return `text` as a cell of a CSV file that a spreadsheet does not take for a formula.

    Examples
    --------
    >>> spreadsheet_text("=1+1"), spreadsheet_text("normal")
    ("'=1+1", 'normal')
    """
    return f"'{text}" if text[:1] in ("=", "+", "-", "@", "\t", "\r") else text


def csv_text(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table as CSV, numbers with all digits, no text that is taken for a formula."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    for row in (header, *rows):
        writer.writerow([spreadsheet_text(cell) if isinstance(cell, str) else cell for cell in row])
    return text.getvalue()


def json_text(value: Any, *, indent: int | None = None, ensure_ascii: bool = False) -> str:
    """Return mappings, lists, paths, texts and numbers as JSON, with null for NaN and infinity."""
    return json.dumps(
        finite_values(value), indent=indent, ensure_ascii=ensure_ascii, allow_nan=False
    )


def finite_values(value: Any) -> Any:
    """Return a value with None for NaN and infinity, lists for tuples, and texts for paths.

    JSON has neither NaN nor infinity.
    """
    if isinstance(value, Mapping):
        return {str(name): finite_values(entry) for name, entry in value.items()}
    if isinstance(value, list | tuple):
        return [finite_values(entry) for entry in value]
    if isinstance(value, Path):
        return str(value)
    return None if isinstance(value, float) and not math.isfinite(value) else value


def plural(count: int, singular: str) -> str:
    """Return a count with its noun.

    Examples
    --------
    >>> plural(1, "seed"), plural(3, "seed")
    ('1 seed', '3 seeds')
    """
    return f"{count} {singular}" if count == 1 else f"{count} {singular}s"


def describe_toml_error(cause: Exception) -> str:
    r"""Return why a text is not valid TOML, with a remedy if a path of Windows is the likely cause.

    Examples
    --------
    >>> print(describe_toml_error(ValueError("Invalid hex value (at line 1, column 8)")))
    Invalid hex value (at line 1, column 8); write / between folders, or put a text with \ into
    single quotes
    """
    reason = (str(cause).splitlines() or [""])[0][:_MAX_TOML_REASON_LENGTH]
    # "C:\Daten" has an unknown escape sequence, "C:\Users" an incomplete one (\U and 8 digits).
    if "\\" in str(cause) or "hex value" in str(cause):
        return f"{reason}; write / between folders, or put a text with \\ into single quotes"
    return reason


def shell_command(*arguments: object) -> str:
    """Return a command line of swashtwin that can be pasted into every common shell.

    Examples
    --------
    >>> shell_command("inspect", Path("test bench"))
    'swashtwin inspect "test bench"'
    """
    parts = ["swashtwin"]
    for argument in arguments:
        # Windows shells accept "/" in paths too, and POSIX shells only that.
        text = argument.as_posix() if isinstance(argument, Path) else str(argument)
        parts.append(f'"{text}"' if " " in text else text)

    return " ".join(parts)


def escape_controls(text: str, *, keep: str = "") -> str:
    r"""Return `text` with unsafe characters as escape sequences.

    These are the C0 and C1 control characters, which steer a terminal, characters that change the
    direction of writing or have no width, lone surrogates and non-characters, which XML forbids.

    Parameters
    ----------
    keep : control characters that are not escaped, such as line ends.

    Examples
    --------
    >>> escape_controls("pump\x1b[2J A\n")
    'pump\\x1b[2J A\\n'
    >>> escape_controls("two\nlines", keep="\n")
    'two\nlines'
    """
    return _HIDDEN.sub(lambda match: match[0] if match[0] in keep else _escape(match[0]), text)


def _escape(character: str) -> str:
    """Return the escape sequence of a character; from 127 on one that JSON knows as well."""
    number = ord(character)
    if number < 0x7F:
        return character.encode("unicode_escape").decode("ascii")
    return f"\\u{number:04x}"
