"""What is below the nodes: a graph of this process or another, and the thread that it may be touched on."""
