"""Whole recordings: band powers, changes from healthy recordings, and heads that classify them."""
