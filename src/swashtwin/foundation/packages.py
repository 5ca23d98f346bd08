"""The version of this package, optional packages, and compilation of loops to machine code."""

import sys
from collections.abc import Callable
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from typing import Any, TypeVar, cast

from swashtwin.foundation.errors import MissingExtraError

try:
    VERSION = version("swashtwin")
except PackageNotFoundError:  # run from a source tree that was never installed
    VERSION = "0+unknown"

# The version, by the name that is common among packages.
__version__ = VERSION


def load_extra(module: str, extra: str, need: str) -> Any:
    """Import and return an optional module, or a module of this package that needs one.

    Parameters
    ----------
    module : such as ``"onnx"``.
    extra : extra of swashtwin that installs it, such as ``"networks"``.
    need : what needs it, with which the message begins, such as ``"the network bitcn"``.

    Raises
    ------
    MissingExtraError
        It is not installed; the message holds the command that installs it.
    """
    try:
        return import_module(module)
    except ImportError as cause:
        raise _missing(cause.name or module, extra, need) from cause


def require_modules(*modules: str, extra: str, need: str) -> None:
    """Raise an error if a module is not installed, without importing it.

    Raises
    ------
    MissingExtraError
        A module is not installed.
    """
    for module in modules:
        if module not in sys.modules and find_spec(module) is None:
            raise _missing(module, extra, need)


def _missing(module: str, extra: str, need: str) -> MissingExtraError:
    return MissingExtraError(
        f'{need} needs {module}, which is not installed: pip install "swashtwin[{extra}]".'
    )


_F = TypeVar("_F", bound=Callable[..., Any])


def compiled(function: _F) -> _F:
    """Return `function` compiled by numba, which stores the machine code on disk if it can.

    Give each such function ``@no_type_check`` below this decorator: otherwise the tests' run-time
    checker wraps it in something that cannot be compiled. Arguments are plain numbers and arrays.
    """
    import numba

    try:
        return cast(_F, numba.njit(cache=True, error_model="numpy")(function))
    except RuntimeError:  # no folder is writable
        return cast(_F, numba.njit(error_model="numpy")(function))
