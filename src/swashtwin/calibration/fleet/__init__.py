"""Calibration of several machines of one type together."""
