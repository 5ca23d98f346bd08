"""History of watched machines: a database of verdicts, indicators and alarms, and waveforms beside
it.
"""
