"""Where recordings come from: folders, brokers, uploads. Each is on the disk before its source hears that it came."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
