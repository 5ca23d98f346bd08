"""Classifiers that studies compare with."""
