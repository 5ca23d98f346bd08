"""One reader per public set."""
