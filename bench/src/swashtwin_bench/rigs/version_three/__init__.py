"""Version 3 of the virtual rig: pumps of another maker, whose forces, contacts and housing are
computed by equations of its own.

Written from our derivations (docs/explanation/physics.md) and the literature named at each part, by
one who had not read the pump prior; frozen since. It takes no equation from `swashtwin.physics`,
and of the twin's pump file the places of the sensors alone.
"""
