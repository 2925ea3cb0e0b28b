"""The client's connection: the reconnecting session, and what becomes of the bytes."""
