"""Classifiers without a network, the rivals that a network must beat: on vibration features, and on random kernels."""

from swashtwin.baselines.fitted import FittedBaseline, fit_baseline, fit_extra_trees
from swashtwin.baselines.registry import BASELINES, Baseline

__all__ = ["BASELINES", "Baseline", "FittedBaseline", "fit_baseline", "fit_extra_trees"]
