"""How far a calibration can be trusted: intervals, identifiability, posterior, misfit hypotheses."""
