"""The checker that jaxtyping applies to every annotated function of swashtwin while `.ci/run` runs the tests."""

from beartype import BeartypeConf, beartype

tower = beartype(conf=BeartypeConf(is_pep484_tower=True))
"""Beartype for which an int is a float, as it is for a type checker."""
