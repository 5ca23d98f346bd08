"""Golden files of this folder: writing a value to one, and the differences of another value."""

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parent
DIGITS = 12
"""Significant digits of a number in a golden file."""


def golden_file(name: str) -> Path:
    """Return the file of the golden value `name`."""
    return FOLDER / f"{name}.json"


def save_golden(name: str, value: Any) -> None:
    """Write the golden value `name`."""
    golden_file(name).write_text(json.dumps(rounded(value), indent=1) + "\n", encoding="utf-8")


def load_golden(name: str) -> Any:
    """Return the golden value `name`."""
    return json.loads(golden_file(name).read_text(encoding="utf-8"))


def rounded(value: Any) -> Any:
    """Return the value with its floating-point numbers rounded to `DIGITS` significant digits."""
    if isinstance(value, dict):
        return {key: rounded(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [rounded(entry) for entry in value]
    if isinstance(value, float):
        return float(f"{value:.{DIGITS}g}")
    return value


def differences(
    value: Any, golden: Any, *, rtol: float, atol: float = 0.0, path: str = ""
) -> Iterator[str]:
    """Yield a line for each difference of `value` from `golden`.

    Parameters
    ----------
    rtol, atol : relative and absolute difference that a number may have; whole numbers may have
    none.
    path : position of this value in the whole one.
    """
    if isinstance(value, dict) and isinstance(golden, dict):
        for key in sorted({*value, *golden}):
            entry_path = f"{path}.{key}"
            if key not in value:
                yield f"{entry_path} is missing"
            elif key not in golden:
                yield f"{entry_path} is new"
            else:
                yield from differences(
                    value[key], golden[key], rtol=rtol, atol=atol, path=entry_path
                )
    elif isinstance(value, list) and isinstance(golden, list) and len(value) == len(golden):
        for number, pair in enumerate(zip(value, golden, strict=True)):
            yield from differences(*pair, rtol=rtol, atol=atol, path=f"{path}[{number}]")
    elif not _equal(value, golden, rtol, atol):
        yield f"{path} is {value!r} instead of {golden!r}"


def _equal(value: Any, golden: Any, rtol: float, atol: float) -> bool:
    # JSON may hold 1 for the number 1.0, and bool is a kind of int.
    is_number = isinstance(golden, int | float) and not isinstance(golden, bool)
    if isinstance(value, float) and is_number:
        return math.isclose(value, golden, rel_tol=rtol, abs_tol=atol)

    return type(value) is type(golden) and bool(value == golden)
