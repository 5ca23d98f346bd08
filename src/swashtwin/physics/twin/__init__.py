"""A pump, under a condition, with a fault: what its accelerometers would read."""
