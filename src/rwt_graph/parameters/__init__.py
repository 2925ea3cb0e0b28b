"""Parameters: their values, each node's own, the global tree, and the services that serve them."""
