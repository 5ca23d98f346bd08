"""Synthetic windows: simulated with a twin, or made from measured windows alone."""

import lazy_loader

from swashtwin.foundation import require_modules

require_modules("torch", "numba", extra="twin", need="synthesis")

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
