"""Contract and common parts of robot programs, in the graph and over a connection."""
