"""The watch itself: from a delivered recording to its verdict, its alarm and the message about it."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
