"""Worker processes that serve the same ports as one server."""
