"""Hub: robots behind a NAT dial in, and clients reach them through it."""
