"""Classifiers without a network: on vibration features, and on random kernels."""
