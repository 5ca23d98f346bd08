"""Version 2 of the virtual rig: a machine that none of our twins contains.

docs/bench/rig.md lists what it still shares with the twin.
"""
