"""Studies whose answer is one table."""
