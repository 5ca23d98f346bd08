"""Novelty detection: levels of healthy recordings, and how far a recording is from them."""
