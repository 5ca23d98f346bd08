"""Whole recordings: their levels, what heads say of them, and the changes from a machine's own
healthy recordings.
"""
