"""Spectra, shaft orders, indicators and bearing lines of recordings. Knows no model of a pump."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
