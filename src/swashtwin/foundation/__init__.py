"""What every room stands on: errors, units, seeds, files that are whole or absent, artifacts,
compiled loops.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
