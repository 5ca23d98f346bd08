"""A pump's equations (chambers, films, loads, faults, dynamics), their solvers, and the twin."""

import lazy_loader

from swashtwin.foundation import require_modules

require_modules("torch", "numba", extra="twin", need="a twin")

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
