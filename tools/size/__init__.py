"""Counted figures of the project: lines, loaded modules, calls per message, and duplicated structure."""
