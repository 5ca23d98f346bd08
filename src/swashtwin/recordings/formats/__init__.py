"""One module per file format, and the registry that finds it by suffix."""
