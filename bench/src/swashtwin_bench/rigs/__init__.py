"""The virtual rig: measured-like recordings of a fleet of pumps that do not exist.

**What it is.** A generator of vibration recordings whose truth the twin does not contain
(`rigs.fleet`). Calibration can find a part of that truth and cannot find the rest, so that the
whole method can be tested without a machine. Severities, noise and scatter in `rigs.fleet` and
`rigs.measuring` set its difficulty (docs/bench/rig.md describes how, and the outcome). It has
versions (`writing.VERSIONS`), each of them frozen.

**What it is not.** A machine. No figure made on it states how well anything works on a real pump,
and every report that uses it says so. Version 1 shares with the twin the rigid-body equations, the
laws of chambers and faults, and the pump's drawing (geometry, masses, positions of the sensors).
Its chambers are solved apart (`rigs.oil`); its interface values, mounting, bearings, clearances,
housing, contact, scatter, drift and noise are separate. `version_two` shares less, `version_three`
nothing.
"""
