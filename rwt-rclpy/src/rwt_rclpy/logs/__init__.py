"""Log lines of nodes: levels, filters, the console and `/rosout`."""
