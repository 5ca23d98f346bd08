"""Unknowns, measurements, and the distance between a twin and a measurement."""
