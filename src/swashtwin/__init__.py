"""Digital twins of axial piston pumps: calibration, synthetic faults, diagnosis.

Every public name can be imported from here and is loaded when it is first used; `__init__.pyi`
lists them.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
