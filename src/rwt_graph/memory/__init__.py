"""The robot graph in memory: topics, services, actions, nodes, and the loop that runs it."""
