"""The checker that jaxtyping applies to every annotated function of swashtwin while `.ci/nightly`
runs the tests.
"""

from functools import wraps
from typing import Any

import msgspec
from beartype import BeartypeConf, beartype
from jaxtyping._storage import _shape_storage

tower = beartype(conf=BeartypeConf(is_pep484_tower=True))
"""Beartype for which an int is a float, as it is for a type checker."""
_convert = msgspec.convert


@wraps(_convert)
def _convert_apart(*args: Any, **settings: Any) -> Any:
    """Axes of the parts of a saved thing are named in each part: none binds that of another."""
    outer = getattr(_shape_storage, "memo_stack", [])
    _shape_storage.memo_stack = []
    try:
        return _convert(*args, **settings)
    finally:
        _shape_storage.memo_stack = outer


msgspec.convert = _convert_apart
