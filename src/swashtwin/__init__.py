"""Digital twins of axial piston pumps: calibration, synthetic faults, diagnosis."""
