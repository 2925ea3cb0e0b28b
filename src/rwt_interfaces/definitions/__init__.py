"""Definitions in `.msg`, `.srv` and `.action` texts: fields, constants and hashes."""
