"""What the load says to a server, in which dialect, and what it reads off the server's process meanwhile."""
