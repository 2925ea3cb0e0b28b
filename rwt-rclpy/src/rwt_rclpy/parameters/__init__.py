"""The parameters of nodes: their values, what may be set, the services that serve them, and their clients."""
