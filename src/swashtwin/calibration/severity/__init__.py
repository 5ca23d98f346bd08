"""How large a fault is, by inversion."""
