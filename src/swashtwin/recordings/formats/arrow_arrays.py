"""Columns of Apache Arrow as arrays of numpy."""

from typing import Any

import numpy as np

from swashtwin.foundation import load_extra

nanoarrow: Any = load_extra("nanoarrow", "readers", "a table")


def numbers_of(column: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return the numbers of a column of Arrow, and which of them are there: others are arbitrary.

    Parameters
    ----------
    column : array of fixed-size numbers of any library of Arrow.
    """
    view = nanoarrow.c_array(column).view()
    span = slice(view.offset, view.offset + view.length)
    values = np.asarray(view.buffer(1))[span]
    if not view.null_count:
        return values, np.ones(len(values), dtype=bool)

    bits = np.asarray(view.buffer(0)).view(np.uint8)
    return values, np.unpackbits(bits, bitorder="little")[span].astype(bool)


def doubles_of(column: Any) -> np.ndarray:
    """Return a column of Arrow in double precision, NaN for a missing number."""
    values, is_present = numbers_of(column)
    return values if is_present.all() else np.where(is_present, values, np.nan)


def texts_of(column: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return the characters of a column of short texts, and where each begins and the last ends."""
    view = nanoarrow.c_array(column).view()
    offsets = np.asarray(view.buffer(1))[view.offset : view.offset + view.length + 1]
    return np.asarray(view.buffer(2)).view(np.uint8), offsets
