"""What the pages show: figures, levels, states and texts."""
