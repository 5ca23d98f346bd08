"""Methods that fill scarce cells, for comparison with twins."""
