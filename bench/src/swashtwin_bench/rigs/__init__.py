"""The virtual rig: measured-like recordings of a fleet of pumps that do not exist.

**What it is.** A generator of vibration recordings whose truth the twin does not contain
(`rig.fleet`), so that calibration has something to find and something it cannot find, and the whole
method can be tried and tested without a machine. Its difficulty was set by the severities, the
noise and the scatter in `rig.fleet` and `rig.measuring` (how, and what came out, stands in
docs/bench/rig.md). It has versions (`writing.VERSIONS`), each of them frozen.

**What it is not.** A machine. No figure made on it says how well anything works on a real pump, and
every report that uses it says so. Version 1 shares with the twin the rigid-body equations, the
chamber pressures, the fault laws and the pump's drawing (geometry, masses, sensor places). Its
interface values, mounting, bearings, clearances, housing, contact, scatter, drift and noise are its
own. `version_two` shares less, `version_three` nothing.
"""
