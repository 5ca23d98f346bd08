"""Calibration: six interface values from measured vibration, and how far to trust them.

`calibrate` takes a pump and recordings, searches with a `Calibrator` (`GaussNewton`, or the paper's
`IPINN`), and gives a `Calibration`.
"""

import lazy_loader

from swashtwin.foundation import require_modules

require_modules("torch", "numba", extra="twin", need="a calibration")

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
