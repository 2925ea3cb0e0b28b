"""What a `.msg`, `.srv` or `.action` text says: its fields, constants and hashes."""
