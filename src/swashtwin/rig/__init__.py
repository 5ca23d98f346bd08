"""The virtual rig: measured-like recordings of a fleet of pumps that nobody owns.

**What it is.** A generator of vibration recordings whose truth the twin does not contain (`rig.fleet`), so that
calibration has something to find and something it cannot find, and the whole method can be tried and tested without a
machine. Its difficulty was set once, before any network was tuned, by the severities in `rig.fleet` and the noise in
`rig.measuring`; `RIG_VERSION` freezes it.

**What it is not.** A machine. No figure made on it says how well anything works on a real pump, and every report that
uses it says so. It shares the rigid-body equations, the chamber pressures and the fault laws with the twin; it does not
share their values, and its housing, contact, scatter, drift and noise are its own.
"""

from swashtwin.rig.writing import RIG_VERSION, SIZES, RigSize, build_rig, rig_recordings

__all__ = ["RIG_VERSION", "SIZES", "RigSize", "build_rig", "rig_recordings"]
