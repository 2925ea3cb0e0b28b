"""Where the log lines of nodes go: levels, filters, the console and `/rosout`."""
