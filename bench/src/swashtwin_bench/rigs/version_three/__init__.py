"""Version 3 of the virtual rig: pumps of another maker.

Their forces, contacts and housing are computed by separate equations, written from our derivations
(docs/explanation/physics.md) and the literature named at each part by an author who had not read
the pump prior, and frozen since. Nothing comes from `swashtwin.physics`, and from the twin's pump
file only the positions of the sensors.
"""
