"""Alarms with a promise: operating points, healthy baselines, the sequential test, sensors, and
where messages go.
"""
