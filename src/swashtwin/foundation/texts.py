"""Texts that people wrote: one form of each, and none that a terminal or a spreadsheet obeys."""

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
"""Control characters, line ends, and marks that turn the direction of writing or take no room, as
ranges of `re`.
"""
_CONTROLS = re.compile(f"[{CONTROLS}]+")
_HIDDEN = re.compile(f"[{CONTROLS}\ud800-\udfff\ufffe\uffff]")
"""These, and what XML does not allow."""


def plain_text(text: str) -> str:
    """`text` in one Unicode form (NFC), without control characters and without blanks around it.

    Examples
    --------
    >>> plain_text(" a\\x1b[31m "), plain_text("u\\u0308") == plain_text("\\xfc")
    ('a[31m', True)
    """
    return _CONTROLS.sub("", unicodedata.normalize("NFC", text)).strip()


def spreadsheet_text(text: str) -> str:
    """`text` as a cell of a CSV file that no spreadsheet takes for a formula.

    Examples
    --------
    >>> spreadsheet_text("=1+1"), spreadsheet_text("normal")
    ("'=1+1", 'normal')
    """
    return f"'{text}" if text[:1] in ("=", "+", "-", "@", "\t", "\r") else text


def csv_text(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A table as text with commas: every number with all its digits, no text that a spreadsheet
    takes for a formula.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    for row in (header, *rows):
        writer.writerow([spreadsheet_text(cell) if isinstance(cell, str) else cell for cell in row])
    return text.getvalue()


def json_text(value: Any, *, indent: int | None = None, ensure_ascii: bool = False) -> str:
    """Mappings, lists, paths, texts and numbers as JSON, with null for NaN and infinity, which JSON
    does not have.
    """
    return json.dumps(
        finite_values(value), indent=indent, ensure_ascii=ensure_ascii, allow_nan=False
    )


def finite_values(value: Any) -> Any:
    """The same with None for NaN and infinity, which JSON does not have; lists for tuples, texts
    for paths.
    """
    if isinstance(value, Mapping):
        return {str(name): finite_values(entry) for name, entry in value.items()}
    if isinstance(value, list | tuple):
        return [finite_values(entry) for entry in value]
    if isinstance(value, Path):
        return str(value)
    return None if isinstance(value, float) and not math.isfinite(value) else value


def plural(count: int, singular: str) -> str:
    """Count with its noun.

    Examples
    --------
    >>> plural(1, "seed"), plural(3, "seed")
    ('1 seed', '3 seeds')
    """
    return f"{count} {singular}" if count == 1 else f"{count} {singular}s"


def escape_controls(text: str, *, keep: str = "") -> str:
    r"""The text with every character that steers a terminal, or that XML does not allow, written as its code.

    These are the C0 and C1 control characters, those that change the direction of writing or take no room, lone
    surrogates and non-characters.

    Parameters
    ----------
    keep : control characters that stay, such as line ends.

    Examples
    --------
    >>> escape_controls("pump\x1b[2J A\n")
    'pump\\x1b[2J A\\n'
    >>> escape_controls("two\nlines", keep="\n")
    'two\nlines'
    """
    return _HIDDEN.sub(lambda match: match[0] if match[0] in keep else _code(match[0]), text)


def _code(character: str) -> str:
    """Its escape sequence; from 127 on one that JSON knows as well, whose writers leave these as
    they are.
    """
    number = ord(character)
    return (
        character.encode("unicode_escape").decode("ascii") if number < 0x7F else f"\\u{number:04x}"
    )
