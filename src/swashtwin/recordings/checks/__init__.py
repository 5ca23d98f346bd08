"""Is a measurement fit to learn from? What a careful person would look for before using it."""
