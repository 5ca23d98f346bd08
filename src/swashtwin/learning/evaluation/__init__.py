"""Scores of a classifier on recordings it has never seen, with the split beside
them.
"""
