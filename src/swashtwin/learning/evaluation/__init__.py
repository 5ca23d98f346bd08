"""Scores of a classifier on recordings that had no part in it, and its confidence."""
