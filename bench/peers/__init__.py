"""Which servers take part: the one under test, the bare relay, and Foxglove's SDK."""
