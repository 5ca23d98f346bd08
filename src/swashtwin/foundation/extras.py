"""Optional packages, imported where they are needed."""

from importlib import import_module
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
        missing = cause.name or module
        raise MissingExtraError(
            f'{need} needs {missing}, which is not installed: pip install "swashtwin[{extra}]".'
        ) from cause
