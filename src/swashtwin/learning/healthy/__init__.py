"""Novelty detection: band powers of healthy recordings, and the distance of others from them."""
