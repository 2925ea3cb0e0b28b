"""Ratchet: calls of the project's functions per operation, compared with a recorded table."""
