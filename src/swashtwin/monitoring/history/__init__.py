"""History of watched machines: a database of verdicts, indicators and alarms, and waveforms beside it."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
