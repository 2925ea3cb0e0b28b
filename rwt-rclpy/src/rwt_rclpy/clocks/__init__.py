"""What time it is, on which clock, and what waits for it."""
