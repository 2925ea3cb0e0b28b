"""What arrives over a bad line, or from behind a router, and how old it is."""
