"""Alarms with a promise: operating points, healthy baselines, the sequential test, sensors, and where messages go."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
