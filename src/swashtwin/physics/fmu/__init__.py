"""A twin as a Functional Mock-up Unit (FMU), which simulates without Python."""
