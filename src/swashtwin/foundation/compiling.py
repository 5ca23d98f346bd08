"""Functions that are compiled to machine code when first called, for loops that no array operation expresses."""

from collections.abc import Callable
from typing import TypeVar, cast

import numba

_F = TypeVar("_F", bound=Callable)


def compiled(function: _F) -> _F:
    """`function`, compiled by numba; the machine code is kept on disk where that can be written.

    Give each such function ``@no_type_check`` beneath this decorator: the tests' run-time checker would otherwise wrap
    it in something that cannot be compiled. Arguments are plain numbers and arrays.
    """
    try:
        return cast(_F, numba.njit(cache=True, error_model="numpy")(function))
    except RuntimeError:  # no folder to keep the machine code in
        return cast(_F, numba.njit(error_model="numpy")(function))
