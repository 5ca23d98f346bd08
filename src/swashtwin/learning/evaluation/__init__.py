"""Scores of a classifier on recordings it has never seen, with the level of generalization beside
them.
"""
