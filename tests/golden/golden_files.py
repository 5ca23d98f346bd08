"""The golden files of this folder: how a value is written to one, and in what another value differs
from it.
"""

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parent
DIGITS = 12
"""Significant digits of a number in a golden file."""


def golden_file(name: str) -> Path:
    """File of the golden value `name`."""
    return FOLDER / f"{name}.json"


def save_golden(name: str, value: Any) -> None:
    """Write the golden value `name`."""
    golden_file(name).write_text(json.dumps(rounded(value), indent=1) + "\n", encoding="utf-8")


def load_golden(name: str) -> Any:
    """The golden value `name`."""
    return json.loads(golden_file(name).read_text(encoding="utf-8"))


def rounded(value: Any) -> Any:
    """The value with its floating-point numbers rounded to `DIGITS` significant digits."""
    if isinstance(value, dict):
        return {key: rounded(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [rounded(entry) for entry in value]
    return float(f"{value:.{DIGITS}g}") if isinstance(value, float) else value


def differences(
    value: Any, golden: Any, *, rtol: float, atol: float = 0.0, path: str = ""
) -> Iterator[str]:
    """In what `value` differs from `golden`, a line each.

    Parameters
    ----------
    rtol, atol : relative and absolute difference that a number may have; whole numbers may have
    none.
    path : where in the whole value this one stands.
    """
    if isinstance(value, dict) and isinstance(golden, dict):
        for key in sorted({*value, *golden}):
            if key not in value or key not in golden:
                yield f"{path}.{key} is {'missing' if key in golden else 'new'}"
            else:
                yield from differences(
                    value[key], golden[key], rtol=rtol, atol=atol, path=f"{path}.{key}"
                )
    elif isinstance(value, list) and isinstance(golden, list) and len(value) == len(golden):
        for number, pair in enumerate(zip(value, golden, strict=True)):
            yield from differences(*pair, rtol=rtol, atol=atol, path=f"{path}[{number}]")
    elif not _equal(value, golden, rtol, atol):
        yield f"{path} is {value!r} instead of {golden!r}"


def _equal(value: Any, golden: Any, rtol: float, atol: float) -> bool:
    if (
        isinstance(value, float)
        and isinstance(golden, int | float)
        and not isinstance(golden, bool)
    ):
        return math.isclose(value, golden, rel_tol=rtol, abs_tol=atol)

    return type(value) is type(golden) and bool(value == golden)
