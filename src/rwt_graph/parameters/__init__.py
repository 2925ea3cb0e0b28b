"""Parameters: values, those of nodes, the global tree, and the services for them."""
