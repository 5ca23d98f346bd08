"""Watching pumps at a plant: configuration, sources of recordings, history, alarms and the page."""

from typing import Any

import lazy_loader

from swashtwin.foundation import MissingExtraError

_load, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> Any:
    try:
        return _load(name)
    except ModuleNotFoundError as cause:
        raise MissingExtraError(
            f'a watch needs {cause.name}, which is not installed: pip install "swashtwin[monitor]".'
        ) from cause
