"""Figures for notebooks and papers, in the style of the reports: each function gives a Matplotlib
figure.

Examples
--------
>>> from swashtwin import plot
>>> from swashtwin.plot import create_panels
>>> figure, axes = create_panels(2, 1, height=4.0)
>>> figure.get_size_inches().tolist(), axes.shape
([9.0, 4.0], (2, 1))
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
