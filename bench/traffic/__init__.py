"""Load on a server: its dialects, and readings of the server's process."""
