"""Parameters of nodes: values, checks, services and clients."""
