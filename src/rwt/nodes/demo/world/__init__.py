"""The demo robot's surroundings, and what its sensors see of them."""
