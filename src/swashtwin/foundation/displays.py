"""How results show themselves: short texts in a console, tables of HTML in a notebook."""

import reprlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from html import escape
from typing import Any

from swashtwin.foundation.texts import escape_controls, plural

MAX_REPR = 200
"""Characters of a short text."""

# Characters of one value in a short text.
_MAX_VALUE = 40

# Rows of a table in a notebook, which is a summary.
_MAX_ROWS = 12


def short_repr(result: Any) -> str:
    """Return class and fields of a dataclass in at most `MAX_REPR` characters.

    Arrays appear as their shape, and parts as the name of their class. A class takes it by
    ``__repr__ = short_repr``.

    Examples
    --------
    >>> from dataclasses import make_dataclass
    >>> Result = make_dataclass("Result", ["name", "values"], namespace={"__repr__": short_repr})
    >>> Result("a", range(1000))
    Result(name='a', values=range(0, 1000))
    """
    values = [
        f"{field.name}={_short_value(getattr(result, field.name))}"
        for field in fields(result)
        if field.repr
    ]
    return shorten(f"{type(result).__name__}({', '.join(values)})")


def shorten(text: str) -> str:
    """Return the beginning of a text, at most `MAX_REPR` characters, with its last one.

    Examples
    --------
    >>> shorten("<" + 300 * "a" + ">")[-6:]
    'aa...>'
    """
    if len(text) <= MAX_REPR:
        return text
    return f"{text[: MAX_REPR - 4]}...{text[-1]}"


def _short_value(value: Any) -> str:
    if hasattr(value, "shape"):
        return f"array{tuple(value.shape)}"
    if is_dataclass(value):
        return f"{type(value).__name__}(...)"

    text = reprlib.repr(value)
    if len(text) > _MAX_VALUE and isinstance(value, Mapping | Sequence):
        return f"<{plural(len(value), 'character' if isinstance(value, str) else 'item')}>"
    return text


def html_table(
    title: str, header: Sequence[str], rows: Iterable[Sequence[object]], *notes: str
) -> str:
    """Return a table for a notebook, with the first rows and the number of the others.

    All texts are escaped. It has no colors, so that it is readable on light and dark pages.

    Parameters
    ----------
    title : sentence above the table; angle brackets of a `repr` are left out.
    header : names of the columns; empty for a table without them.
    notes : sentences below the table; empty ones are left out.
    """
    listed = list(rows)
    if len(listed) > _MAX_ROWS:
        notes = (f"{len(listed) - _MAX_ROWS} more rows.", *notes)
    lines = [_html_row("td", row) for row in listed[:_MAX_ROWS]]
    head = f"<thead>{_html_row('th', header)}</thead>" if header else ""
    below = "".join(f"<p>{_html_text(note)}</p>" for note in notes if note)
    table = f"<table>{head}<tbody>{''.join(lines)}</tbody></table>" if lines else ""
    return (
        f"<div style='overflow-x:auto'><p><strong>{_html_text(title.strip('<>'))}</strong></p>"
        f"{table}{below}</div>"
    )


def _html_row(tag: str, cells: Sequence[object]) -> str:
    # the style sheets of notebooks align text to the right, as numbers
    style = " style='text-align:left'"
    return f"<tr>{''.join(f'<{tag}{style}>{_html_text(cell)}</{tag}>' for cell in cells)}</tr>"


def _html_text(cell: object) -> str:
    return escape(escape_controls("" if cell is None else str(cell)))
