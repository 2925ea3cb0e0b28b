"""Connection of a client: the reconnecting session, and decoding."""
