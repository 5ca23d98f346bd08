"""Optional packages, imported where they are needed."""

import sys
from importlib import import_module
from importlib.util import find_spec
from typing import Any

from swashtwin.foundation.errors import MissingExtraError


def load_extra(module: str, extra: str, need: str) -> Any:
    """An optional module, or a module of this package that stands on one.

    Parameters
    ----------
    module : such as ``"onnx"``.
    extra : of swashtwin that installs it, such as ``"networks"``.
    need : what needs it, as the message begins, such as ``"the network bitcn"``.

    Raises
    ------
    MissingExtraError
        It is not installed; the message says the line that installs it.
    """
    try:
        return import_module(module)
    except ImportError as cause:
        raise _missing(cause.name or module, extra, need) from cause


def require_modules(*modules: str, extra: str, need: str) -> None:
    """The same without importing them.

    Raises
    ------
    MissingExtraError
        One is not installed.
    """
    for module in modules:
        if module not in sys.modules and find_spec(module) is None:
            raise _missing(module, extra, need)


def _missing(module: str, extra: str, need: str) -> MissingExtraError:
    return MissingExtraError(f'{need} needs {module}, which is not installed: pip install "swashtwin[{extra}]".')
