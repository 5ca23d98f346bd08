"""The page docs/reference/json.md: what the golden answers of commands hold, by key and kind."""

from collections.abc import Sequence
from itertools import takewhile
from pathlib import Path
from typing import Any

from golden_commands import COMMANDS, PROSE, VOLATILE
from golden_files import load_golden

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "json.md"
_FURTHER = ", ".join(f"`{key}`" for key in sorted(VOLATILE - {"command", "key", "device"}))
_INTRODUCTION = f"""# The output of `--json`

With `--json` every command prints exactly one JSON object on standard output. Progress and notes go to standard error.
Numbers are in SI units unless the key gives another unit. A missing number is `null`, never `NaN`. This page is generated
from outputs that the tests compare. Keys that are classes, channels or recordings are those of the example. Commands that
are not listed here print the names of the files that they wrote, and the number of items in them.

An output may also contain the keys {_FURTHER}.
Keys may be added at any time. Before version 1.0 keys may also be renamed or removed; the changelog lists these changes.

## Exit codes
| code | meaning |
| --- | --- |
| 0 | success |
| 1 | internal error; please report it |
| 2 | wrong command line |
| 3 | bad data or value; one line on standard error states what is wrong, what is allowed, and what to do |
| 4 | a recording has no verdict |
| 5 | the recordings are sound, but there are too few (`check`) |
| 130 | interrupted |
"""


def page_text() -> str:
    """The page."""
    parts: dict[str, str] = {}
    for name, command in COMMANDS.items():
        description = " ".join(takewhile(lambda word: "." not in word, command.line.split()))
        parts.setdefault(
            description,
            f"## `{description}`\n```\n{_lines(load_golden(f'answer_{name}'), {})}\n```\n",
        )

    return "\n".join([_INTRODUCTION, *parts.values()])


def _lines(value: Any, listed: dict[frozenset[str], str], key: str = "", indent: str = "") -> str:
    """Return the keys and kinds of a value; those of a large object one a line, and once.

    Parameters
    ----------
    listed : name of each object that was listed before, by its keys.
    """
    if key in PROSE:
        return "text" if isinstance(value, bool) else "[text]"
    if isinstance(value, list):
        return f"[{_of_all(value, listed, indent)}]"
    if not isinstance(value, dict):
        return _kind(value)
    if len(value) > 9 and all(isinstance(entry, float) for entry in value.values()):
        return f'{{"{next(iter(value))}": number, ...}}'
    keys = frozenset(value)
    if len(value) > 3 and keys in listed:
        return f"as `{listed[keys]}`"
    listed[keys] = key
    inner = []
    for name, entry in value.items():
        lines = _lines(entry, listed, name, f"{indent}  ")
        inner.append(f'"{name}": {lines}')

    text = "{" + ", ".join(inner) + "}"
    if len(indent) + len(text) <= 100 and "\n" not in text:
        return text
    lines = "".join(f"\n{indent}  {line}," for line in inner).removesuffix(",")

    return f"{{{lines}\n{indent}}}"


def _of_all(values: Sequence[Any], listed: dict[frozenset[str], str], indent: str) -> str:
    """Return the kind of the longest entry of a list, or the kinds of its numbers and texts."""
    if any(isinstance(value, dict | list) for value in values):
        return _lines(max(values, key=lambda value: len(value or ())), listed, "", indent)
    return " or ".join(dict.fromkeys(map(_kind, values)))


def _kind(value: Any) -> str:
    if value is None:
        return "null"
    return {bool: "true or false", int: "whole number", float: "number", str: "text"}[type(value)]
