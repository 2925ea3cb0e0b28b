"""The vocabulary of robot programs: what a program says alike in the graph and over a connection."""
