"""Where a pump leaves linearity: slippers that lift off or differ, a loose slipper that rattles in its joint."""
