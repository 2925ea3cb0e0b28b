"""Graph below the nodes, of this process or another, and access to it from any thread."""
