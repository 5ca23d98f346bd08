"""What people who look after machines expect to be told of a recording, each with an exact convention.

Amplitudes are one-sided and peak (a sine of amplitude 1 reads 1), levels are root mean squares (it reads 0.7071),
tapers are corrected, means are removed; docs/how-to/indicators.md has the whole list.
"""
