"""Commands of the group bench, which ask whether the methods work: the virtual rig, fillers, and every study."""
