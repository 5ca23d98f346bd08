"""Version 2 of the virtual rig: a machine that no twin of ours contains (docs/bench/rig.md says
what it still shares).
"""
