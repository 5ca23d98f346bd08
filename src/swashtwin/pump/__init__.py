"""A pump and its drawing, an operating condition, the faults, and how each is written as text."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
