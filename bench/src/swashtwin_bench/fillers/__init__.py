"""Generative fillers of scarce cells, for comparison."""
